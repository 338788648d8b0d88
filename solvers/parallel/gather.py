"""Values that the ranks own, brought together on rank 0 in the order of the gmsh model, and given back."""

from __future__ import annotations

from typing import Any

import numpy as np

from geometry.arrays import AnyArray, Ints
from geometry.mesh.mesh import Mesh
from geometry.mesh.nodes import Nodes


class Gather:
    """Called with an array (own, ...) it returns (all, ...) on rank 0, and nothing, (0, ...), elsewhere; collective."""

    def __init__(self, comm: Any, numbers: Ints) -> None:
        """Take the numbers (own,) in the gmsh model of what this rank owns."""
        self._comm = comm
        self._counts = np.array(comm.allgather(len(numbers)))
        every = self._together(np.asarray(numbers, np.int64))
        self._order = np.argsort(every)
        self.numbers = every  # (all,) of the gmsh model, as the ranks own them; on rank 0, nothing elsewhere

    def __call__(self, values: AnyArray) -> AnyArray:
        return np.asarray(self._together(values)[self._order])

    def scatter(self, values: AnyArray) -> AnyArray:
        """What this rank owns (own, ...) of values (all, ...) on rank 0, (0, ...) elsewhere; collective."""
        every = np.empty_like(values)
        every[self._order] = values
        if self._comm.size == 1:
            return every
        width = int(np.prod(values.shape[1:], initial=1))
        own = np.empty((self._counts[self._comm.rank], *values.shape[1:]), values.dtype)
        self._comm.Scatterv((every, self._counts * width), own)
        return own

    def _together(self, values: AnyArray) -> AnyArray:
        if self._comm.size == 1:
            return values
        own = np.ascontiguousarray(values)
        width = int(np.prod(own.shape[1:], initial=1))
        every = np.empty((self._counts.sum() if self._comm.rank == 0 else 0, *own.shape[1:]), own.dtype)
        self._comm.Gatherv(own, (every, self._counts * width))
        return every


def nodes_of(mesh: Mesh, nodes: Nodes) -> Gather:
    """For values at owned nodes."""
    return Gather(mesh.comm, nodes.input[: nodes.owned])


def cells_of(mesh: Mesh) -> Gather:
    """For values at owned cells."""
    own = mesh.domain.topology.index_map(mesh.dim).size_local
    return Gather(mesh.comm, np.asarray(mesh.domain.topology.original_cell_index)[:own])
