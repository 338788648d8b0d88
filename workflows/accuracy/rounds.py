"""Rounds of solving, estimating and refining until the numbers are as accurate as they are asked to be.

A round is a run like any other. Its results are kept if it reaches the goals, or if the next one would exceed the
budget; else only what it shows of the errors is used: the mesh is refined where the energy norm of the error is large,
around the contacts first if pressures or areas are asked for, and the steps are split.
"""

from __future__ import annotations

import logging
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from geometry.arrays import Array
from geometry.errors import SceneError
from geometry.size_field import SizeField, adapted, volumes
from solvers.results.error_parts import Errors
from solvers.results.step_result import OPEN, StepResult
from solvers.scene.scene import Scene
from solvers.scene.settings import Accuracy
from solvers.simulation.simulation import Simulation
from workflows.accuracy.level import COARSE, ITERATION, SMALLEST, Level, Move, next_move
from workflows.accuracy.standing import Standing, percent, standings
from workflows.run.collective import raise_together
from workflows.run.result import Outcome, write_result
from workflows.run.run import run
from workflows.run.watch import Watch

log = logging.getLogger(__name__)
LOCAL = ("max_pressure", "contact_area", "stick_area", "slip_area", "max_slip")  # decided near the contact
MOST = 12  # rounds
ADAPTABLE = ("triangle", "tetrahedron")
TOUCHING = {2: 4, 3: 9}  # nodes; with fewer nothing is known of a contact, its errors least of all
RESOLVING = 3  # rounds at most that are there for that: a corner never touches with more


@dataclass
class Round:
    """A round: its level, and what it found."""

    level: Level
    goals: list[Standing] = field(default_factory=list)
    unknowns: int = 0
    steps: int = 0
    seconds: float = 0.0
    price: float | None = None  # [s] of the next one that is expected to reach the goals; None: not needed

    def __str__(self) -> str:
        goals = ", ".join(map(str, self.goals))
        return f"{self.unknowns} unknowns, {self.steps} steps, {self.seconds:.1f} s: {goals}"

    @property
    def plain(self) -> dict[str, Any]:
        """For result.json."""
        goals = {goal.name: {"value": goal.value, "error": goal.reached, "asked": goal.asked} for goal in self.goals}
        return {"unknowns": self.unknowns, "steps": self.steps, "seconds": self.seconds, "goals": goals}


class Rounds:
    """All rounds of a scene; on every rank."""

    def __init__(self, scene: Scene, say: Callable[[str], None]) -> None:
        """
        Args:
            scene: with goals.
            say: told one line a round, on rank 0.
        """
        self.scene, self.done = scene, list[Round]()
        self._say, self._began = say, clock.perf_counter()
        self._error: Array = np.zeros(0)  # of the present round, by cell, largest of all steps; on rank 0
        self._next: Level | None = Level()
        self._level = Level()

    def __call__(self, folder: str | Path, watch: Watch, resume: bool = False) -> tuple[Outcome, dict[str, Any]]:
        """Run until the goals are reached or the budget is spent; results as `run` leaves them; collective.

        Args:
            folder: where the results stand at the end.
            watch: what is told while the rounds work.
            resume: go on where an earlier one was stopped: its first rounds are solved again, they are the cheap ones.

        Raises:
            SceneError: the error of a goal is not known.
        """
        from mpi4py import MPI

        while self._next is not None:
            self._level, self._next = self._next, None
            self._error = np.zeros(0)
            seen = replace(watch, on_step=self._seeing(watch.on_step))
            scene = self._level.scene(self.scene)
            outcome, content = run(scene, folder, seen, keep=self._judge, sizes=self._level.sizes)
        if outcome.status != "converged" or not self.done:
            return outcome, content
        last = self.done[-1]
        content = content | {"accuracy": {"met": self._met(last), "rounds": [one.plain for one in self.done]}}
        raise_together(MPI.COMM_WORLD, lambda: write_result(outcome.folder, content))
        if self._met(last):
            return outcome, content
        missed = max(last.goals, key=lambda goal: goal.reached / goal.asked)
        sentence = f"reached {percent(missed.reached)} of {missed.name}, {percent(missed.asked)} would take about "
        sentence += "longer than can be told" if last.price is None else f"{last.price:.0f} s"
        return replace(outcome, status="inaccurate", sentence=sentence), content

    def _met(self, one: Round) -> bool:
        return all(goal.met for goal in one.goals)

    def _seeing(self, also: Callable[[StepResult], None]) -> Callable[[StepResult], None]:
        """Keep the errors of cells of each step, on rank 0, beside what else is told of it."""

        def see(step: StepResult) -> None:
            self._error = np.maximum(self._error, step.stress_error) if len(self._error) else step.stress_error
            also(step)

        return see

    def _judge(self, simulation: Simulation, steps: Sequence[StepResult], errors: Sequence[Errors]) -> bool:
        """Whether the results of this round are kept; if not, `_next` is the level of the next one; collective."""
        comm = simulation.mesh.comm
        spent = comm.bcast(clock.perf_counter() - self._began)
        goals = standings(self.scene.accuracy.goals, steps[-1], errors[-1])
        here = Round(self._level, goals, simulation.system.constraints.free_total, len(steps))
        here.seconds = spent - sum(one.seconds for one in self.done)
        self.done.append(here)
        if comm.rank == 0:
            self._say(f"round {len(self.done)}: {here}")
        met, near = self._met(here), any(goal.name.endswith(LOCAL) and not goal.met for goal in goals)
        if met and (len(self.done) > RESOLVING or _resolved(simulation, steps)):
            return True
        move = COARSE if met else next_move(goals, len(steps), self.scene.dim)
        price = comm.bcast(move.price(simulation.seconds, self.scene.dim))
        if len(self.done) == MOST or spent + price > self.scene.accuracy.budget:
            here.price = price if move.enough else None
            return True
        self._next = self._refined(simulation, steps, move, goals, met or near)
        return False

    def _refined(
        self, simulation: Simulation, steps: Sequence[StepResult], move: Move, goals: Sequence[Standing], near: bool
    ) -> Level:
        """The level that a move leads to.

        Args:
            near: whether the mesh is refined around the contacts first.
        """
        level, tolerance = self._level, self._level.tolerance or self.scene.solver.tolerance
        if any(goal.rest > ITERATION * goal.asked for goal in goals):
            tolerance = max(tolerance / 100, SMALLEST)
        level = replace(level, splits=level.splits * move.splits, tolerance=tolerance)
        if move.finer == 1:
            return level
        if simulation.mesh.domain.topology.cell_type.name not in ADAPTABLE:
            return replace(level, factor=level.factor * move.finer)
        return replace(level, sizes=self._sizes(simulation, steps, move, near))

    def _sizes(self, simulation: Simulation, steps: Sequence[StepResult], move: Move, near: bool) -> SizeField | None:
        """Sizes of the next mesh, on rank 0."""
        if simulation.mesh.comm.rank:
            return None
        mesh, problem = simulation.data, simulation.problem
        volume = volumes(mesh.points, mesh.cells)
        middle = mesh.points[mesh.cells].mean(axis=1)
        if problem.model == "axisymmetric":
            volume = volume * 2 * np.pi * middle[:, 0]
        modulus = np.array([problem.bodies[name].E for name in mesh.bodies])[mesh.body]
        error = self._error * np.sqrt(volume / modulus)
        if near:
            error = error * _nearness(simulation, steps, middle)
        return adapted(mesh.points, mesh.cells, error, move.finer)


