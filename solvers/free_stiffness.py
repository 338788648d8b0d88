"""K_B: the stiffness of the free displacements."""

from __future__ import annotations

from typing import Any

import numpy as np
from petsc4py import PETSc

from solvers.constraints import Constraints


def free_stiffness(K: Any, T: Any, constraints: Constraints) -> Any:
    """T^T K T (PETSc), and at eliminated numbers the mean stiffness of the free ones alone."""
    low, high = T.getOwnershipRange()
    gone = constraints.eliminated()
    own = gone[(gone >= low) & (gone < high)].astype(PETSc.IntType)
    if constraints.selects:  # no product, which takes as much memory again
        stiffness, free = K.copy(), K.getDiagonal()
        free.array[own - low] = 0.0
        stiffness.zeroRowsColumns(own, diag=free.sum() / constraints.free_total)
        return stiffness
    stiffness = K.PtAP(T)
    mean = stiffness.getDiagonal().sum() / constraints.free_total
    diagonal = PETSc.Mat().createAIJ(stiffness.getSizes(), bsize=constraints.dim, nnz=(1, 0), comm=stiffness.comm)
    pointer = np.searchsorted(own, np.arange(low, high + 1)).astype(PETSc.IntType)
    diagonal.setValuesCSR(pointer, own, np.full(len(own), mean))
    diagonal.assemble()
    stiffness.axpy(1.0, diagonal, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    return stiffness
