"""Unilateral contact (Signorini): pressure p_n >= 0, no penetration, no penalty parameter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.keys import Key
from stickslip.solvers.laws.law import NormalLaw


@dataclass(frozen=True, kw_only=True)
class Unilateral(NormalLaw):
    """p_n >= 0, u_n <= g, p_n (u_n - g) = 0."""

    law: Annotated[Literal["unilateral"], Key("-", "the law's name")] = "unilateral"

    def resolvent(self, p_hat: Array, gamma: Array) -> Array:
        """Pressure (m,) [Pa]: max(p_hat, 0), for every gamma.

        >>> Unilateral().resolvent(np.array([-1.0, 2.0]), np.ones(2))
        array([0., 2.])
        """
        return np.maximum(p_hat, 0.0)

    def stiffness(self, p: Array, p_hat: Array) -> Array:
        return np.where(p_hat > 0, np.inf, 0.0)
