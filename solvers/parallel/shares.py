"""Shares of rows: each rank stores an equal part of the rows of matrices that are long and narrow."""

from __future__ import annotations

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.mesh.ranks import of_all_ranks
from stickslip.geometry.protocols import Comm

LEAST = 5000  # rows; with fewer, messages cost more than they save, and every rank has all rows


class Shares:
    """This rank's share of n rows. `own` is the slice of its rows; all other calls are collective.

    >>> from mpi4py import MPI
    >>> Shares(MPI.COMM_SELF, 3).own
    slice(0, 3, None)
    """

    def __init__(self, comm: Comm, rows: int) -> None:
        self._comm = comm if comm.size > 1 and rows >= LEAST else None
        ends = [0, rows] if self._comm is None else (rows * np.arange(comm.size + 1) // comm.size).tolist()
        rank = 0 if self._comm is None else comm.rank
        self.own = slice(ends[rank], ends[rank + 1])

    def sum(self, value: Array) -> Array:
        """Sum over the shares, the same on every rank."""
        return value if self._comm is None else self._comm.allreduce(value)

    def whole(self, own: Array) -> Array:
        """The rows (n, ...) of all shares on every rank, from this rank's."""
        return own if self._comm is None else of_all_ranks(self._comm, own)