def _resolved(simulation: Simulation, steps: Sequence[StepResult]) -> bool:
    """Whether all contacts that touch do so with enough nodes; the same on every rank."""
    states = [[step.contacts[c.name].status != OPEN for step in steps] for c in simulation.system.contacts]
    touching = [int(np.any(closed, axis=0).sum()) for closed in states]
    return all(count == 0 or count >= TOUCHING[simulation.scene.dim] for count in touching)


def _nearness(simulation: Simulation, steps: Sequence[StepResult], points: Array) -> Array:
    """Weight (p,) of points (p, d): 1 where bodies touch, less with the square of distance by the contact's size."""
    weight = np.zeros(len(points))
    for c in simulation.system.contacts:
        touched = np.any([step.contacts[c.name].status != OPEN for step in steps], axis=0)
        if touched.any():
            size = float(np.ptp(c.surface.points[touched], axis=0).max()) / 2
            far = cKDTree(c.surface.points[touched]).query(points)[0]
            weight = np.maximum(weight, (size / (size + far)) ** 2 if size else 1.0)
    return weight if weight.any() else np.ones(len(points))


def aiming(scene: Scene, goals: Sequence[str], budget: float | None) -> Scene:
    """A scene with the goals and the budget of the command line in addition to its own.

    Raises:
        SceneError: one is wrong.
    """
    if not goals and budget is None:
        return scene
    own = scene.accuracy
    accuracy = Accuracy(goals={**own.goals, **parsed(goals)}, budget=own.budget if budget is None else budget)
    if not accuracy.goals:
        raise SceneError("--budget: nothing to spend it on; name a goal with --accuracy NUMBER=1%")
    return replace(scene, accuracy=accuracy)


def parsed(words: Sequence[str]) -> dict[str, float]:
    """Goals of the command line, NAME=1% or NAME=0.01.

    Raises:
        SceneError: one is not of that form.

    >>> parsed(["plate.max_pressure=1%", "plate.stick_area=0.05"])
    {'plate.max_pressure': 0.01, 'plate.stick_area': 0.05}
    """
    found = {}
    for word in words:
        name, _, share = word.partition("=")
        try:
            found[name] = float(share[:-1]) / 100 if share.endswith("%") else float(share)
        except ValueError:
            raise SceneError(f"--accuracy {word[:80]}: expected NAME=1% or NAME=0.01") from None
    return found
