"""A smooth field on the unit square that meets normal compliance and Coulomb slip exactly on its base y = 0.

Penetration d(x) > 0 and slip a(x) > 0 of the base are chosen, so that p = c_n d^m presses and sigma_xy = mu p opposes
the slip. These fix the field's values and its derivatives in y on the base,

    u_x = a,  u_y = -d,  du_x/dy = mu p / G + d',  du_y/dy = -(p + lambda a') / (lambda + 2 G),

and 1 - y^2 and y (1 - y) continue them to a top that does not move. d = (P / c_n)^(1/m) s with the same shape s for all
laws: the pressure is P s^m. Written with operators alone: arrays of numbers and symbols of UFL take the same path.

Source: derived here; tests differentiate it numerically.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

E, NU, MU = 10.0, 0.3, 0.4
G = E / (2 * (1 + NU))
LAMBDA = E * NU / ((1 + NU) * (1 - 2 * NU))
P = 1.0  # pressure where s = 1 [Pa]
RATES = {1: (2, 1, 2), 2: (3, 2, 3)}  # by order: L2 norms of displacement, stress, pressure


@dataclass(frozen=True, kw_only=True)
class Manufactured:
    """The field of one law."""

    c_n: float  # [Pa/m^m]
    m: int

    def pressure(self, x: Any) -> Any:
        """p(x) [Pa]."""
        return P * shape(x) ** self.m

    def displacement(self, x: Any, y: Any) -> tuple[Any, Any]:
        """u(x, y) [m]."""
        deep, p = (P / self.c_n) ** (1 / self.m), self.pressure(x)
        a, slope = 0.1 * (1 + (x - x**3) / 4), 0.1 * (1 - 3 * x**2) / 4
        b = MU * p / G + deep * shape_slope(x)
        e = -(p + LAMBDA * slope) / (LAMBDA + 2 * G)
        return a * (1 - y**2) + b * y * (1 - y), -deep * shape(x) * (1 - y**2) + e * y * (1 - y)


def shape(x: Any) -> Any:
    """s(x), between 1 and 1.08."""
    return 1 + (x + x**2 - 2 * x**3) / 8


def shape_slope(x: Any) -> Any:
    """ds/dx."""
    return (1 + 2 * x - 6 * x**2) / 8


LAWS = (Manufactured(c_n=2.0, m=1), Manufactured(c_n=400.0, m=2), Manufactured(c_n=4e4, m=3))
