"""What a picture shows of space: a window in a plane, to scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stickslip.geometry.arrays import Array

Image = NDArray[np.uint8]  # (rows, columns, 3)
MARGIN = 0.04  # relative to the longer side of the view
FLATTEST = 6.0  # largest ratio of the view's sides; slimmer bodies get empty space around them


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
        half = (high - low) / 2 + MARGIN * longer
        half = np.maximum(half, half.max() / FLATTEST)
        centre = (low + high) / 2
        return View(right, up, centre - half, centre + half)
