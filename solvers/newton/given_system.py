"""One semismooth Newton system with a given Delassus operator, sparse: (A_p - A_w W) p = rhs - A_w offset."""

from __future__ import annotations

from typing import cast

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from stickslip.geometry.arrays import Array
from stickslip.solvers.interface.discrete import GivenSurface
from stickslip.solvers.newton.active_set import ActiveSet

DENSE = 200  # largest number of rows for a dense factorisation


def solve(laws: ActiveSet, u: Array) -> tuple[Array, Array]:
    """Solve a Newton system of a `DiscreteProblem`.

    Args:
        laws: the linearised laws.
        u: displacement of the last iterate (rows,), which anchors rigid modes; there are none here.

    Returns:
        Tractions p (rows,) and displacement of the contact dofs u_c = -W N^T p (rows,).

    Raises:
        LinAlgError: it is singular.
    """
    problem, surface = laws.problem, cast(GivenSurface, laws.problem.surface)
    A = sparse.csc_matrix(laws.A_p - laws.A_w @ (surface.N @ surface.matrix @ surface.N.T))
    right = laws.rhs - laws.A_w @ problem.offset
    if len(right) <= DENSE:
        p = np.linalg.solve(A.toarray(), right)
    else:
        try:
            p = splu(A).solve(right)
        except RuntimeError as error:  # SuperLU: exactly singular
            raise np.linalg.LinAlgError(str(error)) from None
    return p, surface.displacement(-surface.forces(p))
