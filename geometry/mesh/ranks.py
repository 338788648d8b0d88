"""Rows that ranks hold, passed between them as buffers: no Python object is made of a node."""

from __future__ import annotations

import numpy as np

from stickslip.geometry.arrays import AnyArray, Ints
from stickslip.geometry.protocols import Comm


def of_all_ranks(comm: Comm, own: AnyArray) -> AnyArray:
    """The rows (own, ...) of all ranks on every rank, (all, ...) in the order of the ranks; collective."""
    if comm.size == 1:
        return own
    counts, width = _counts(comm, own)
    every = np.empty((counts.sum(), *own.shape[1:]), own.dtype)
    comm.Allgatherv(np.ascontiguousarray(own), (every, counts * width))
    return every


def from_rank_0(comm: Comm, numbers: Ints, values: Ints | None) -> Ints:
    """The entries `numbers` (own,) that each rank asks for, of values (all,) that rank 0 has; collective.

    Args:
        values: on rank 0; None elsewhere.
    """
    counts, _ = _counts(comm, numbers)
    asked = np.empty(counts.sum() if values is not None else 0, np.int64)
    comm.Gatherv(np.ascontiguousarray(numbers, np.int64), (asked, counts))
    found, answered = np.empty(len(numbers), np.int64), asked if values is None else values[asked]
    comm.Scatterv((np.ascontiguousarray(answered, np.int64), counts), found)
    return found


def _counts(comm: Comm, own: AnyArray) -> tuple[Ints, int]:
    """Number of rows of each rank, and of values in a row."""
    return np.array(comm.allgather(len(own)), np.int64), int(np.prod(own.shape[1:], initial=1))
