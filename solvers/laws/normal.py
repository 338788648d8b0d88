"""Normal laws: bilateral, compliance by a power of the penetration, tied, unilateral (Signorini); without a penalty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.arrays import EPS, Array
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.solvers.laws.law import NormalLaw

NEWTON_STEPS = 200  # never reached, as a test shows: Newton's method converges quadratically from the right


@dataclass(frozen=True, kw_only=True)
class Bilateral(NormalLaw):
    """u_n = g; the pressure p_n may have either sign."""

    sides: ClassVar[int] = 2
    law: Annotated[Literal["bilateral"], Key("-", "the law's name")] = "bilateral"

    def resolvent(self, p_hat: Array, gamma: Array) -> Array:
        return p_hat.copy()

    def stiffness(self, p: Array, p_hat: Array) -> Array:
        return np.full_like(p, np.inf)


@dataclass(frozen=True, kw_only=True)
class Compliance(NormalLaw):
    """p_n = c_n (u_n - g)_+^m_n, at quadrature points as in the form j_n.

    Where it is stiffer than the cells behind a curved side, or one whose mesh does not match, it acts at nodes, on
    means of u_n - g as those of multipliers: however stiff it is, it then gives what rigid surfaces do.

    Source: Pop (1999), section 2, j_n.
    """

    at_quadrature: ClassVar[bool] = True
    c_n: Annotated[float, Key("Pa/m^m_n", "stiffness of the surface")]
    m_n: Annotated[float, Key("-", "exponent, at least 1")] = 1.0
    law: Annotated[Literal["compliance"], Key("-", "the law's name")] = "compliance"

    def __post_init__(self) -> None:
        require(self.c_n > 0, "c_n", self.c_n, "must be positive, in Pa/m^m_n")
        require(self.m_n >= 1, "m_n", self.m_n, "must be at least 1")

    @property
    def power(self) -> float:
        return self.m_n

    def degree(self, order: int) -> int:
        return order + int(np.ceil(self.m_n * order))

    def pressure(self, penetration: Array) -> Array:
        """Pressure (m,) [Pa] at a penetration u_n - g (m,) [m]."""
        return np.asarray(self.c_n * np.maximum(penetration, 0.0) ** self.m_n)

    def penetration(self, p: Array) -> Array:
        """Penetration (m,) [m] at a pressure p (m,) [Pa].

        >>> Compliance(c_n=4.0, m_n=2.0).penetration(np.array([0.0, 1.0]))
        array([0. , 0.5])
        """
        return np.asarray((np.maximum(p, 0.0) / self.c_n) ** (1 / self.m_n))

    def resolvent(self, p_hat: Array, gamma: Array) -> Array:
        """Pressure p (m,) [Pa] with p + gamma (p/c_n)^(1/m_n) = max(0, p_hat), by Newton's method for the penetration.

        c d^m + gamma d is convex in the penetration d, so Newton's method converges monotonically from the right.

        >>> Compliance(c_n=1.0, m_n=2.0).resolvent(np.array([-1.0, 6.0]), np.ones(2))
        array([0., 4.])
        """
        target = np.maximum(p_hat, 0.0)
        if self.m_n == 1:
            return np.asarray(target * (self.c_n / (self.c_n + gamma)))
        d = np.minimum(target / gamma, (target / self.c_n) ** (1 / self.m_n))  # both are at least the root
        for _ in range(NEWTON_STEPS):
            excess = self.c_n * d**self.m_n + gamma * d - target
            step = excess / (self.c_n * self.m_n * d ** (self.m_n - 1) + gamma)
            d = np.maximum(d - step, 0.0)
            if np.all(np.abs(step) <= 2 * EPS * d):
                break
        return np.asarray(self.c_n * d**self.m_n)

    def stiffness(self, p: Array, p_hat: Array) -> Array:
        slope = self.c_n * self.m_n * self.penetration(p) ** (self.m_n - 1)
        return np.where(p_hat > 0, slope, 0.0)

    def energy(self, p: Array) -> Array:
        return np.asarray(p * self.penetration(p) / (self.m_n + 1))


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
