"""Blocks that friction holds up to a known time: every step before it is solved, no step after it."""

from __future__ import annotations

import numpy as np

from stickslip.geometry.builders.cuboid import Block
from stickslip.geometry.obstacles.plane import Plane
from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.contact import Contact
from stickslip.solvers.scene.loads import Load
from stickslip.solvers.scene.material import Material
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Steps
from stickslip.solvers.stepping.stepper import NoEquilibriumError
from stickslip.workflows.lab.verification.check import Check, within
from stickslip.workflows.lab.verification.closed_forms.limits import END, LIMITS, Limit
from stickslip.workflows.lab.verification.cycles import accounted
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.lab.verification.solver import solver

SLOW = ("surface-uzawa",)  # methods that take more than some seconds
STEPS = 8
E, NU = 100.0, 0.3
NEAR = END / STEPS / 128  # a step is halved eight times: how close to the limit it comes [s], and a factor of 2
TOLERANCE = 1e-9  # of the forces, and the solver's 1e-11 of the pressure


def scene(method: str, limit: Limit) -> Scene:
    """A block that only the ground holds."""
    L, H = limit.length, limit.height
    return Scene(
        title="Block held by friction alone",
        model="plane strain",
        geometry=Block(length=L, height=H, mesh_size=0.25, cells="tensor"),
        bodies={"block": Material(E=E, nu=NU)},
        obstacles={"ground": Plane(point=(0.0, 0.0), normal=(0.0, 1.0))},
        contacts={"base": Contact(surface="block.bottom", against="ground", friction=Coulomb(mu=limit.mu))},
        loads={
            "press": Load(boundary="block.top", traction=(0.0, tuple((t, -N / L) for t, N in limit.press))),
            "push": Load(boundary="block.left", traction=(tuple((t, F / H) for t, F in limit.push), 0.0)),
        },
        steps=Steps(end=END, count=STEPS),
        solver=solver(method, 1e-11),
    )


def reached(scene: Scene) -> tuple[list[StepResult], bool]:
    """The solved steps, and whether it is proved that the next one has no equilibrium."""
    steps: list[StepResult] = []
    try:
        for step in prepare(scene).steps():
            steps.append(step)
    except NoEquilibriumError:
        return steps, True
    return steps, False


def held(method: str, name: str, limit: Limit) -> list[Check]:
    """The last good substep lies just before the limit, and the ground carries the loads there."""
    steps, proved = reached(scene(method, limit))
    last, base = steps[-1], steps[-1].contacts["base"]
    bears = [-limit.pushed(last.time), limit.pressed(last.time)]
    times = [step.time for step in steps[:-1]]
    wanted = [t for t in np.linspace(0.0, END, STEPS + 1) if t < limit.time and t not in times]
    return [
        Check(f"{name}: ends as one without equilibrium (1: yes)", float(proved), 1.0, 0.0, relative=False),
        within(f"{name}: last time reached [s]", last.time, limit.time - NEAR, limit.time),
        Check(f"{name}: times before it that are missing", len(wanted), 0, 0, relative=False),
        Check(f"{name}: force off what is put on [N]", np.abs(base.force - bears).max(), 0.0, TOLERANCE, False),
        *accounted(name, steps),
    ]


def checks(method: str) -> list[Check]:
    """All of them, with a method that can solve bodies held by contact alone."""
    return [check for name, limit in LIMITS.items() for check in held(method, name, limit)]
