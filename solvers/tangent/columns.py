"""Columns of the stiffness in contact coordinates: what a motion of a few nodes does to the bodies."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from stickslip.geometry.arrays import Array, Ints, inverses, products
from stickslip.geometry.protocols import Mat

POWER = 10  # iterations for the largest eigenvalue, which they miss by less than a tenth in the tests


class Columns:
    """Columns of K = T^T K_B T at some nodes, with those of its rows that have entries there.

    Vectors over these nodes are this rank's entries (k,), of all nodes its part (owned,).

    Attributes:
        at: positions (k,) of the nodes' coordinates in this rank's part of a vector, by node.
        near: positions of the entries of K v, of a v that is zero but there, that can be other than zero, by node.
        diagonal: blocks (k / d, d, d) of K.
    """

    def __init__(self, K_B: Mat, T: Mat, at: Ints) -> None:
        """Take them from the stiffness; collective.

        Args:
            K_B: (free, free).
            T: (free, free) the coordinates; those at these nodes move no others.
            at: positions (k,) of these nodes' coordinates.
        """
        self.at, self.dim = at, K_B.block_size
        (low, high), comm = K_B.getOwnershipRange(), K_B.comm
        here = PETSc.IS().createGeneral((at + low).astype(PETSc.IntType), comm=comm)
        every = PETSc.IS().createGeneral(np.arange(low, high, dtype=PETSc.IntType), comm=comm)
        rows = K_B.createSubMatrix(here, every).matMult(T)  # K_B is symmetric: its rows are found sooner than columns
        columns = T.createSubMatrix(here, here).transposeMatMult(rows).transpose(PETSc.Mat())
        nodes = np.unique(np.flatnonzero(np.diff(columns.getValuesCSR()[0])) // self.dim)
        self.near = (nodes[:, None] * self.dim + np.arange(self.dim)).ravel()
        near = PETSc.IS().createGeneral((self.near + low).astype(PETSc.IntType), comm=comm)
        self._columns = columns.createSubMatrix(near, None)
        self._block = columns.createSubMatrix(here, None)
        columns.destroy()
        self.diagonal = self._diagonal()
        self._motion, self._there = self._block.createVecs()
        self._near = self._columns.createVecLeft()

    def product(self, x: Array) -> Array:
        """K v at `near`, of a v that is x (k,) at these nodes, and zero elsewhere."""
        self._motion.array[:] = x
        self._columns.mult(self._motion, self._near)
        return self._near.array_r.copy()

    def block(self, x: Array) -> Array:
        """The same at these nodes alone (k,)."""
        self._motion.array[:] = x
        self._block.mult(self._motion, self._there)
        return self._there.array_r.copy()

    def whole(self, x: Array, count: int) -> Array:
        """The vector (count,) that is x (k,) at these nodes, and zero elsewhere."""
        found = np.zeros(count)
        found[self.at] = x
        return found

    def move(self, x: Array, v: Array, K_v: Array) -> None:
        """Add a motion x (k,) of these nodes to v (owned,), and what it does to K v; in place."""
        v[self.at] += x
        K_v[self.near] += self.product(x)

    def largest_eigenvalue(self) -> float:
        """Of these columns' block, times the inverses of the nodes' own blocks: about it, not above it; collective."""
        comm, inverse, value = self._block.comm.tompi4py(), inverses(self.diagonal), 0.0
        x = np.random.default_rng(comm.rank).normal(size=len(self.at))
        for _ in range(POWER):
            y = self.block(x)
            above, below = comm.allreduce(np.array([x @ y, x @ products(self.diagonal, x)]))
            value = above / below if below else 1.0
            x = products(inverse, y) / value
        return float(value)

    def _diagonal(self) -> Array:
        pointer, columns, values = self._block.getValuesCSR()
        low, dim = self._block.getOwnershipRange()[0], self.dim
        row = np.repeat(np.arange(len(pointer) - 1), np.diff(pointer))
        own = (columns - low) // dim == row // dim
        found = np.zeros((len(self.at) // dim, dim, dim))
        found[row[own] // dim, row[own] % dim, (columns[own] - low) % dim] = values[own]
        return found
