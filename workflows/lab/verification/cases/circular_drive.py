"""The column whose top is driven on a circle, in 3D.

Three turns: each reduces the transient part of the dissipation by 1e-6, so the third is steady to 1e-11.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.results.step_result import StepResult
from stickslip.workflows.lab.verification.cases.sheared_column import MU, scene
from stickslip.workflows.lab.verification.check import Check
from stickslip.workflows.lab.verification.closed_forms import circular_drive
from stickslip.workflows.lab.verification.closed_forms.circular_drive import DISSIPATION_ERROR, DRIVE, SteadyTurn
from stickslip.workflows.lab.verification.cycles import accounted
from stickslip.workflows.lab.verification.prepared import observed
from stickslip.workflows.lab.verification.turned import rotation, turned_system

SLOW = ("condensed-newton", "uzawa", "surface-uzawa")  # methods that take more than some seconds
E = 1000.0  # [Pa]
TURNS = 3
COUNTS = (16, 32, 64, 128)  # steps per turn
TOLERANCE = 1e-9  # the solver's 1e-12 per step, carried over the steps of a turn, and a digit to spare
FRAME_TOLERANCE = 1e-10
FIGURES = {"face_radius": "face radius [m]", "lag": "lag [rad]", "dissipation": "dissipation a turn [J]"}
TURNED = np.radians(17)
SKEW = (1.0, 2.0, 3.0)  # along no edge, face or diagonal of the mesh


@lru_cache
def turns(method: str, n: int, start: float = 0.0, mu: float = MU, tilt: float = 0.0) -> tuple[StepResult, ...]:
    """Press, go to the circle at angle `start`, and take three turns of n steps.

    `tilt` turns the whole scene about a skew axis: mesh, floor and drive. The frames of friction turn otherwise.
    """
    drawn = scene(dim=3, method=method, E=E, friction=Coulomb(mu=mu), path=_path(n, start))
    turned = turned_system(drawn, rotation(SKEW, tilt))
    return tuple(step for step in observed(turned) if step.time > 0)


def last_turn(method: str, n: int, start: float = 0.0, mu: float = MU, tilt: float = 0.0) -> SteadyTurn:
    """Numbers of the last turn."""
    states = [step.contacts["base"] for step in turns(method, n, start, mu, tilt)]
    w, V = states[-1].slip.mean(axis=0) @ rotation(SKEW, tilt)[:, :2], _path(n, start)[-1]
    return SteadyTurn(
        face_radius=float(np.linalg.norm(w)),
        lag=float(np.arctan2(w[0] * V[1] - w[1] * V[0], w @ V)),
        dissipation=states[-1].dissipation_total - states[-1 - n].dissipation_total,
    )


def _path(n: int, start: float) -> Array:
    """Of the top (steps, 2) [m]."""
    angles = start + 2 * np.pi * np.arange(TURNS * n + 1) / n
    return np.asarray(DRIVE.radius * np.column_stack([np.cos(angles), np.sin(angles)]))


def steady(method: str, n: int, start: float = 0.0, mu: float = MU) -> list[Check]:
    """Against the polygon that n implicit Euler steps per turn must run on, and against the circle."""
    found, exact = last_turn(method, n, start, mu), circular_drive.steady_polygon(DRIVE, n)
    circle = circular_drive.steady(DRIVE)
    name = f"{n} steps a turn from {np.degrees(start):g} degrees"
    error = found.dissipation / circle.dissipation - 1
    return [
        Check(f"{name}: face radius [m]", found.face_radius, exact.face_radius, TOLERANCE, relative=True),
        Check(f"{name}: lag [rad]", found.lag, exact.lag, TOLERANCE, relative=True),
        Check(f"{name}: dissipation a turn [J]", found.dissipation, exact.dissipation, TOLERANCE, relative=True),
        # tabulated to one decimal of a per cent
        Check(f"{name}: error of the dissipation", error, DISSIPATION_ERROR[n], 0.0005, relative=False),
        *accounted(name, turns(method, n, start, mu)),
    ]


def first_order(method: str, counts: tuple[int, ...] = COUNTS) -> list[Check]:
    """The error of the dissipation is first order in the step: the log-log slope is 1."""
    exact = circular_drive.steady(DRIVE).dissipation
    errors = [abs(last_turn(method, n).dissipation - exact) for n in counts]
    slope = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    # the polygon's own is 1.0092 over 16 to 128 steps, and goes to 1
    return [Check(f"{counts[0]} to {counts[-1]} steps a turn: order", float(slope), 1.0, 0.1, relative=False)]


def turned(method: str, n: int, by: float = TURNED) -> list[Check]:
    """Turned by an angle that is no symmetry of mesh, drive or scene: scalar results must not change."""
    straight = last_turn(method, n)
    oblique = {"drive": last_turn(method, n, start=by), "scene": last_turn(method, n, tilt=by)}
    return [
        Check(
            f"{n} steps a turn, {which} turned by {np.degrees(by):g} degrees: {what}",
            getattr(found, key), getattr(straight, key), FRAME_TOLERANCE, relative=True,
        )
        for which, found in oblique.items()
        for key, what in FIGURES.items()
    ]  # fmt: skip


def checks(method: str, mu: float = MU) -> list[Check]:
    """All of them; with another mu than 0.3 they must fail."""
    counts = COUNTS[:2] if method == "surface-uzawa" else COUNTS  # this method is slow
    found = [check for n in counts for check in steady(method, n, mu=mu)]
    return found + first_order(method, counts) + turned(method, 16)
