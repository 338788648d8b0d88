"""Chosen entries of a distributed vector, the same on every rank."""

from __future__ import annotations

from typing import Any

import numpy as np
from petsc4py import PETSc

from geometry.arrays import Array, Ints


class Replicated:
    """Read and write entries `rows` (global numbers, any order) of vectors laid out like `like`.

    `mine` says which of the rows this rank owns, `local` where they stand in its part of a vector.
    """

    def __init__(self, like: Any, rows: Ints) -> None:
        self.rows = np.asarray(rows, PETSc.IntType)
        index = PETSc.IS().createGeneral(self.rows, comm=PETSc.COMM_SELF)
        self._target = PETSc.Vec().createSeq(len(self.rows))
        self._scatter = PETSc.Scatter().create(like, index, self._target, None)
        low, high = like.getOwnershipRange()
        self.mine = np.flatnonzero((self.rows >= low) & (self.rows < high))
        self.local = self.rows[self.mine] - low

    def read(self, vector: Any) -> Array:
        """Entries (m,) of a distributed vector; collective."""
        self._scatter.scatter(vector, self._target, addv=PETSc.InsertMode.INSERT_VALUES)
        return np.array(self._target.array)

    def write(self, vector: Any, values: Array) -> None:
        """Set the entries; each rank its own, no communication."""
        vector.array[self.local] = np.asarray(values)[self.mine]

    def add(self, vector: Any, values: Array) -> None:
        """Add to the entries; each rank its own. Repeated rows add up."""
        np.add.at(vector.array, self.local, np.asarray(values)[self.mine])
