"""Matrices of a system, as arrays and whole."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Mat
from stickslip.solvers.system.system import System, whole_stiffness


def dense(matrix: Any) -> Array:
    """A PETSc matrix of one rank, as an array."""
    indptr, indices, data = matrix.getValuesCSR()
    found = np.zeros(matrix.size)
    for row, (i, j) in enumerate(pairwise(indptr)):
        found[row, indices[i:j]] = data[i:j]
    return found


def whole(system: System) -> Mat:
    """K of all displacements, assembled for itself."""
    return whole_stiffness(system.problem, system.weak, system.constraints.links, system.dilatation)
