"""Tangential compliance: the friction bound grows as a power of the penetration, s = c_T (u_n - g)_+^m_T."""

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
class TangentialCompliance(FrictionLaw):
    """s = c_T delta^m_T, delta [m] the penetration of the compliance law at the same point.

    Source: Pop (1999), section 2, j_T.
    """

    c_T: Annotated[float, Key("Pa/m^m_T", "friction bound at a penetration of 1 m")]
    m_T: Annotated[float, Key("-", "exponent, at least 1")] = 1.0
    law: Annotated[Literal["compliance"], Key("-", "the law's name")] = "compliance"

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.c_T >= 0, "c_T", self.c_T, "must not be negative, in Pa/m^m_T")
        require(self.m_T >= 1, "m_T", self.m_T, "must be at least 1")

    def degree(self, order: int) -> int:
        return order + int(np.ceil(self.m_T * order))

    def resists(self) -> bool:
        return self.c_T > 0

    def refuses(self, normal: NormalLaw) -> str | None:
        if normal.at_quadrature:
            return None
        return 'law = "compliance" bounds friction by the penetration, and needs normal = { law = "compliance", ... }'

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        return np.asarray(np.maximum(average @ self._pointwise(p, normal), 0.0))

    def limit_slope(self, p: Array, average: Sparse, normal: NormalLaw) -> Sparse:
        s = self._pointwise(p, normal)
        # ds/dp = (ds/d delta) / (dp/d delta): infinite at p = 0 if m_T < m_n; zero is used, as the point is open there
        stiffness = normal.stiffness(p, p)
        by_depth = self.c_T * self.m_T * normal.penetration(p) ** (self.m_T - 1)
        slope = np.divide(by_depth, stiffness, out=np.zeros_like(p), where=stiffness > 0)
        return average.multiply((average @ s > 0)[:, None]).multiply(slope[None, :]).tocsr()

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        if self.c_T > 0 and self.m_T != normal.power:
            return np.inf, 0.0, np.inf  # different powers have no bounding lines
        slope = float(self._pointwise(np.ones(1), normal)[0])
        return np.inf, slope, slope

    def _pointwise(self, p: Array, normal: NormalLaw) -> Array:
        return np.asarray(self.c_T * normal.penetration(p) ** self.m_T)
