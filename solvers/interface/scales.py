"""The scales of a load step: how large its motions and tractions are, and which of them are rounding.

They are made once a step, from the load without contact. Residual, balance, and starts ask them; an answer is judged
relative to them, and nothing else in a step says what is zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import CLOSE, LAST_DIGITS, Array


@dataclass(frozen=True, kw_only=True)
class Scales:
    """Sizes of one step, and what is rounding beside them."""

    motion: float  # u_ref [m]: the largest that contact resists
    traction: float  # p_ref [Pa]: the mean pressure of the applied force, and at least what that motion causes
    moved: Array  # (rows,) [m] the largest of all: without contact anywhere, and the gap and prescribed motion there
    idle: bool  # whether bodies float and no load pushes them

    @property
    def no_motion(self) -> Array:
        """Largest relative displacements (rows,) [m] that are rounding: the last digits of the largest motion."""
        return LAST_DIGITS * self.moved

    @property
    def no_traction(self) -> float:
        """Largest traction [Pa] that is a difference of far larger ones, and tells nothing."""
        return CLOSE * self.traction

    def of_tractions(self, p: Array) -> float:
        """Return what tractions p (rows,) [Pa] are judged relative to: the largest, or what is none beside the load.

        Where nothing pushes bodies, what a stiff law makes of rounding is measured by what their motion would cause.
        """
        return max(float(np.abs(p).max(initial=0.0)), self.traction if self.idle else self.no_traction)

    def known(self, motion: Array) -> Array:
        """Return the part of motions (rows,) [m] that is no rounding."""
        return np.asarray(np.sign(motion) * np.maximum(np.abs(motion) - self.no_motion, 0.0))
