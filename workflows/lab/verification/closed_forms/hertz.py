"""Hertz contact of a rigid round body with a half-space, or of a round body with a rigid plane; no friction.

Lengths of the contact are small against the radius; E* = E / (1 - nu²) when the other body is rigid.

Source: Johnson, Contact Mechanics (1985), sections 3.4 and 4.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import Array


@dataclass(frozen=True, kw_only=True)
class Hertz:
    """A contact of half-width or radius a, with p = p0 sqrt(1 - (x / a)²)."""

    a: float  # [m]
    p0: float  # [Pa]

    def pressure(self, x: Array) -> Array:
        """Pressure [Pa] at a distance x [m] from the middle."""
        return np.asarray(self.p0 * np.sqrt(np.maximum(1 - (x / self.a) ** 2, 0.0)))


def plane_strain(E: float, nu: float) -> float:
    """E* [Pa].

    >>> plane_strain(1000.0, 0.5)
    1333.3333333333333
    """
    return E / (1 - nu**2)


def sphere(F: float, R: float, E_star: float) -> Hertz:
    """Pressed with F [N].

    >>> contact = sphere(60 * np.pi, 8.0, plane_strain(1000.0, 0.3))
    >>> round(contact.a, 6), round(contact.p0, 4)
    (1.009635, 88.2904)
    """
    a = (3 * F * R / (4 * E_star)) ** (1 / 3)
    return Hertz(a=float(a), p0=float(3 * F / (2 * np.pi * a**2)))


def approach(contact: Hertz, R: float) -> float:
    """By how much distant points of sphere and half-space come closer [m].

    >>> round(approach(sphere(60 * np.pi, 8.0, plane_strain(1000.0, 0.3)), 8.0), 6)
    0.12742
    """
    return contact.a**2 / R


def cylinder(P: float, R: float, E_star: float) -> Hertz:
    """Pressed with P per length [N/m].

    >>> contact = cylinder(np.pi, 1.0, 4.0)
    >>> contact.a, contact.p0
    (1.0, 2.0)
    """
    a = np.sqrt(4 * P * R / (np.pi * E_star))
    return Hertz(a=float(a), p0=float(2 * P / (np.pi * a)))
