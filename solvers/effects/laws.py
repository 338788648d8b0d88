"""What a contact law answers to a method: its resolvent, its slope, its bound. Pointwise, vectorised."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from geometry.amplitude import Amplitude
from geometry.keys import Choice

Array = NDArray[np.float64]


class NormalLaw(Choice):
    """Relation of contact pressure p_n [Pa] and penetration u_n - g [m].

    Methods meet it through the resolvent only: p* solves p + gamma (law's inverse)(p) = p_hat, where
    p_hat = p + gamma (u_n - g) for any gamma > 0 [Pa/m]. So a vertical branch needs no penalty number.
    """

    tag: ClassVar[str] = "law"
    sides: ClassVar[int] = 1  # 1: presses only, 2: holds in both directions
    at_quadrature: ClassVar[bool] = False  # pressure is a function of displacement, taken at facet quadrature points

    def degree(self, order: int) -> int:
        """Quadrature degree that the law needs on facets."""
        return 2 * order

    def resolvent(self, p_hat: Array, gamma: Array) -> Array:
        """Pressure p* (m,) [Pa]."""
        raise NotImplementedError

    def stiffness(self, p: Array, p_hat: Array) -> Array:
        """dp/d(penetration) (m,) [Pa/m] at p = resolvent(p_hat): 0 where open, inf where the law is rigid."""
        raise NotImplementedError

    def penetration(self, p: Array) -> Array:
        """Penetration (m,) [m] that goes with a pressure: the law's inverse."""
        return np.zeros_like(p)

    def energy(self, p: Array) -> Array:
        """Energy stored in the law at pressure p, per area (m,) [J/m²]."""
        return np.zeros_like(p)


class FrictionLaw(Choice):
    """Bound s [Pa] of the tangential traction, from the normal pressure at the same point."""

    tag: ClassVar[str] = "law"

    def resists(self) -> bool:
        """Whether it can hold a body at all."""
        return True

    def refuses(self, normal: NormalLaw) -> str | None:
        """Why this law cannot go with that normal law, or None."""
        return None

    def limit(self, p: Array, sides: int, time: float, end: float) -> Array:
        """Bound s (m,) [Pa] >= 0 from normal pressures p (m,) [Pa]."""
        raise NotImplementedError

    def limit_slope(self, p: Array) -> Array:
        """ds/dp (m,)."""
        return np.zeros_like(p)

    def amplitudes(self) -> tuple[Amplitude, ...]:
        """Values in time that the law contains."""
        return ()
