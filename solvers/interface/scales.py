"""The scales of a load step: how large its motions and tractions are, and which of them are rounding.

They are made once a step, from the load without contact. Residual, balance, and starts ask them, and an answer is
judged relative to them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import CLOSE, LAST_DIGITS, ROUNDING, TINY, Array
from stickslip.geometry.errors import SceneError


@dataclass(frozen=True, kw_only=True)
class Scales:
    """Sizes of one step, and what is rounding beside them."""

    motion: float  # u_ref [m]: the largest that contact resists
    traction: float  # p_ref [Pa]: the mean pressure of the applied force, and at least what that motion causes
    given: Array  # (rows,) [m] the larger of gap and prescribed motion
    free: float = 0.0  # the largest motion without contact [m]

    def __post_init__(self) -> None:
        """
        Raises:
            SceneError: squares of motions, tractions or energies are 0 or infinite.
        """
        largest = max(self.motion, self.free)
        for size in (self.motion, self.traction, largest, self.motion * self.traction):
            if size and not TINY < size * size < 1 / TINY:
                raise SceneError(
                    f"motions of about {largest:.1g} and tractions of about {self.traction:.1g} leave the range of "
                    "numbers: their squares are 0 or infinite; check the units of E, loads and lengths"
                )

    def no_motion(self, w: Array) -> Array:
        """Return which motions (rows,) [m] are rounding: the last digits of those that are given and of w (rows,) [m].

        Bodies that have flown away do not count: their motions excuse nothing.
        """
        largest = max(self.motion, float(self.given.max(initial=0.0)))
        moved = min(float(np.abs(w).max(initial=0.0)), largest / ROUNDING)
        return LAST_DIGITS * np.maximum(self.given, moved)

    @property
    def no_traction(self) -> float:
        """Largest traction [Pa] that is a difference of far larger ones, and tells nothing."""
        return CLOSE * self.traction

    def of_tractions(self, p: Array) -> float:
        """Return what tractions p (rows,) [Pa] are judged relative to: the largest, or what is none beside the load."""
        return max(float(np.abs(p).max(initial=0.0)), self.no_traction)
