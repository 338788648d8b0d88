"""A smooth field on the unit square that meets normal compliance and Coulomb slip exactly on its base y = 0.

Penetration d(x) > 0 and slip a(x) > 0 of the base are chosen, so that p = c_n d^m presses and sigma_xy = mu p opposes
the slip. These fix the field's values and its derivatives in y on the base,

    u_x = a,  u_y = -d,  du_x/dy = b = mu p / G + d',  du_y/dy = e = -(p + lambda a') / (lambda + 2 G),

and u_x = a(0) + (a - a(0)) (1 - y^2) + b y (1 - y), u_y = -d (1 - y^2) + e y (1 - y) continue them: the top moves by
a(0) as a rigid body, and u_x = a(0) on the left too, for d is chosen so that b(0) = 0. So supports can hold the top,
and the left side with the corner of the base.

d = (P / c_n)^(1/m) s with s(0) = 1: the pressure is P s^m. Written with operators alone: arrays of numbers and symbols
of UFL take the same path.

Source: derived here; tests differentiate it numerically.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

E, NU, MU = 10.0, 0.3, 0.4
G = E / (2 * (1 + NU))
LAMBDA = E * NU / ((1 + NU) * (1 - 2 * NU))
P = 0.05  # pressure at the left corner [Pa]
SLIP = 0.02  # a(0), of top and left side [m]
RATES = {1: (2, 1, 2), 2: (3, 2, 3)}  # by order: L2 norms of displacement, stress, pressure


@dataclass(frozen=True, kw_only=True)
class Manufactured:
    """The field of one law."""

    c_n: float  # [Pa/m^m]
    m: int

    @property
    def depth(self) -> float:
        """d(0) [m]."""
        return float((P / self.c_n) ** (1 / self.m))

    @property
    def fall(self) -> float:
        """-s'(0), so that b(0) = 0."""
        return MU * P / G / self.depth

    def shape(self, x: Any) -> Any:
        """s(x), from 1 to 1."""
        return 1 - self.fall * (x - x**2) + (x**2 - x**3) / 4

    def shape_slope(self, x: Any) -> Any:
        """ds/dx."""
        return -self.fall * (1 - 2 * x) + (2 * x - 3 * x**2) / 4

    def pressure(self, x: Any) -> Any:
        """p(x) [Pa]."""
        return P * self.shape(x) ** self.m

    def displacement(self, x: Any, y: Any) -> tuple[Any, Any]:
        """u(x, y) [m]."""
        more, slope = SLIP * (x - x**3) / 4, SLIP * (1 - 3 * x**2) / 4  # a - a(0), a'
        p = self.pressure(x)
        b = MU * p / G + self.depth * self.shape_slope(x)
        e = -(p + LAMBDA * slope) / (LAMBDA + 2 * G)
        across = SLIP + more * (1 - y**2) + b * y * (1 - y)
        return across, -self.depth * self.shape(x) * (1 - y**2) + e * y * (1 - y)


LAWS = (Manufactured(c_n=2.0, m=1), Manufactured(c_n=400.0, m=2), Manufactured(c_n=4e4, m=3))
