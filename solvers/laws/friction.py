"""Friction laws: the tangential traction is bounded, and opposes slip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.amplitude import Amplitude, check, value_at
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw, touched, touching


@dataclass(frozen=True, kw_only=True)
class Coulomb(FrictionLaw):
    """Coulomb's law, s = mu p_n."""

    mu: Annotated[float, Key("-", "coefficient of friction")]
    law: Annotated[Literal["coulomb"], Key("-", "the law's name")] = "coulomb"

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.mu >= 0, "mu", self.mu, "must not be negative")

    def resists(self) -> bool:
        return self.mu > 0

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        return np.asarray(self.mu * np.maximum(average @ p, 0.0))

    def limit_slope(self, p: Array, average: Sparse, normal: NormalLaw) -> Sparse:
        slope = average.copy()
        slope.data *= np.repeat(np.where(average @ p > 0, self.mu, 0.0), np.diff(average.indptr))
        return slope

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        return np.inf, self.mu, self.mu


@dataclass(frozen=True, kw_only=True)
class Tresca(FrictionLaw):
    """Tresca's law: s is given, where p_n > 0, or everywhere if the normal law is bilateral."""

    continuous: ClassVar = "capped_coulomb"
    bound: Annotated[Amplitude, Key("Pa", "bound of the tangential traction, in time")]
    law: Annotated[Literal["tresca"], Key("-", "the law's name")] = "tresca"

    def __post_init__(self) -> None:
        super().__post_init__()
        check(self.bound, "bound")
        values = [self.bound] if isinstance(self.bound, float | int) else [v for _, v in self.bound]
        require(min(values) >= 0, "bound", min(values), "must not be negative, in pascal")

    def resists(self) -> bool:
        return any(value for _, value in ([(0.0, self.bound)] if isinstance(self.bound, float | int) else self.bound))

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        return value_at(self.bound, time, end) * touched(p, average, normal)

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        return value_at(self.bound, time, end), np.inf, np.inf

    def amplitudes(self) -> Mapping[str, Amplitude]:
        return {"bound": self.bound}


@dataclass(frozen=True, kw_only=True)
class Stick(FrictionLaw):
    """No slip where the surfaces touch: the bound is infinite.

    With a growing coefficient of Coulomb's law a point that lifts can keep its traction while its pressure goes to
    zero, as 1 / mu: with unilateral contact there is no solution then.
    """

    continuous: ClassVar = "coulomb"
    law: Annotated[Literal["stick"], Key("-", "the law's name")] = "stick"

    def limit(self, p: Array, average: Sparse | Array, normal: NormalLaw, time: float, end: float) -> Array:
        return np.where(touching(p, average, normal), np.inf, 0.0)

    def lines(self, normal: NormalLaw, time: float, end: float) -> tuple[float, float, float]:
        return np.inf, np.inf, np.inf
