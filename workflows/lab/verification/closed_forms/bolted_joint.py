"""A bolt that clamps two plates: bolt and plates as springs, in series while tightened, then side by side."""

from __future__ import annotations

from dataclasses import dataclass

E, HEIGHT = 1000.0, 1.0  # of each plate [Pa], [m]; lateral strain zero
BOLT, FORCE = 400.0, 3.0  # stiffness of the bolt [N/m], what it is tightened to [N]


@dataclass(frozen=True, kw_only=True)
class JointState:
    """The joint diagram."""

    tension: float  # of the bolt [N]
    clamped: float  # force between the plates [N]
    shortening: float  # of the bolt, by which it was tightened [m]


def state(tightened: float, load: float, area: float) -> JointState:
    """State of a joint tightened to a share of the force, that a load [N] then draws apart; area: of the plates [m²].

    With c = E A / (2 h) of both plates, a load adds k / (k + c) of itself to the bolt, until the joint opens.

    >>> state(1.0, 0.0, 2.0).clamped, state(1.0, 1e3, 2.0).tension
    (3.0, 1000.0)
    """
    plates = E * area / (2 * HEIGHT)
    preload = tightened * FORCE
    tension = max(preload + load * BOLT / (BOLT + plates), load)
    return JointState(tension=tension, clamped=tension - load, shortening=preload * (1 / BOLT + 1 / plates))
