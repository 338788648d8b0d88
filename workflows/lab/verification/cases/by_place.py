"""Loads and displacements that are expressions of place: water on a wall, sheared and stretched blocks."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from stickslip import Scene, Simulation, StepResult
from stickslip.workflows.lab.verification.check import ONE, Check, close, problem
from stickslip.workflows.lab.verification.prepared import solved
from stickslip.workflows.scene_file.read import from_dict

E, NU = 200.0, 0.3
LEVEL, WEIGHT = 0.75, 9.81  # of the water [m], [N/m³]
STRAIN = 1e-3
EXACT = 1e-10  # integrals of polynomials
Solved = tuple[Simulation, list[StepResult], list[Check]]


def water(order: int) -> Solved:
    """Hydrostatic: pressure = rho g depth up to the level, H² rho g / 2 at a third of the height."""
    data: dict[str, Any] = {
        "model": "plane strain",
        "geometry": {"builder": "block", "length": 0.5, "height": 1.0, "mesh_size": 0.25, "order": order},
        "bodies": {"block": {"E": E, "nu": NU}},
        "supports": {"foot": {"boundary": "block.bottom", "displacement": {"x": 0.0, "y": 0.0}}},
        "loads": {"water": {"boundary": "block.left", "pressure": f"{WEIGHT}*max({LEVEL}-y, 0)"}},
    }
    simulation, steps = solved(from_dict(data))
    thrust, (force, moment) = WEIGHT * LEVEL**2 / 2, steps[-1].supports["foot"]
    return simulation, steps, [
        close(f"water, order {order}: reaction x [N]", force[0], -thrust, EXACT, thrust),
        close(f"water, order {order}: reaction y [N]", force[1], 0.0, EXACT, thrust),
        close(f"water, order {order}: moment of the reaction [N m]", moment[0], thrust * LEVEL / 3, EXACT, thrust),
    ]  # fmt: skip


def block(**tables: Any) -> Scene:
    """A block 2 x 1, held at its left side."""
    data: dict[str, Any] = {
        "model": "plane strain",
        "geometry": {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.5},
        "bodies": {"block": {"E": E, "nu": NU}},
        "supports": {"left": {"boundary": "block.left", "displacement": {"x": 0.0, "y": 0.0}}},
    }
    return from_dict(data | tables)


def loaded() -> Solved:
    """Resultants are the integrals of tractions, a pressure and a body force; those without t are ramped."""
    loads = {
        "end": {"boundary": "block.right", "traction": ["1e-3*E*y**2", "nu*t"]},
        "top": {"boundary": "block.top", "pressure": "1e-3*x**3*t"},
    }
    found = block(loads=loads, body_force={"block": {"force": ["x*y**2", 0.0]}}, steps={"count": 2, "end": 2.0})
    (simulation, steps), checks = solved(found), list[Check]()
    for step in steps:
        t, force = step.time, step.supports["left"].force
        exact = (1e-3 * E / 3 + 2 / 3) * t / 2, NU * t - 4e-3 * t
        for axis, computed, value in zip("xy", force, exact, strict=True):
            checks.append(close(f"loaded, t = {t:g}: reaction {axis} [N]", computed, -value, EXACT, 1.0))
        checks.append(close(f"loaded, t = {t:g}: external [J]", step.energy.external, step.energy.stored, EXACT, 1.0))
    return simulation, steps, checks


def stretched() -> Solved:
    """All sides follow u = (a x t, a x t), a uniform strain."""
    moves = {"x": f"{STRAIN}*x*t", "y": f"{STRAIN}*x*t"}
    every = ("left", "right", "bottom", "top")
    supports = {side: {"boundary": f"block.{side}", "displacement": moves} for side in every}
    simulation, steps = solved(block(supports=supports))
    off = steps[-1].displacement - STRAIN * simulation.data.points[:, :1]
    energy = steps[-1].energy
    return simulation, steps, [
        close("stretched: displacement [m]", float(np.abs(off).max()), 0.0, EXACT, STRAIN),
        close("stretched: external [J]", energy.external, energy.stored, EXACT, energy.stored),
    ]  # fmt: skip


def problems() -> Iterator[Solved]:
    """All of them."""
    yield from map(water, (1, 2))
    yield loaded()
    yield stretched()


@problem("water on a wall; loads and displacements by place", methods=ONE)
def checks(method: str) -> list[Check]:
    """Their checks; there is no contact, and the method of no account."""
    return [check for *_, found in problems() for check in found]
