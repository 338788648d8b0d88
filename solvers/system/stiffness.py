"""The stiffness of all displacements, and of the free ones: where T selects, one matrix in memory serves both.

Entries that rounding alone has left are taken out of it: where cells are boxes, of a hexahedral mesh a third, for what
one cell couples by shear, its neighbour takes back. It takes as long as 15 iterations of conjugate gradients, after
which products and multigrid cycles take half the time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Protocol

import numpy as np
from petsc4py import PETSc

from stickslip.geometry.arrays import CHUNK, LAST_DIGITS, Array, Ints
from stickslip.geometry.protocols import Mat, Vec
from stickslip.solvers.fem.constraints import Constraints
from stickslip.solvers.fem.mean_dilatation import MeanDilatation


def without_rounding(K: Mat) -> Mat:
    """K without its entries of the size of rounding errors, and K gone; K itself if they are few; collective.

    They are added to the entries of their node, so that a body that moves as a whole feels no more forces than before;
    but columns get other sums.
    """
    size = LAST_DIGITS * np.abs(K.getDiagonal().array_r)  # of the diagonal
    if _share(K, size) < 0.1:  # they do not pay for another matrix
        return K
    dim, low = K.block_size, K.getOwnershipRange()[0]
    pointer, column, value = K.getValuesCSR()
    counts, end = np.diff(pointer).astype(np.int64), 0
    for first, last in pairwise([*range(0, len(size), CHUNK), len(size)]):
        part, each, rows = slice(pointer[first], pointer[last]), counts[first:last].copy(), np.arange(last - first)
        j, x, row = column[part], value[part], np.repeat(rows, each)
        from_node = j - np.repeat(((rows + first + low) // dim * dim).astype(j.dtype), each)
        own = (from_node >= 0) & (from_node < dim)
        kept = own | (np.abs(x) > np.repeat(size[first:last], each))
        gone = np.flatnonzero(~kept)
        left = np.bincount(row[gone] * dim + j[gone] % dim, x[gone], len(rows) * dim)
        x[own] += left[row[own] * dim + from_node[own]]
        counts[first:last] -= np.bincount(row[gone], minlength=len(rows))
        count = len(x) - len(gone)
        column[end : end + count], value[end : end + count] = j[kept], x[kept]  # to the front, in place
        end += count
    sizes, comm, form = K.getSizes(), K.comm, K.getAttr("form")
    K.destroy()
    csr = (np.append(0, np.cumsum(counts)).astype(PETSc.IntType), column[:end], value[:end])
    found = PETSc.Mat().createAIJ(sizes, bsize=dim, csr=csr, comm=comm)
    found.assemble()
    found.setAttr("form", form)
    return found


def _share(K: Mat, size: Array) -> float:
    """Share of the entries of K that are not larger than `size` (owned,) of their row, of some rows; collective."""
    low, high = K.getOwnershipRange()
    rows = np.unique(np.linspace(low, high - 1, 300).astype(int)) if high > low else []
    found = [(np.count_nonzero(np.abs(x) <= size[i - low]), len(x)) for i in rows for x in [K.getRow(i)[1]]]
    few, many = K.comm.tompi4py().allreduce(np.array(found, np.int64).reshape(-1, 2).sum(axis=0))
    return float(few / many) if many else 0.0


class Products(Protocol):
    """A matrix (PETSc), or what stands for one."""

    def __mul__(self, u: Vec) -> Vec:
        """K u; collective."""
        ...


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

    whole: Products  # of all displacements
    free: Mat  # of the free displacements

    @property
    def product(self) -> Mat:
        """That of the free displacements, for products alone."""
        return self.free

    def mixed(self) -> Mat | None:
        """That of the free displacements with more unknowns, for a factor with fewer entries; None: not needed."""
        return None

    @staticmethod
    def of(K: Mat, T: Mat, constraints: Constraints, clean: bool = False) -> Stiffness:
        """Both from K, which becomes the free one where T selects; collective.

        Args:
            clean: leave out what rounding has left in the free one, see `without_rounding`.
        """
        low, high = T.getOwnershipRange()
        own = constraints.eliminated().astype(PETSc.IntType)
        if constraints.selects:
            return _selected(K, own, constraints.free_total, clean)
        free = K.PtAP(T)
        mean = free.getDiagonal().sum() / constraints.free_total
        diagonal = PETSc.Mat().createAIJ(free.getSizes(), bsize=constraints.dim, nnz=(1, 0), comm=free.comm)
        pointer = np.searchsorted(own, np.arange(low, high + 1)).astype(PETSc.IntType)
        diagonal.setValuesCSR(pointer, own, np.full(len(own), mean))
        diagonal.assemble()
        free.axpy(1.0, diagonal, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        return Stiffness(K, without_rounding(free) if clean else free)


class AveragedStiffness:
    """The same with mean dilatation: as a matrix, which has very many entries, only where one is asked for."""

    def __init__(self, shear: Stiffness, dilatation: MeanDilatation, T: Mat, matrix: Callable[[], Stiffness]) -> None:
        """
        Args:
            shear: without what the averaged dilatations resist.
            dilatation: of nearly incompressible bodies.
            matrix: assembles both as one.
        """
        self._shear, self._dilatation, self._T, self._matrix = shear, dilatation, T, matrix
        self.whole: Products = _Sum(shear.whole, list(dilatation.terms()))

    @cached_property
    def free(self) -> Mat:
        """See `Stiffness`; collective."""
        return self._matrix().free

    @cached_property
    def product(self) -> Mat:
        """See `Stiffness`; collective."""
        free = self._shear.free
        terms = _Sum(free, list(self._dilatation.terms(self._T)))
        found = PETSc.Mat().createPython(free.getSizes(), terms, comm=free.comm)
        found.setUp()
        return found

    def mixed(self) -> Mat | None:
        """See `MeanDilatation.mixed`; collective."""
        return self._dilatation.mixed(self._shear.free, self._T)


class _Sum:
    """K + sum C^T w C, for products."""

    def __init__(self, K: Products, terms: list[tuple[Mat, Vec]]) -> None:
        """
        Args:
            terms: C and the diagonal w.
        """
        self._K, self._terms = K, terms

    def __mul__(self, u: Vec) -> Vec:
        """The product with u; collective."""
        found = self._K * u
        for C, weight in self._terms:
            change = C * u
            change.array[:] *= weight.array_r
            C.multTransposeAdd(change, found, found)
        return found

    def mult(self, matrix: Mat, u: Vec, found: Vec) -> None:
        """The product of a PETSc matrix whose context this is."""
        (self * u).copy(found)


def _selected(K: Mat, own: Ints, free_total: int, clean: bool) -> Stiffness:
    """K without its eliminated rows and columns, in place; and K as their sum, the columns stored.

    Args:
        K: stiffness of all displacements.
        own: eliminated numbers of this rank.
        free_total: free displacements of all ranks.
        clean: see `Stiffness.of`.
    """
    if free_total == K.getSize()[0]:
        free = without_rounding(K) if clean else K
        return Stiffness(free, free)
    (low, high), diagonal = K.getOwnershipRange(), K.getDiagonal()
    diagonal.array[own - low] = 0.0
    every = PETSc.IS().createStride(high - low, first=low, step=1, comm=K.comm)
    columns = K.createSubMatrix(every, PETSc.IS().createGeneral(own, comm=K.comm))
    K.zeroRowsColumns(own, diag=diagonal.sum() / free_total)
    free = without_rounding(K) if clean else K
    return Stiffness(Restored(free, columns, own - low), free)
