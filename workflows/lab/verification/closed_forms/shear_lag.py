"""Shear-lag strip: a bar pulled along a frictional bed slips from its end inwards; slip remains after unloading.

A bar of stiffness E A lies on a bed that carries a shear force of at most q per length. Its end is pulled with F, less
than q times its length. The bar force falls by q per length where it slips, so it slips over F / q, and the end moves
by F² / (2 E A q). When the force falls again by dF the shear changes by 2 q where it slips back: the same law at twice
the scale (Masing). Forces and works are per metre of thickness in plane models.

Source: equilibrium, derived here. FE was computed for this project by an independent program.
"""

from __future__ import annotations

from dataclasses import dataclass

LENGTH, HEIGHT = 1.0, 0.02  # [m]
E = 1000.0  # [Pa]; nu = 0
PRESSURE = 1.0  # on top [Pa]
BOUND = 0.5  # of the shear traction [Pa]
FORCE = 0.3  # of the end, out, in, out again [N/m]


@dataclass(frozen=True, kw_only=True)
class Strip:
    """A bar on a bed that resists by friction alone."""

    EA: float  # [N]
    q: float  # bound of the shear force per length [N/m]


STRIP = Strip(EA=E * HEIGHT, q=BOUND)


@dataclass(frozen=True, kw_only=True)
class Pull:
    """Result of a monotone change of the end's force."""

    displacement: float  # of the end, in the direction of the change [m]
    slip_length: float  # [m]
    dissipation: float  # [J]


@dataclass(frozen=True, kw_only=True)
class Computed:
    """Figures of another finite element program on 100 x 2 cells of this strip in plane strain."""

    pulled: float  # displacement of the end at FORCE [m]
    unloaded: float  # and back at 0 [m]
    loop: float  # dissipation from FORCE to -FORCE and back [J]
    pulled_coulomb: float  # with mu = BOUND / PRESSURE instead of a fixed bound [m]


FE = Computed(pulled=4.5029e-3, unloaded=2.2471e-3, loop=1.7965e-3, pulled_coulomb=4.428e-3)


def pulled(strip: Strip, F: float) -> Pull:
    """From an untouched strip; slip at x from the end is q (l - x)² / (2 E A) with l = F / q, and q times it is lost.

    >>> state = pulled(STRIP, 0.3)
    >>> round(state.displacement, 12), round(state.slip_length, 12), round(state.dissipation, 12)
    (0.0045, 0.6, 0.00045)
    """
    EA, q = strip.EA, strip.q
    return Pull(displacement=F**2 / (2 * EA * q), slip_length=F / q, dissipation=F**3 / (6 * EA * q))


def let_go(strip: Strip, dF: float) -> Pull:
    """Changes when the force then falls by dF, at most twice what it was.

    >>> round(let_go(STRIP, 0.3).slip_length, 12)
    0.3
    """
    half = pulled(strip, dF / 2)
    return Pull(displacement=2 * half.displacement, slip_length=half.slip_length, dissipation=2 * half.dissipation)


def with_coulomb(strip: Strip, F: float, mu: float, height: float) -> Pull:
    """Pulled at mid-height, friction at the base: each length of the bar is turned by the couple q height / 2.

    It is constant where the bar slips, so it is carried by a force q height / 2 on the bed at the pulled end, and one
    upwards where slip ends. There mu times as much friction takes that part of F at once; where it pushes (F < 0) the
    force is upwards at the end, and F is the larger.
    """
    return pulled(strip, abs(F - mu * strip.q * height / 2))
