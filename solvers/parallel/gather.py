"""Gather values of all ranks on rank 0, in the order of the gmsh model, and scatter them back to their owners.

Values pass rank by rank: beside the result, rank 0 needs memory for the share of one rank only.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from stickslip.geometry.arrays import AnyArray, Ints
from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.mesh.nodes import Nodes
from stickslip.geometry.protocols import Comm

TAG = 7402  # of its messages: that by which a rank says that it ends is not one of them


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
        self._comm, self._own = comm, len(numbers)
        ends = np.cumsum([0, *comm.allgather(len(numbers))])
        self._shares = [slice(*pair) for pair in pairwise(ends.tolist())]
        self._places = np.arange(ends[-1])  # of rows in the order of the ranks, in the order of the gmsh model
        every = self(np.asarray(numbers, np.int64))
        self._places[np.argsort(every)] = np.arange(len(every))
        self.numbers = every  # on rank 0 (all,), in the order of the ranks; elsewhere (0,)
        if comm.rank:
            self._places = self._places[:0]

    def __call__(self, values: AnyArray) -> AnyArray:
        """Gather.

        Args:
            values: (own, ...) of this rank.

        Returns:
            (all, ...) in the order of the gmsh model on rank 0; (0, ...) elsewhere.
        """
        own = np.ascontiguousarray(values)
        if self._comm.rank:
            self._comm.Send(own, 0, TAG)
            return np.empty((0, *own.shape[1:]), own.dtype)
        every = np.empty((self._shares[-1].stop, *own.shape[1:]), own.dtype)
        for rank, share in enumerate(self._shares):
            if rank:
                own = np.empty((share.stop - share.start, *own.shape[1:]), own.dtype)
                self._comm.Recv(own, rank, TAG)
            every[self._places[share]] = own
        return every

    def scatter(self, values: AnyArray) -> AnyArray:
        """Scatter: the inverse of the gather.

        Args:
            values: (all, ...) in the order of the gmsh model on rank 0; (0, ...) elsewhere.

        Returns:
            (own, ...) of this rank.
        """
        if self._comm.rank:
            found = np.empty((self._own, *values.shape[1:]), values.dtype)
            self._comm.Recv(found, 0, TAG)
            return found
        for rank, share in enumerate(self._shares[1:], 1):
            self._comm.Send(values[self._places[share]], rank, TAG)
        return np.asarray(values[self._places[self._shares[0]]])


def nodes_of(mesh: Mesh, nodes: Nodes) -> Gather:
    """Gather of values at the nodes that each rank owns; collective."""
    return Gather(mesh.comm, nodes.input[: nodes.owned])


def cells_of(mesh: Mesh) -> Gather:
    """Gather of values in the cells that each rank owns; collective."""
    own = mesh.domain.topology.index_map(mesh.dim).size_local
    return Gather(mesh.comm, np.asarray(mesh.domain.topology.original_cell_index)[:own])
