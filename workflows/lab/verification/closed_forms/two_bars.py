"""Two bars end to end, held at their outer ends, that body forces along them push together across a gap.

Bar 1 is [-1, 0] and feels A_1 E_1 sin(pi (y + 1) / 2) per volume, bar 2 is [0, 1] and feels -A_2 E_2 sin(pi y).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

E_1, E_2 = 1000.0, 3000.0  # [Pa]
GAP = 5e-4  # [m]
A_1, A_2 = 2e-3, 1e-3  # [1/m], at the end


@dataclass(frozen=True, kw_only=True)
class BarState:
    """The ends that face each other."""

    p: float  # pressure between them [Pa]
    u_1: float  # displacement of bar 1 there [m]
    u_2: float  # of bar 2


def state(a_1: float, a_2: float) -> BarState:
    """State under body forces of the sizes a_1 and a_2 [1/m].

    Without contact the end of a bar moves by the integral of force times distance from its other end, over E:
    4 a_1 / pi^2 and -a_2 / pi. The pressure p moves the ends back by p / E_1 and p / E_2.

    >>> state(0.0, 0.0).p, round(state(A_1, A_2).u_1 - state(A_1, A_2).u_2, 12) == GAP
    (0.0, True)
    """
    free_1, free_2 = 4 * a_1 / pi**2, -a_2 / pi
    p = max(0.0, free_1 - free_2 - GAP) / (1 / E_1 + 1 / E_2)
    return BarState(p=p, u_1=free_1 - p / E_1, u_2=free_2 + p / E_2)
