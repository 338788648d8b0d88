"""The stiffness of all displacements, and of the free ones: where T selects, one matrix in memory serves both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from stickslip.geometry.arrays import Ints
from stickslip.geometry.protocols import Mat, Vec
from stickslip.solvers.fem.constraints import Constraints


class Restored:
    """Products with K, from its free part and its eliminated columns, which are its eliminated rows too."""

    def __init__(self, free: Mat, columns: Mat, own: Ints) -> None:
        """
        Args:
            free: K without eliminated rows and columns, but for their diagonal.
            columns: the eliminated columns, whole.
            own: positions of those of this rank in its part of a vector.
        """
        self.free, self.columns, self.own = free, columns, own
        self._kept, self._gone = free.createVecRight(), columns.createVecRight()

    def __mul__(self, u: Vec) -> Vec:
        """K u; collective."""
        self._kept.array[:] = u.array_r
        self._gone.array[:] = u.array_r[self.own]
        self._kept.array[self.own] = 0.0
        found = self.free * self._kept
        self.columns.multAdd(self._gone, found, found)
        self.columns.multTranspose(self._kept, self._gone)
        found.array[self.own] += self._gone.array_r
        return found


@dataclass(frozen=True)
class Stiffness:
    """K and T^T K T, PETSc [N/m]; eliminated entries of the latter have only a diagonal, the mean of the free ones."""

    whole: Mat | Restored  # of all displacements, for products
    free: Mat  # of the free displacements

    @staticmethod
    def of(K: Mat, T: Mat, constraints: Constraints) -> Stiffness:
        """Both from K, which becomes the free one where T selects; collective."""
        low, high = T.getOwnershipRange()
        own = constraints.eliminated().astype(PETSc.IntType)
        if constraints.selects:
            return _selected(K, own, constraints.free_total)
        free = K.PtAP(T)
        mean = free.getDiagonal().sum() / constraints.free_total
        diagonal = PETSc.Mat().createAIJ(free.getSizes(), bsize=constraints.dim, nnz=(1, 0), comm=free.comm)
        pointer = np.searchsorted(own, np.arange(low, high + 1)).astype(PETSc.IntType)
        diagonal.setValuesCSR(pointer, own, np.full(len(own), mean))
        diagonal.assemble()
        free.axpy(1.0, diagonal, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        return Stiffness(K, free)


def _selected(K: Mat, own: Ints, free_total: int) -> Stiffness:
    """K without its eliminated rows and columns, in place; and K as their sum, the columns stored.

    Args:
        K: stiffness of all displacements.
        own: eliminated numbers of this rank.
        free_total: free displacements of all ranks.
    """
    if free_total == K.getSize()[0]:
        return Stiffness(K, K)
    (low, high), diagonal = K.getOwnershipRange(), K.getDiagonal()
    diagonal.array[own - low] = 0.0
    every = PETSc.IS().createStride(high - low, first=low, step=1, comm=K.comm)
    columns = K.createSubMatrix(every, PETSc.IS().createGeneral(own, comm=K.comm))
    K.zeroRowsColumns(own, diag=diagonal.sum() / free_total)
    return Stiffness(Restored(K, columns, own - low), K)
