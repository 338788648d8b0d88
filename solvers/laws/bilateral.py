"""Bilateral contact: the surface neither lifts off nor penetrates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.keys import Key
from stickslip.solvers.laws.law import NormalLaw


@dataclass(frozen=True, kw_only=True)
class Bilateral(NormalLaw):
    """u_n = g; the pressure p_n may have either sign."""

    sides: ClassVar[int] = 2
    law: Annotated[Literal["bilateral"], Key("-", "the law's name")] = "bilateral"

    def resolvent(self, p_hat: Array, gamma: Array) -> Array:
        return p_hat.copy()

    def stiffness(self, p: Array, p_hat: Array) -> Array:
        return np.full_like(p, np.inf)
