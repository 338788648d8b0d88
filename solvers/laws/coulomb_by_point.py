"""Coulomb's law with a coefficient of friction for each point: discrete problems and laws by slip have them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.errors import require
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw


@dataclass(frozen=True, kw_only=True)
class CoulombByPoint(FrictionLaw):
    """Coulomb's law, s = mu p_n with mu by point; no scene asks for it, because it has no name there."""

    mu: Array  # (m_t,) [-]
    most: Array | None = None  # (m_t,) that mu can become by slip [-]; None: it is constant

    def __post_init__(self) -> None:
        super().__post_init__()
        least = float(self.mu.min(initial=0.0))
        require(least >= 0, "mu", least, "must not be negative")

    def resists(self) -> bool:
        return bool((self.mu > 0).any())

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        pressure = average @ p
        assert len(pressure) == len(self.mu), "all points of the contact at once"
        return np.asarray(self.mu * np.maximum(pressure, 0.0))

    def limit_slope(self, p: Array, average: Sparse, normal: NormalLaw) -> Sparse:
        return average.multiply(np.where(average @ p > 0, self.mu, 0.0)[:, None]).tocsr()

    def of_point(self, point: int) -> FrictionLaw:
        return Coulomb(mu=float(self.mu[point]), k_T=self.k_T)

    def of_points(self, points: Ints) -> FrictionLaw:
        return replace(self, mu=self.mu[points], most=None if self.most is None else self.most[points])

    def homogeneous(self, normal: NormalLaw, time: float, end: float) -> bool:
        return True

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        most = self.mu if self.most is None else self.most
        return np.inf, float(self.mu.min(initial=np.inf)), float(most.max(initial=0.0))
