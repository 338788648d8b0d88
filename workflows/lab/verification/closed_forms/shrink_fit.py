"""A ring pressed into another one, in plane strain: Lamé's closed form, with a compliant interface too."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from scipy.optimize import brentq

INNER, JOINT, OUTER = 1.0, 2.0, 3.0  # radii [m]
INTERFERENCE = 1e-3  # [m]
COMPLIANT = {(1e5, 1.0): 13.1118881, (1e8, 2.0): 10.2574554}  # (c_n [Pa/m^m], m): tabulated p [Pa]


@dataclass(frozen=True, kw_only=True)
class RingMaterial:
    """Elastic constants."""

    E: float  # [Pa]
    nu: float  # [-]


SHAFT, HUB = RingMaterial(E=2e5, nu=0.3), RingMaterial(E=1e5, nu=0.25)


@dataclass(frozen=True, kw_only=True)
class Fit:
    """State of the interface."""

    p: float  # [Pa]
    u_in: float  # radial displacement of the inner ring there [m]
    u_out: float  # of the outer ring [m]


def give(material: RingMaterial, at: float, free: float) -> float:
    """Radial displacement away from a pressure of 1 Pa on the circle `at`, the circle `free` being free [m/Pa].

    Source: Timoshenko & Goodier, Theory of Elasticity, § 28, with E / (1 - nu^2) and nu / (1 - nu) for plane strain.

    >>> give(RingMaterial(E=1.0, nu=0.0), at=1.0, free=1e9)  # a hole in a plane: (1 + nu) r / E
    1.0
    """
    return (1 + material.nu) / material.E * at * ((1 - 2 * material.nu) * at**2 + free**2) / abs(free**2 - at**2)


def fit(interference: float = INTERFERENCE, c_n: float = inf, m: float = 1.0) -> Fit:
    """Pressure at which rings and interface together deform by the interference.

    p = c_n d^m on the remaining overlap d; without compliance d = 0.
    """
    inner, outer = give(SHAFT, JOINT, INNER), give(HUB, JOINT, OUTER)
    rigid = interference / (inner + outer)
    p = rigid if c_n == inf else brentq(
        lambda p: p * (inner + outer) + (p / c_n) ** (1 / m) - interference, 0.0, rigid, xtol=1e-15 * rigid, rtol=1e-15
    )  # fmt: skip
    return Fit(p=p, u_in=-p * inner, u_out=p * outer)


def drawn_too_large(interference: float = INTERFERENCE) -> tuple[float, Fit]:
    """Pressure on the outer ring, and the state of the inner one, whose outer radius is 2 m + interference.

    Both rings carry the same force on a sector, on circles of different radius.
    """
    at = JOINT + interference
    inner, outer = give(SHAFT, at, INNER), give(HUB, JOINT, OUTER) * at / JOINT
    p = interference / (inner + outer)
    return p * at / JOINT, Fit(p=p, u_in=-p * inner, u_out=p * outer)
