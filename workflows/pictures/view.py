"""A view is what a picture shows of space: a window in a plane, to scale, and a second one where a contact is small."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip.geometry.arrays import Array, Bools

Image = NDArray[np.uint8]  # (rows, columns, 3)
FEW_CELLS = 6000  # largest number of cells whose edges are drawn


@dataclass(frozen=True)
class View:
    """A window: coordinates `right` · x and `up` · x between `low` and `high` [m]."""

    right: Array  # (3,)
    up: Array  # (3,)
    low: Array  # (2,)
    high: Array  # (2,)

    @property
    def size(self) -> Array:
        return self.high - self.low

    @property
    def aspect(self) -> float:
        return float(self.size[0] / self.size[1])

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom, top, as matplotlib wants them."""
        return (float(self.low[0]), float(self.high[0]), float(self.low[1]), float(self.high[1]))

    @staticmethod
    def facing(points: Array, horizontal: int = 0, vertical: int = 1) -> View:
        """View along an axis: the other two of x, y, z (numbers 0, 1, 2) are in the plane of the picture."""
        return View.around(points, np.eye(3)[horizontal], np.eye(3)[vertical])

    @staticmethod
    def isometric(points: Array) -> View:
        """View from the front, right and above; z is up."""
        back = np.array([1.0, -1.3, 0.9])
        back /= np.linalg.norm(back)
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        return View.around(points, right, np.cross(back, right))

    @staticmethod
    def around(points: Array, right: Array, up: Array) -> View:
        """The window that shows all points (n, 3) [m] with a margin."""
        seen = points @ np.column_stack([right, up])
        low, high = seen.min(axis=0), seen.max(axis=0)
        longer = float((high - low).max()) or 1.0
        half = (high - low) / 2 + 0.04 * longer
        half = np.maximum(half, half.max() / 6)  # slimmer bodies get empty space around them
        centre = (low + high) / 2
        return View(right, up, centre - half, centre + half)


def focus(points: Array, touching: Bools) -> Bools:
    """Which of the points (n, d) to show: all, unless the touching ones (n,) fill less than half of the whole.

    Then it is these, with half their size on every side.

    >>> line = np.arange(10.0)[:, None]
    >>> focus(line, (line[:, 0] > 2) & (line[:, 0] < 6)).nonzero()[0]
    array([2, 3, 4, 5, 6])
    """
    everything = np.ones(len(points), bool)
    if not touching.any():
        return everything
    low, high = points[touching].min(axis=0), points[touching].max(axis=0)
    size = float((high - low).max())
    if size == 0 or size >= float(np.ptp(points, axis=0).max()) / 2:
        return everything
    return np.asarray(np.all((points >= low - size / 2) & (points <= high + size / 2), axis=1))


def close_up(view: View, touching: Array) -> View | None:
    """A square window on the contact points (k, 3) [m], if they fill less than a quarter of the view; else None."""
    seen = touching @ np.column_stack([view.right, view.up])
    size = float(np.ptp(seen, axis=0).max()) if len(seen) else 0.0
    if not 0 < size < float(view.size.max()) / 4:
        return None
    centre = (seen.min(axis=0) + seen.max(axis=0)) / 2
    return View(view.right, view.up, centre - size, centre + size)
