"""A beam that a remote point at its end pulls, bends and turns, by a rigid and by a distributing coupling.

Source: Bernoulli's beam with Timoshenko's shear, S. Timoshenko, Phil. Mag. 41 (1921); shear coefficient 5/6.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from stickslip import Scene, Simulation, StepResult
from stickslip.workflows.lab.verification.check import ONE, Check, close, problem
from stickslip.workflows.lab.verification.prepared import solved
from stickslip.workflows.scene_file.read import from_dict

E, LENGTH, ARM = 1000.0, 10.0, 2.0
FX, FY, MZ = 0.02, 0.01, 0.03  # at the point [N], [N m]
PULLED, TURNED = 1e-3, 2e-3  # prescribed of the end [m], [rad]
BEND, SHEAR = E / 12, 5 / 6 * E / 2  # stiffnesses of the section 1 x 1: E I, k G A; nu = 0
TOLERANCE = 2e-3  # order 2, two cells over the height; the clamped end is no beam
Solved = tuple[Simulation, StepResult, list[Check]]


def scene(points: dict[str, Any], model: str = "plane strain", order: int = 1, **tables: Any) -> Scene:
    """A bar 10 x 1 (x 1), nu = 0; its left end is held."""
    size = {"length": LENGTH, "height": 1.0, "mesh_size": 0.5, "order": order}
    axes = "xyz" if model == "3d" else "xy"
    data = {
        "model": model,
        "geometry": {"builder": "block", **size, **({"width": 1.0} if model == "3d" else {})},
        "bodies": {"block": {"E": E, "nu": 0.0, "density": 1.0}},
        "supports": {"left": {"boundary": "block.left", "displacement": dict.fromkeys(axes, 0.0)}},
        "remote_points": points,
    }
    return from_dict(data | tables)


def end(model: str = "plane strain", coupling: str = "rigid", **given: Any) -> dict[str, Any]:
    """A point beyond the right end, on the bar's axis."""
    across = [0.5, 0.5] if model == "3d" else [0.5]
    return {"p": {"boundary": "block.right", "point": [LENGTH + ARM, *across], "coupling": coupling, **given}}


def bent(model: str, coupling: str) -> Solved:
    """A force and a moment at an arm."""
    up, about = ("z", "y") if model == "3d" else ("y", "z")
    turn = -1.0 if model == "3d" else 1.0  # x towards z turns about -y
    given: dict[str, Any] = {"force": {"x": FX, up: FY}, "moment": {about: turn * MZ}}
    simulation, (step,) = solved(scene(end(model, coupling, **given), model, order=2))
    moment = MZ + FY * ARM
    slope = FY * LENGTH**2 / (2 * BEND) + moment * LENGTH / BEND
    sag = FY * LENGTH**3 / (3 * BEND) + moment * LENGTH**2 / (2 * BEND) + FY * LENGTH / SHEAR
    point, name = step.remote_points["p"], f"{coupling}, {model}"
    stretch, held = FX * LENGTH / E, step.supports["left"].force
    return simulation, step, [
        close(f"{name}: displacement x [m]", point.displacement[0], stretch, TOLERANCE, stretch),
        close(f"{name}: displacement {up} [m]", point.displacement[-1], sag + ARM * slope, TOLERANCE, sag),
        close(f"{name}: rotation [rad]", float(np.abs(point.rotation).max()), slope, TOLERANCE, slope),
        close(f"{name}: reaction x [N]", held[0], -FX, 1e-8, FX),
        close(f"{name}: reaction {up} [N]", held[-1], -FY, 1e-8, FX),
    ]  # fmt: skip


def driven() -> Solved:
    """The end is pulled by u and turned by w about its centre: N = E u / L, M = 4 E I w / L, Q = 6 E I w / L²."""
    given: dict[str, Any] = {"displacement": {"x": PULLED, "y": 0.0}, "rotation": {"z": TURNED}}
    simulation, (step,) = solved(scene({"p": {**end(**given)["p"], "point": [LENGTH, 0.5]}}, order=2))
    point, soft = step.remote_points["p"], 12 * BEND / (SHEAR * LENGTH**2)  # share of shear
    bend, pull = BEND * TURNED / LENGTH / (1 + soft), E * PULLED / LENGTH
    return simulation, step, [
        close("driven: rotation [rad]", point.rotation[0], TURNED, 1e-9, TURNED),
        close("driven: force x [N]", point.force[0], pull, TOLERANCE, pull),
        close("driven: force y [N]", point.force[1], -6 * bend / LENGTH, TOLERANCE, pull),
        close("driven: moment [N m]", point.moment[0], (4 + soft) * bend, TOLERANCE, pull),
        close("driven: reaction x [N]", step.supports["left"].force[0], -point.force[0], 1e-8, pull),
    ]  # fmt: skip


def problems() -> Iterator[Solved]:
    """All of them."""
    for model in ("plane strain", "3d"):
        yield from (bent(model, coupling) for coupling in ("rigid", "distributing"))
    yield driven()


@problem("a beam bent through a remote point, rigid and distributing", methods=ONE)
def checks(method: str) -> list[Check]:
    """Their checks; there is no contact, and the method of no account."""
    return [check for *_, found in problems() for check in found]
