"""Cohesion and friction: s = a + mu p_n where the surfaces press."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw, touched


@dataclass(frozen=True, kw_only=True)
class Cohesion(FrictionLaw):
    """s = a + mu p_n where p_n > 0, or everywhere if the normal law is bilateral; a does not hold surfaces together.

    Source: Coulomb, Mém. Math. Phys. Acad. Roy. Sci. 7 (1776), of masonry and soil: the law of Mohr and Coulomb.
    """

    continuous: ClassVar = "coulomb"
    a: Annotated[float, Key("Pa", "cohesion: the bound at no pressure")]
    mu: Annotated[float, Key("-", "coefficient of friction")]
    law: Annotated[Literal["cohesion"], Key("-", "the law's name")] = "cohesion"

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.a >= 0, "a", self.a, "must not be negative, in pascal")
        require(self.mu >= 0, "mu", self.mu, "must not be negative")

    def resists(self) -> bool:
        return self.a > 0 or self.mu > 0

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        """a + mu p_n (m_t,) [Pa] where the surfaces press.

        >>> from scipy import sparse
        >>> from stickslip.solvers.laws.unilateral import Unilateral
        >>> law, one = Cohesion(a=2.0, mu=0.5), sparse.identity(3, format="csr")
        >>> law.limit(np.array([-1.0, 0.0, 4.0]), one, Unilateral(), 1.0, 1.0)
        array([0., 0., 4.])
        """
        return np.asarray(self.a * touched(p, average, normal) + self.mu * np.maximum(average @ p, 0.0))

    def limit_slope(self, p: Array, average: Sparse, normal: NormalLaw) -> Sparse:
        return average.multiply(np.where(average @ p > 0, self.mu, 0.0)[:, None]).tocsr()

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        return np.inf, self.mu, self.mu

    @property
    def at_no_pressure(self) -> float:
        return self.a
