"""The part of a surface or of a view that a picture shows larger: the touching points, with a margin."""

from __future__ import annotations

import numpy as np

from stickslip.geometry.arrays import Array, Bools
from stickslip.workflows.pictures.view import View

SMALL = 0.5  # a touching part smaller than this, relative to the whole, is enlarged
TINY = 0.25  # relative to a view: a contact region smaller than this is also shown enlarged
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


def close_up(view: View, touching: Array) -> View | None:
    """A square window on the contact points (k, 3) [m], if they fill a small part of the view; else None."""
    seen = touching @ np.column_stack([view.right, view.up])
    size = float(np.ptp(seen, axis=0).max()) if len(seen) else 0.0
    if not 0 < size < TINY * float(view.size.max()):
        return None
    centre = (seen.min(axis=0) + seen.max(axis=0)) / 2
    return View(view.right, view.up, centre - (0.5 + ROOM) * size, centre + (0.5 + ROOM) * size)
