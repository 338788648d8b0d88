"""Given friction: the laws of a cone with their friction bound kept at what tractions known beforehand make it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solvers.cone import Cone, Place
from solvers.surface_problem import SurfaceProblem

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GivenFriction(Cone):
    """s = s(p_n of `given`), whatever p_n is: j_T with its p_T frozen, a convex problem.

    Source: Pop (1999), (2.2) and the remark after (2.6), "contact problem with given friction".
    """

    given: Array  # (rows,) [Pa]

    def bound(self, place: Place, p_n: Array) -> Array:
        return super().bound(place, self.given[place.normal])

    def bound_slope(self, place: Place, p_n: Array) -> Any:
        return sparse.csr_matrix(place.average.shape)


def with_given_friction(problem: SurfaceProblem, p: Array) -> SurfaceProblem:
    """The same step with the friction bounds of tractions p (rows,) [Pa]."""
    cone = problem.cone
    return replace(problem, cone=GivenFriction(cone.contacts, cone.time, cone.end, p))
