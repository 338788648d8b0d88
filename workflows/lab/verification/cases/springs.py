"""Springs: in series with a column, alone under a heavy block, between two bodies; and those that act in one way."""

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np

from stickslip import Scene, Simulation, StepResult
from stickslip.workflows.lab.verification.check import Check, close, problem
from stickslip.workflows.lab.verification.prepared import prepare, solved
from stickslip.workflows.scene_file.read import from_dict

E, K, MOVED = 1000.0, 300.0, -0.02
AREA = {"plane strain": 2.0, "3d": 1.0, "axisymmetric": np.pi * 4.0}  # of a block 2 x 1 (x 0.5), by model
TOLERANCE = 1e-6  # iterative methods: 1e-8, times what spring and column differ in stiffness
Solved = tuple[Simulation, StepResult, list[Check]]


def scene(springs: dict[str, Any], model: str = "plane strain", order: int = 1, **tables: Any) -> Scene:
    """A block 2 x 1 (x 0.5), nu = 0."""
    shape = {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.5, "order": order}
    data = {
        "model": model,
        "geometry": shape | ({"width": 0.5} if model == "3d" else {}),
        "bodies": {"block": {"E": E, "nu": 0.0, "density": 1.0}},
        "springs": springs,
    }
    return from_dict(data | tables)


def floor(model: str) -> dict[str, Any]:
    """A floor under the block, and supports that keep it from sliding."""
    up = [0.0, 0.0, 1.0] if model == "3d" else [0.0, 1.0]
    sides = {"left": "x", "front": "y"} if model == "3d" else {"left": "x"} if model == "plane strain" else {}
    return {
        "obstacles": {"floor": {"shape": "plane", "point": [0.0] * len(up), "normal": up}},
        "contacts": {"base": {"surface": "block.bottom", "against": "floor"}},
        "supports": {side: {"boundary": f"block.{side}", "displacement": {axis: 0.0}} for side, axis in sides.items()},
    }


def pressed(model: str, order: Literal[1, 2], method: str, surface: str = "auto") -> Solved:
    """A spring whose ground moves presses a column on a floor: k E A/h / (k + E A/h) times that motion."""
    down, moved = ([0.0] * (model == "3d") + [0.0, value] for value in (-2.0, MOVED))
    springs = {"s": {"at": "block.top", "stiffness": K, "direction": down, "displacement": moved}}
    solver = {"method": method, "surface": surface}
    simulation, (step,) = solved(scene(springs, model, order, **floor(model), solver=solver))
    column = E * AREA[model]
    force, name = -MOVED * K * column / (K + column), f"in series, {model}, order {order}"
    return simulation, step, [
        close(f"{name}: force of the spring [N]", step.springs["s"].force[-1], -force, TOLERANCE, force),
        close(f"{name}: force on the floor [N]", step.contacts["base"].normal_force, force, TOLERANCE, force),
        close(f"{name}: stored [J]", step.energy.stored, -force * MOVED / 2, TOLERANCE, force),
        close(f"{name}: external [J]", step.energy.external, step.energy.stored, TOLERANCE, force),
    ]  # fmt: skip


CORNERS: dict[str, Any] = {
    "a": {"at": [0.0, 0.0], "stiffness": [K, K]},
    "b": {"at": [2.0, 0.0], "stiffness": 2 * K, "direction": [0.0, 1.0]},
}


def alone(order: Literal[1, 2]) -> Solved:
    """Three springs at two corners carry the weight: moments about the first, 2 b = 4 * 1 + 6 * 0.5."""
    simulation, (step,) = solved(scene(CORNERS, order=order, gravity={"acceleration": [3.0, -2.0]}))
    found = [close(f"alone, order {order}: external [J]", step.energy.external, step.energy.stored, 1e-9, 1.0)]
    for spring, force in (("a", (-6.0, 0.5)), ("b", (0.0, 3.5))):
        for axis, exact, computed in zip("xy", force, step.springs[spring].force, strict=True):
            found.append(close(f"alone, order {order}: force {axis} of {spring} [N]", computed, exact, 1e-9, 1.0))
    return simulation, step, found


