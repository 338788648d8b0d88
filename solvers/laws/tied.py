"""Tied contact: the surface moves with the obstacle in every direction, from its initial position on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.keys import Key
from stickslip.solvers.laws.law import NormalLaw


@dataclass(frozen=True, kw_only=True)
class Tied(NormalLaw):
    """u_n = gap_offset, u_T = 0: bilateral and without slip. The geometric gap is not closed."""

    sides: ClassVar[int] = 2
    ties: ClassVar[bool] = True
    law: Annotated[Literal["tied"], Key("-", "the law's name")] = "tied"

    def resolvent(self, p_hat: Array, gamma: Array) -> Array:
        return p_hat.copy()

    def stiffness(self, p: Array, p_hat: Array) -> Array:
        return np.full_like(p, np.inf)
