"""The part of a contact surface that a picture shows: the touching points, with a margin."""

from __future__ import annotations

import numpy as np

from stickslip.geometry.arrays import Array, Bools

SMALL = 0.5  # a touching part smaller than this, relative to the whole, is enlarged
ROOM = 0.5  # margin on every side, relative to the size of the touching part


def focus(points: Array, touching: Bools) -> Bools:
    """Which of the points (n, d) to show: all, unless the touching ones (n,) fill a small part of the whole.

    >>> line = np.arange(10.0)[:, None]
    >>> focus(line, (line[:, 0] > 2) & (line[:, 0] < 6)).nonzero()[0]
    array([2, 3, 4, 5, 6])
    """
    everything = np.ones(len(points), bool)
    if not touching.any():
        return everything
    low, high = points[touching].min(axis=0), points[touching].max(axis=0)
    size = float((high - low).max())
    if size == 0 or size >= SMALL * float(np.ptp(points, axis=0).max()):
        return everything
    return np.asarray(np.all((points >= low - ROOM * size) & (points <= high + ROOM * size), axis=1))
