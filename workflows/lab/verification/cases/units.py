"""Every scene in m, N, Pa and in mm, N, MPa: same iterations, same answers; no constant of the program has a unit."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from stickslip import Coulomb, Scene, StepResult
from stickslip.geometry.arrays import Array
from stickslip.solvers.method_registry import METHODS
from stickslip.workflows.lab.verification.cases import column as column_case
from stickslip.workflows.lab.verification.cases import (
    hertz,
    incline,
    pair,
    patch,
    press_fit,
    punch,
    raous,
    shear_lag,
    sheared_column,
    shrink_fit,
)
from stickslip.workflows.lab.verification.cases.circular_drive import DRIVE
from stickslip.workflows.lab.verification.cases.hertz import Touch
from stickslip.workflows.lab.verification.cases.patch import Patch
from stickslip.workflows.lab.verification.cases.shrink_fit import Press
from stickslip.workflows.lab.verification.check import TWO, Check, problem
from stickslip.workflows.lab.verification.prepared import prepare, solver
from stickslip.workflows.lab.verification.step_file import step_file
from stickslip.workflows.lab.verification.units import in_millimetres, millimetres
from stickslip.workflows.scene_file.read import read

TOLERANCE = 1e-9  # of the largest value of the same unit
COARSE = {
    "block": ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.25"],
    "cube": ["geometry.mesh_size=0.25"],
    "foundation": ["geometry.mesh_size=0.25"],
}
ROLLER = "shape='cylinder',point=[2.0,-5.0],radius=5.0"
TURNS = f"{{{ROLLER},displacement={{y=[[0,0],[1,0.02]]}},rotation={{point=[2.0,-5.0],angle=[[1,0],[2,0.01]]}}}}"
IS_PUSHED = f"{{{ROLLER},force={{y=[[0,0],[1,0.02]]}}}}"
OF_A_STEP = {"displacement": "m", "stress": "Pa", "p": "Pa", "w": "m", "p_ref": "Pa", "u_ref": "m"}
OF_A_CONTACT = {
    **{"gap": "m", "pressure": "Pa", "traction": "Pa", "slip": "m", "force": "N", "max_pressure": "Pa"},
    **{"dissipation_total": "J"},
}


@dataclass(frozen=True)
class Answer:
    """The numbers of one unit, of one step."""

    unit: str
    values: Array


def column(method: str, dim: int = 2, m: int = 2) -> Scene:
    return column_case.scene(dim=dim, method=method, c_n=column_case.C_N[m], m=m, g=column_case.GAP, top=0.01)


def axisymmetric(method: str) -> Scene:
    """The column as a cylinder: its left side is the axis."""
    return replace(column(method), model="axisymmetric")


def sheared(method: str, law: str) -> Scene:
    path = sheared_column.TOP[:, None]
    return sheared_column.scene(
        dim=2, method=method, E=sheared_column.E, friction=sheared_column.laws()[law], path=path
    )


def circled(method: str, steps: int = 16) -> Scene:
    """One turn of the circular drive."""
    angles = 2 * np.pi * np.arange(steps + 1) / steps
    path = DRIVE.radius * np.column_stack([np.cos(angles), np.sin(angles)])
    return sheared_column.scene(dim=3, method=method, E=1000.0, friction=Coulomb(mu=0.3), path=path)


def ready(method: str, name: str, obstacle: str | None = None) -> Scene:
    """A ready scene on a coarse mesh, perhaps against another obstacle."""
    overrides = COARSE[name] + ([f"obstacles.foundation={obstacle}"] if obstacle else [])
    return replace(read(name, overrides), solver=solver(method, 1e-11))


def described(scene: Callable[[Any], Scene], by: Any, method: str) -> Scene:
    """The scene of a description, a dataclass with a method."""
    return scene(replace(by, method=method))


def quadratic(scene: Callable[[str], Scene], method: str) -> Scene:
    """The scene at order 2."""
    linear = scene(method)
    return replace(linear, geometry=replace(linear.geometry, order=2))


BONDED = punch.Cut(method="", normal=punch.BONDED, fine=0.1, edge=None, size=40.0)
SCENES: Mapping[str, Callable[[str], Scene]] = {
    **{f"column {dim}D, m = {m}": partial(column, dim=dim, m=m) for dim in (2, 3) for m in (1, 2, 3)},
    "column, order 2": partial(quadratic, column),
    "column, axisymmetric": axisymmetric,
    "column, axisymmetric, order 2": partial(quadratic, axisymmetric),
    "sheared column, Coulomb": partial(sheared, law="Coulomb"),
    "sheared column, Tresca": partial(sheared, law="Tresca"),
    "circular drive": circled,
    "Raous": partial(raous.scene, n=16),
    "Raous, order 2": partial(quadratic, partial(raous.scene, n=8)),
    "Raous, compliant both ways": partial(raous.scene, n=16, k=100.0),
    "ball on a plane": partial(described, hertz.scene, Touch(cells=4.0)),
    "cylinder on a half-space": partial(
        described, hertz.scene, Touch(model="plane strain", against="half-space", cells=4.0)
    ),
    "bonded punch": partial(described, punch.scene, BONDED),
    "shear-lag strip": partial(shear_lag.scene, n=50),
    "layer on an incline": partial(incline.scene, mu=incline.HOLDS),
    "block": partial(ready, name="block"),
    "cube": partial(ready, name="cube"),
    "cube, order 2": partial(quadratic, partial(ready, name="cube")),
    "foundation": partial(ready, name="foundation"),
    "roller that turns": partial(ready, name="block", obstacle=TURNS),
    "roller that a force drives": partial(ready, name="block", obstacle=IS_PUSHED),
    "blocks on each other": partial(described, patch.scene, Patch()),
    "blocks on each other, loaded, 3D": partial(described, patch.scene, Patch(dim=3, loaded=True)),
    "blocks on each other, node by node": partial(described, patch.scene, Patch(nodal=True, order=2)),
    "rings drawn too large": partial(described, shrink_fit.scene, Press(ratio=1.5, drawn=True)),
    "rings, compliant": partial(described, shrink_fit.scene, Press(ratio=1.5, c_n=1e8, m=2.0)),
    **{f"{name}, with friction": scene for name, scene in pair.SCENES.items()},
}
FLOATING = (  # held by contact alone
    *("foundation", "roller that a force drives", "shear-lag strip", "layer on an incline"),
    *("ball on a plane", "cylinder on a half-space", "blocks on each other, loaded, 3D"),
)
GRADED = tuple(f"{name}, with friction" for name in pair.GRADED)  # plain Uzawa takes too many iterations
# Nodes of the strip reverse exactly at their bound, and rounding says which first: 62 to 64, even in units 1024 apart.
UNEVEN = {"shear-lag strip": 0.05}  # part of the iterations


def answers(step: StepResult) -> dict[str, Answer]:
    """Numbers of a step, by name."""
    found: dict[str, tuple[str, Any]] = {key: (unit, getattr(step, key)) for key, unit in OF_A_STEP.items()}
    for name, contact in step.contacts.items():
        found |= {f"{name}.{key}": (unit, getattr(contact, key)) for key, unit in OF_A_CONTACT.items()}
    found |= {name: ("N", force) for name, (force, _) in step.supports.items()}
    found |= {"stored": ("J", step.energy.stored), "external": ("J", step.energy.external)}
    return {key: Answer(unit, np.asarray(values, float).ravel()) for key, (unit, values) in found.items()}


def compared(name: str, method: str) -> list[Check]:
    """One scene of `SCENES`."""
    return in_both(name, SCENES[name](method))


def from_step(method: str) -> list[Check]:
    """A shaft in a hub; the numbers of the file stay, and are in millimetres in both scenes."""
    fit = press_fit.Fit(order=1, finer=0.5, method=method)
    with step_file(fit.draw) as path:
        return in_both("press fit from a STEP file", press_fit.scene(fit, path))


def in_both(name: str, metres: Scene) -> list[Check]:
    """A scene in both units: iterations of all steps, and the worst number of each unit."""
    there, here = (list(prepare(scene).steps()) for scene in (in_millimetres(metres), metres))
    units, worst = millimetres(metres), defaultdict[str, float](float)
    for a, b in zip(there, here, strict=True):
        theirs, mine = answers(a), answers(b)
        for unit in {answer.unit for answer in mine.values()}:
            keys = [key for key, answer in mine.items() if answer.unit == unit and answer.values.size]
            size = max(float(np.abs(mine[key].values).max()) for key in keys)
            off = max(float(np.abs(theirs[key].values / units.factor(unit) - mine[key].values).max()) for key in keys)
            worst[unit] = max(worst[unit], off / size if size else off)
    count, again = (sum(step.iterations for step in steps) for steps in (here, there))
    return [
        Check(f"{name}: iterations, in mm", again, count, UNEVEN.get(name, 0.0), relative=True),
        *(Check(f"{name}: [{u}], in mm against m", off, 0, TOLERANCE, relative=False) for u, off in worst.items()),
    ]


@problem("every scene in mm, N, MPa: the same answers", methods=TWO, slow=TWO)
def checks(method: str) -> list[Check]:
    """All of them."""
    names = [name for name in SCENES if METHODS[method].WORKS_WITH.floating or name not in FLOATING + GRADED]
    return [check for name in names for check in compared(name, method)] + from_step(method)
