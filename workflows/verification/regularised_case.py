"""The method `regularised` on the ready scenes `block` and `cube`: off by no more than it says.

The others solve the laws themselves; against each of them its difference in the energy norm is held against the error
that it states for itself, and the forces on the obstacle against the same.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from solvers.nouns.scene import Scene
from solvers.nouns.stepping import Solver
from solvers.simulation import Simulation, prepare
from solvers.step_result import StepResult
from workflows.scene import read
from workflows.verification.check import Check, within

SCENES = ("block", "cube")
TOLERANCE = 1e-9  # of both methods, far below the smoothing
LARGEST = 5e-3  # stated error in the energy norm: levels of 1e-4, and two steps that add up


def scene(name: str, method: str) -> Scene:
    """The ready scene, solved by a method."""
    return replace(read(name), solver=Solver(method=method, tolerance=TOLERANCE))


@lru_cache
def solve(name: str, method: str) -> tuple[Simulation, tuple[StepResult, ...]]:
    """All steps."""
    simulation = prepare(scene(name, method))
    return simulation, tuple(simulation.steps())


def difference(simulation: Simulation, step: StepResult, reference: StepResult) -> float:
    """Energy norm of the difference of two displacements, relative to the reference; on one rank."""
    system = simulation.system
    apart = system.K.createVecRight()
    own = system.nodes.input[: system.nodes.owned]
    apart.array[:] = (step.displacement - reference.displacement)[own].ravel()
    return float(np.sqrt((system.K * apart).dot(apart) / (2 * reference.energy.stored)))


def checks(method: str) -> list[Check]:
    """`regularised` against a method that solves the laws themselves."""
    found = []
    for name in SCENES:
        _, steps = solve(name, "regularised")
        simulation, references = solve(name, method)
        for step, reference in zip(steps, references, strict=True):
            where, stated = f"{name}, t = {step.time:g}", step.law_error
            found.append(within(f"{where}: stated error", stated, 0.0, LARGEST))
            apart = difference(simulation, step, reference)
            found.append(Check(f"{where}: energy norm of the difference", apart, 0.0, stated, relative=False))
            mine, theirs = step.contacts["base"], reference.contacts["base"]
            off = np.linalg.norm(mine.force - theirs.force) / np.linalg.norm(theirs.force)
            found.append(Check(f"{where}: force, relative difference", float(off), 0.0, stated, relative=False))
    return found
