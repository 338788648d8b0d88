"""Gather values of all ranks on rank 0, in the order of the gmsh model, and scatter them back to their owners."""

from __future__ import annotations

import numpy as np

from stickslip.geometry.arrays import AnyArray, Ints
from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.mesh.nodes import Nodes
from stickslip.geometry.protocols import Comm


class Gather:
    """Gather of arrays whose rows the ranks own; its inverse is `scatter`. All calls are collective.

    `own` is the number of rows of this rank, `all` that of all ranks together.
    """

    def __init__(self, comm: Comm, numbers: Ints) -> None:
        """
        Args:
            comm: mpi4py communicator.
            numbers: (own,) numbers in the gmsh model of the rows that this rank owns.
        """
        self._comm = comm
        self._counts = np.array(comm.allgather(len(numbers)))
        every = self._gathered(np.asarray(numbers, np.int64))
        self._order = np.argsort(every)
        self.numbers = every  # on rank 0 (all,), in the order of the ranks; elsewhere (0,)

    def __call__(self, values: AnyArray) -> AnyArray:
        """Gather.

        Args:
            values: (own, ...) of this rank.

        Returns:
            (all, ...) in the order of the gmsh model on rank 0; (0, ...) elsewhere.
        """
        return np.asarray(self._gathered(values)[self._order])

    def scatter(self, values: AnyArray) -> AnyArray:
        """Scatter: the inverse of the gather.

        Args:
            values: (all, ...) in the order of the gmsh model on rank 0; (0, ...) elsewhere.

        Returns:
            (own, ...) of this rank.
        """
        every = np.empty_like(values)
        every[self._order] = values
        if self._comm.size == 1:
            return every
        width = int(np.prod(values.shape[1:], initial=1))
        own = np.empty((self._counts[self._comm.rank], *values.shape[1:]), values.dtype)
        self._comm.Scatterv((every, self._counts * width), own)
        return own

    def _gathered(self, values: AnyArray) -> AnyArray:
        if self._comm.size == 1:
            return values
        own = np.ascontiguousarray(values)
        width = int(np.prod(own.shape[1:], initial=1))
        every = np.empty((self._counts.sum() if self._comm.rank == 0 else 0, *own.shape[1:]), own.dtype)
        self._comm.Gatherv(own, (every, self._counts * width))
        return every


def nodes_of(mesh: Mesh, nodes: Nodes) -> Gather:
    """Gather of values at the nodes that each rank owns; collective."""
    return Gather(mesh.comm, nodes.input[: nodes.owned])


def cells_of(mesh: Mesh) -> Gather:
    """Gather of values in the cells that each rank owns; collective."""
    own = mesh.domain.topology.index_map(mesh.dim).size_local
    return Gather(mesh.comm, np.asarray(mesh.domain.topology.original_cell_index)[:own])
