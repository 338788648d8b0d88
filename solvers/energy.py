"""Energy balance: external work = stored + contact work, summed over the accepted steps (trapezoid)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Energy:
    """Totals since t = 0 [J], per metre of thickness in plane models."""

    external: float  # loads, supports and obstacle motion
    stored: float  # elastic energy of the bodies
    contact: float  # work of the contact tractions on the relative displacement
    compliance: float  # energy stored in the contacts' laws: normal compliance, and k_T
    dissipation: Array  # (contacts,) by friction, end-of-step rule

    @property
    def dissipated(self) -> float:
        return float(self.dissipation.sum())

    @property
    def time_remainder(self) -> float:
        """Contact work that neither compliance nor dissipation explains.

        First order in the step, but for the work of closing an initial interference, which no step size removes.
        """
        return self.contact - self.compliance - self.dissipated