def between() -> Solved:
    """Columns of heights .5 and 1 and a spring between them, drawn apart: all in series."""
    tables: dict[str, Any] = {
        "model": "plane strain",
        "geometry": {"builder": "two_blocks", "mesh_size": 0.25, "length": 1.0, "height": 1.0, "lower_height": 0.5},
        "bodies": {"lower": {"E": E, "nu": 0.0}, "upper": {"E": 2 * E, "nu": 0.0}},
        "supports": {
            "foot": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0}},
            "head": {"boundary": "upper.top", "displacement": {"x": 0.0, "y": -MOVED}},
        },
        "springs": {"s": {"at": "upper.bottom", "to": "lower.top", "stiffness": [0.0, K]}},
        "contacts": {"pair": {"surface": "upper.bottom", "against": "lower.top"}},
    }
    simulation, (step,) = solved(from_dict(tables))
    force = -MOVED / (1 / K + 0.5 / E + 1 / (2 * E))
    return simulation, step, [
        close("between bodies: force of the spring [N]", step.springs["s"].force[1], -force, 1e-9, force),
        close("between bodies: force on the head [N]", step.supports["head"].force[1], force, 1e-9, force),
        close("between bodies: contact force [N]", step.contacts["pair"].normal_force, 0.0, 1e-9, force),
    ]  # fmt: skip


GAP, PULSE = 0.01, ((1.0, 20.0), (3.0, -20.0))  # [m], [s, N]


def one_way(model: str, acts: str, method: str, order: Literal[1, 2] = 1, surface: str = "auto") -> list[Check]:
    """A column on a spring is pushed up and pulled down; a second one acts on its top once that is 10 mm higher.

    It is a bumper above, or a cable from below. Force by force: piecewise linear, and nothing where it does not act.
    """
    up = [0.0] * (model == "3d") + [0.0, 1.0]
    springs = {
        "base": {"at": "block.bottom", "stiffness": K, "direction": up},
        "s": {
            "at": "block.top", "stiffness": 2 * K, "acts": acts, "gap": GAP,
            "direction": [c if acts == "tension" else -c for c in up],
        },
    }  # fmt: skip
    load = {"boundary": "block.bottom", "force": {"z" if model == "3d" else "y": [list(at) for at in PULSE]}}
    tables = {"supports": floor(model)["supports"], "loads": {"push": load}, "steps": {"end": 3.0, "count": 6}}
    solver = {"method": method, "surface": surface}
    second, found = 1 / (1 / (2 * K) + 1 / (E * AREA[model])), list[Check]()
    for step in prepare(scene(springs, model, order, solver=solver, **tables)).steps():
        energy = step.energy
        force = float(np.interp(step.time, (0.0, *(t for t, _ in PULSE)), (0.0, *(f for _, f in PULSE))))
        exact = max(second * (force / K - GAP) / (1 + second / K), 0.0)
        name = f"{acts} only, {model}, order {order}, t = {step.time:g}"
        found += [
            close(f"{name}: force of the second spring [N]", -step.springs["s"].force[-1], exact, 1e-8, 20.0),
            close(f"{name}: force of the first one [N]", -step.springs["base"].force[-1], force - exact, 1e-8, 20.0),
            close(f"{name}: external - stored [J]", energy.external - energy.stored - energy.contact, 0.0, 1e-8, 0.1),
        ]
    return found


def problems(method: str) -> Iterator[Solved]:
    """All of them; without contact the method is of no account."""
    for model in AREA:
        yield pressed(model, 1, method)
    if method == "condensed-newton":
        yield from (pressed("plane strain", 2, method), alone(1), alone(2), between())


@problem("springs in series with a column, alone, between bodies, of one way")
def checks(method: str) -> list[Check]:
    """Their checks."""
    found = [check for *_, found in problems(method) for check in found]
    if method == "condensed-newton":  # without contact the method is of no account
        for acts in ("tension", "compression"):
            found += [check for model in AREA for check in one_way(model, acts, method)]
            found += one_way("plane strain", acts, method, order=2) + one_way(
                "3d", acts, "surface-uzawa", surface="matrix-free"
            )
    return found
