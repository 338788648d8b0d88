"""Two bars under sinusoidal body forces: nu = 0 and rows of quadrilaterals, so each node has the exact displacement.

Two bars end to end, held at their outer ends, that body forces along them push together across a gap.

Bar 1 is [-1, 0] and feels A_1 E_1 sin(pi (y + 1) / 2) per volume, bar 2 is [0, 1] and feels -A_2 E_2 sin(pi y).
"""

from dataclasses import dataclass
from math import cos, pi
from typing import Literal

import numpy as np

from stickslip import Contact, Material, Scene, Steps, Support, TwoBlocks
from stickslip.solvers.effects.body_forces import BodyForce
from stickslip.workflows.lab.verification.check import Check, close, farthest, problem
from stickslip.workflows.lab.verification.prepared import prepare, solver

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


STEPS = 4
# The quadrature of the sines over eight cells is off by less than 1e-12; the iteration ends at 1e-11 of the forces.
TOLERANCE = 1e-9


def scene(method: str, order: Literal[1, 2] = 1) -> Scene:
    """Bar 1 is loaded in a half wave of time, bar 2 by a ramp."""
    growing = f"{A_1}*E*sin(pi*(y+1)/2) * (1-cos(pi*t))/2"
    ramped = f"-{A_2}*E*sin(pi*y)"
    return Scene(
        model="plane strain",
        geometry=TwoBlocks(length=0.25, height=1.0, mesh_size=0.125, cells="tensor", order=order),
        bodies={"lower": Material(E=E_1, nu=0.0), "upper": Material(E=E_2, nu=0.0)},
        contacts={"joint": Contact(surface="upper.bottom", against="lower.top", gap_offset=GAP)},
        supports={
            "base": Support(boundary="lower.bottom", displacement={"x": 0.0, "y": 0.0}),
            "top": Support(boundary="upper.top", displacement={"x": 0.0, "y": 0.0}),
        },
        sections={"body_force": {"lower": BodyForce(force=(0.0, growing)), "upper": BodyForce(force=(0.0, ramped))}},
        steps=Steps(count=STEPS),
        solver=solver(method, 1e-11),
    )


@problem("bars that sinusoidal body forces push together, closed form")
def checks(method: str, order: Literal[1, 2] = 1) -> list[Check]:
    """Pressure, displacement of both ends, and energy of every step; the gap is closed after the first ones."""
    simulation, found, work = prepare(scene(method, order)), list[Check](), 0.0
    (joint,) = simulation.system.contacts
    assert joint.master is not None
    for step in simulation.steps():
        exact = state(A_1 * (1 - cos(pi * step.time)) / 2, A_2 * step.time)
        u_1, u_2 = (step.displacement[side.input, 1] for side in (joint.master, joint.surface))
        at, work = f"order {order}, t = {step.time:g}", max(work, step.energy.stored)
        pressure = step.contacts["joint"].pressure
        off = step.energy.external - step.energy.stored - step.energy.contact
        found += [
            close(f"{at}: p [Pa]", farthest(pressure, exact.p), exact.p, TOLERANCE, E_1 * GAP),
            close(f"{at}: u_1 [m]", farthest(u_1, exact.u_1), exact.u_1, TOLERANCE, GAP),
            close(f"{at}: u_2 [m]", farthest(u_2, exact.u_2), exact.u_2, TOLERANCE, GAP),
            close(f"{at}: energy out of balance [J]", float(np.abs(off)), 0.0, TOLERANCE, work),
        ]
    return found
