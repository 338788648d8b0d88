"""How far a substep may go: half as far after one that failed, twice as far after a few easy ones in a row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

HALVINGS = 8  # a step is cut to 1/256 before it is given up
ROUNDING = 1e-9
ENOUGH = 3  # easy substeps in a row: where each second one is hard, twice the size would fail again at once


@dataclass(frozen=True)
class Pace:
    """What the steps so far have taught; it goes on from one requested time to the next.

    >>> Pace().part(2.0, smallest=0.1), Pace(size=0.5).part(2.0, smallest=0.1)
    (2.0, 0.5)
    """

    size: float = np.inf  # largest substep that is worth a try [s]
    easy: int = 0  # substeps of that size that were easy, in a row

    def part(self, left: float, smallest: float) -> float:
        """Length of the next substep [s], of those that are left; no sliver remains at the end."""
        size = max(self.size, smallest)
        if left <= size * (1 + ROUNDING):
            return left
        return size if left > 2 * size * (1 - ROUNDING) else left / 2

    def failed(self, tried: float, smallest: float) -> Pace:
        """After a substep [s] that failed."""
        return Pace(max(tried / 2, smallest))

    def succeeded(self, tried: float, step: float, easy: bool) -> Pace:
        """After a substep [s] that was accepted, on the way through a step [s]."""
        if np.isinf(self.size) or (easy and tried <= self.size / 2):  # one so short proves nothing
            return self
        if not easy:
            return Pace(self.size)
        if self.easy + 1 < ENOUGH:
            return Pace(self.size, self.easy + 1)
        return Pace(2 * self.size) if 2 * self.size < step * (1 - ROUNDING) else Pace()
