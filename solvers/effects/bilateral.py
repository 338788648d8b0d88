"""Bilateral contact: the surface neither lifts off nor penetrates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from geometry.keys import Key
from solvers.effects.effect import Effect
from solvers.effects.laws import Array, NormalLaw
from solvers.effects.reasons import contacts_with


@dataclass(frozen=True, kw_only=True)
class Bilateral(NormalLaw):
    """u_n = g; the pressure may pull."""

    sides: ClassVar[int] = 2
    law: Annotated[Literal["bilateral"], Key("-", "the law's name")] = "bilateral"

    def resolvent(self, p_hat: Array, gamma: Array) -> Array:
        return p_hat.copy()

    def stiffness(self, p: Array, p_hat: Array) -> Array:
        return np.full_like(p, np.inf)


EFFECT = Effect(name="bilateral", because=contacts_with(Bilateral, "normal"))
