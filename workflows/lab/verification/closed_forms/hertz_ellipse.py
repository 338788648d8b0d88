"""Hertz contact of two elastic bodies whose gap is A x² + B y²: an elliptical area.

Source: Johnson, Contact Mechanics (1985), section 4.2, with (4.25), (4.26).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipk, elliprd

from stickslip.geometry.arrays import Array

SLIMMEST = 1e-6  # b / a that is looked for


@dataclass(frozen=True, kw_only=True)
class Ellipse:
    """A contact with p = p0 sqrt(1 - (x / a)² - (y / b)²)."""

    a: float  # larger half axis, along x [m]
    b: float  # [m]
    p0: float  # [Pa]
    approach: float  # of distant points [m]

    def pressure(self, x: Array, y: Array) -> Array:
        """Pressure (n,) [Pa] at places (n,) [m]."""
        return np.asarray(self.p0 * np.sqrt(np.maximum(1 - (x / self.a) ** 2 - (y / self.b) ** 2, 0.0)))


def contact_modulus(*materials: tuple[float, float]) -> float:
    """E* [Pa] of bodies with E [Pa] and nu: their compliances (1 - nu²) / E add up.

    >>> contact_modulus((2.0, 0.0), (2.0, 0.0))
    1.0
    """
    return 1 / sum((1 - nu**2) / E for E, nu in materials)


def ellipse(F: float, A: float, B: float, E_star: float) -> Ellipse:
    """Pressed with F [N]; A <= B [1/m].

    With k = b / a, and K, E the complete elliptic integrals of 1 - k², Johnson has A by (K - E) / (1 - k²) and B by
    (E / k² - K) / (1 - k²): these are Carlson's R_D(0, k², 1) / 3 and R_D(0, 1, k²) / 3, which do not cancel.

    >>> found = ellipse(60 * np.pi, 1 / 16, 1 / 16, 1000 / 0.91)  # the sphere of `hertz`
    >>> [round(value, 4) for value in (found.a, found.b, found.p0, found.approach)]
    [1.0096, 1.0096, 88.2904, 0.1274]
    """

    def ratio(k: float) -> float:
        return float(elliprd(0.0, 1.0, k**2) / elliprd(0.0, k**2, 1.0)) - B / A

    k = brentq(ratio, SLIMMEST, 1.0, xtol=1e-15, rtol=1e-14)
    a = float((F * elliprd(0.0, k**2, 1.0) / (2 * np.pi * E_star * A)) ** (1 / 3))
    b = k * a
    approach = 3 * F * float(ellipk(1 - k**2)) / (2 * np.pi * a * E_star)
    return Ellipse(a=a, b=b, p0=3 * F / (2 * np.pi * a * b), approach=approach)
