"""Coulomb friction up to the shear strength of the surface: s = min(mu p_n, s_max)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw


@dataclass(frozen=True, kw_only=True)
class CappedCoulomb(FrictionLaw):
    """s = min(mu p_n, s_max): under high pressure the softer body shears before the surfaces slip on each other.

    Source: Orowan, Proc. Inst. Mech. Eng. 150 (1943), rolling: s_max is the yield stress in shear.
    """

    mu: Annotated[float, Key("-", "coefficient of friction")]
    s_max: Annotated[float, Key("Pa", "largest tangential traction, at any pressure")]
    law: Annotated[Literal["capped_coulomb"], Key("-", "the law's name")] = "capped_coulomb"

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.mu >= 0, "mu", self.mu, "must not be negative")
        require(self.s_max > 0, "s_max", self.s_max, "must be positive, in pascal; without friction set mu = 0")

    def resists(self) -> bool:
        return self.mu > 0

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        """min(mu p_n, s_max), (m_t,) [Pa].

        >>> from scipy import sparse
        >>> from stickslip.solvers.laws.unilateral import Unilateral
        >>> law, one = CappedCoulomb(mu=0.5, s_max=2.0), sparse.identity(3, format="csr")
        >>> law.limit(np.array([-1.0, 2.0, 10.0]), one, Unilateral(), 1.0, 1.0)
        array([0., 1., 2.])
        """
        return np.asarray(np.clip(self.mu * (average @ p), 0.0, self.s_max))

    def limit_slope(self, p: Array, average: Sparse, normal: NormalLaw) -> Sparse:
        uncapped = self.mu * (average @ p)
        slope = np.where((uncapped > 0) & (uncapped < self.s_max), self.mu, 0.0)
        return average.multiply(slope[:, None]).tocsr()

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        return self.s_max, self.mu, self.mu
