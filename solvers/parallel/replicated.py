"""Replicated data: chosen entries of a distributed vector, values that ranks agree on, matrices to distribute."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from petsc4py import PETSc

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.protocols import Comm, Mat, Sparse, Vec

T = TypeVar("T")


def on_all_ranks(comm: Comm, value: T) -> T:
    """The value of rank 0 on every rank, an array as a buffer; its shape is the same on all; collective."""
    if comm.size == 1:
        return value
    if isinstance(value, np.ndarray):
        comm.Bcast(found := value.copy())
        return found
    agreed: T = comm.bcast(value)
    return agreed


def sum_of_sizes(v: Vec) -> float:
    """Sum of the magnitudes of all entries; collective.

    With the same bits wherever memory lies: in OpenBLAS' sum, which PETSc's norm takes, the first entry decides.
    """
    return float(v.comm.tompi4py().allreduce(float(np.abs(v.array_r).sum())))


class Replicated:
    """Read and write the m entries `rows` of distributed vectors.

    `mine` are the indices into `rows` of those that this rank owns, `local` their positions in its part of a vector.
    """

    def __init__(self, like: Vec, rows: Ints) -> None:
        """
        Args:
            like: a vector of the layout of those to be read and written.
            rows: (m,) global numbers, in any order; each rank may ask for its own.
        """
        self.rows = np.asarray(rows, PETSc.IntType)
        index = PETSc.IS().createGeneral(self.rows, comm=PETSc.COMM_SELF)
        self._target = PETSc.Vec().createSeq(len(self.rows))
        self._scatter = PETSc.Scatter().create(like, index, self._target, None)
        low, high = like.getOwnershipRange()
        self.mine = np.flatnonzero((self.rows >= low) & (self.rows < high))
        self.local = self.rows[self.mine] - low

    def read(self, vector: Vec) -> Array:
        """Entries (m,) of a distributed vector; collective."""
        self._scatter.scatter(vector, self._target, addv=PETSc.InsertMode.INSERT_VALUES)
        return np.array(self._target.array)

    def write(self, vector: Vec, values: Array) -> None:
        """Set the entries to `values` (m,). Each rank sets those it owns, without communication."""
        vector.array[self.local] = np.asarray(values)[self.mine]

    def add(self, vector: Vec, values: Array) -> None:
        """Add `values` (m,) to the entries. Each rank adds to those it owns; repeated rows add up."""
        np.add.at(vector.array, self.local, np.asarray(values)[self.mine])


def distributed(whole: Sparse, rows: Vec, columns: Vec) -> Mat:
    """The PETSc matrix; each rank keeps its own rows.

    Args:
        whole: (m, n).
        rows: a vector with the layout of the rows.
        columns: a vector with the layout of the columns.
    """
    low, high = rows.getOwnershipRange()
    own = whole.tocsr()[low:high]
    sizes = (rows.getLocalSize(), rows.getSize()), (columns.getLocalSize(), columns.getSize())
    return from_rows(own, sizes, columns.comm)


def from_rows(own: Sparse, sizes: tuple[object, object], comm: Comm, bsize: int | None = None) -> Mat:
    """The PETSc matrix of which each rank gives its own rows, as a csr matrix; collective.

    Args:
        sizes, bsize: of the matrix, and of its blocks, as PETSc takes them.
    """
    csr = own.indptr.astype(PETSc.IntType), own.indices.astype(PETSc.IntType), own.data
    matrix = PETSc.Mat().createAIJ(sizes, bsize=bsize, csr=csr, comm=comm)
    matrix.assemble()
    return matrix
