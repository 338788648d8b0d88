"""Cells of aspect ratio 1000: the closed forms still hold, with about as many iterations.

The first row and the first column of cells of a regular mesh are squeezed, so that cells of both shapes, and of all
sizes between 1 and 1e-6 of the area, touch the obstacle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from stickslip import Block, Contact, Load, Material, Plane, Scene, StepResult, Support
from stickslip.geometry.arrays import Array
from stickslip.solvers.method_registry import METHODS
from stickslip.workflows.lab.verification.cases import column, incline
from stickslip.workflows.lab.verification.check import TWO, Check, farthest, problem, within
from stickslip.workflows.lab.verification.prepared import observed, solver, system_of

ASPECT = 1e3
CELLS = 4  # a side of 1 m
TOLERANCE = 1e-7  # of the answers
MORE = 1.5  # times the regular mesh's iterations
PRESSURE = 7.0  # of the block [Pa]
E, NU = 1000.0, 0.3  # of the block


@dataclass(frozen=True)
class Thin:
    """A scene, and its exact answers, which hold on any mesh."""

    scene: Callable[[str], Scene]
    answers: Callable[[StepResult], list[Check]]
    floating: bool = False


def squeezed(points: Array) -> Array:
    """Squeeze the first cell along each axis."""
    planes = np.linspace(0.0, 1.0, CELLS + 1)
    moved = planes.copy()
    moved[1] /= ASPECT
    return np.interp(points, planes, moved)


def block(method: str) -> Scene:
    """Laterally free on a frictionless floor, under a uniform pressure: the state is uniform."""
    return Scene(
        model="plane strain",
        geometry=Block(length=1.0, height=1.0, mesh_size=1 / CELLS),
        bodies={"block": Material(E=E, nu=NU)},
        obstacles={"floor": Plane(point=(0.0, 0.0), normal=(0.0, 1.0))},
        contacts={"base": Contact(surface="block.bottom", against="floor")},
        supports={"corner": Support(point=(0.0, 0.0), displacement={"x": 0.0})},
        loads={"top": Load(boundary="block.top", pressure=PRESSURE)},
        solver=solver(method, 1e-12),
    )


def uniform(step: StepResult) -> list[Check]:
    """Pressure of the base, settlement of the top and widening."""
    down, wide = PRESSURE * (1 - NU**2) / E, PRESSURE * NU * (1 + NU) / E
    u = step.displacement
    p = farthest(step.contacts["base"].pressure, PRESSURE)
    return [
        Check("pressure [Pa]", p, PRESSURE, TOLERANCE, relative=True),
        Check("settlement [m]", float(-u[:, 1].min()), down, TOLERANCE, relative=True),
        Check("widening [m]", float(np.ptp(u[:, 0])), wide, TOLERANCE, relative=True),
    ]


def pressed(dim: int, m: int) -> Thin:
    """The column on a compliant foundation."""
    c_n, g, top = column.C_N[m], column.GAP, 0.01
    exact = column.driven_by_displacement(M=column.M, U=top, g=g, c_n=c_n, m=m)
    return Thin(
        lambda method: column.scene(dim=dim, method=method, c_n=c_n, m=m, g=g, top=top, mesh_size=1 / CELLS),
        lambda step: column.compare(f"column {dim}D, m = {m}", step, exact, g, TOLERANCE),
    )


SCENES: Mapping[str, Thin] = {
    **{f"column {dim}D, m = {m}": pressed(dim, m) for dim in (2, 3) for m in (1, 2, 3)},
    "block under pressure": Thin(block, uniform, floating=True),
    "layer on an incline": Thin(
        lambda method: incline.scene(method, incline.HOLDS),
        lambda step: incline.resting(step, "layer", TOLERANCE),
        floating=True,
    ),
}


def thin(name: str, method: str) -> list[Check]:
    """One scene on thin cells, and its iterations against those on regular ones."""
    scene = SCENES[name].scene(method)
    (regular,), (step,) = observed(system_of(scene)), observed(system_of(scene, squeezed))
    found = SCENES[name].answers(step)
    limit = MORE * regular.iterations
    return [*found, within(f"{name}, aspect {ASPECT:g}: iterations", step.iterations, 0, limit)]


@problem("cells of aspect 1000, closed forms and iterations", methods=TWO)
def checks(method: str) -> list[Check]:
    """All that the method can solve."""
    return [
        c
        for name, s in SCENES.items()
        if METHODS[method].WORKS_WITH.floating or not s.floating
        for c in thin(name, method)
    ]
