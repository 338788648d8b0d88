"""A round's mesh, time steps and tolerance, and the cheapest ones that are expected to reach the goals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, Literal

import numpy as np
from scipy.spatial import cKDTree

from stickslip.geometry.arrays import Array, Bools
from stickslip.geometry.errors import prefixed
from stickslip.geometry.mesh_sizes import SizeField
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.results.step_result import OPEN, StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Seconds, Simulation
from stickslip.workflows.accuracy.goals import Standing

AIM = 0.7  # of what is asked: estimates scatter from mesh to mesh
FINEST = {2: 0.25, 3: 0.5}  # least factor of the energy error in a round, by dimension: its trend holds no further
SPLITS = (1, 2, 4, 8)  # of the time steps
SOLVING = 1.3  # power of the number of cells with which solving grows
UNKNOWNS = {2: 4, 3: 7}  # of order 2 for each of order 1 on the same mesh, by dimension
GAIN = 7.0  # factor by which order 2 has smaller errors on the same mesh: 7 (`raous`), 11 (`cattaneo`), 24 (`punch`)
ALIKE = 1.3  # times the least error that a move can lead to: others up to there are as good, if they are cheaper
ITERATION = 0.1  # of what is asked: more needs a smaller tolerance
TIGHTER = 100  # times smaller


@dataclass(frozen=True)
class Level:
    """Mesh, order, time steps and tolerance of a round."""

    order: Literal[1, 2] = 1
    highest: Literal[1, 2] = 2  # order to which it may go
    factor: float = 1.0  # of the scene's mesh sizes
    sizes: SizeField | None = None  # instead of them; on rank 0
    splits: int = 1  # time steps for each of the scene
    tolerance: float | None = None  # None: that of the scene
    pays: bool = False  # for its errors as much as the rounds have left; else as a run does

    def scene(self, scene: Scene) -> Scene:
        """The scene of the round."""
        with prefixed("geometry"):
            geometry = scene.geometry if self.factor == 1 else scene.geometry.refined(self.factor)
            geometry = replace(geometry, order=self.order)
        clock, n = scene.steps.clock, self.splits
        finer = {"count": scene.steps.count * n} if clock is None else {"clock": replace(clock, error=clock.error / n)}
        cycle = scene.steps.cycle and replace(scene.steps.cycle, error=scene.steps.cycle.error / n)
        steps = replace(scene.steps, cycle=cycle, **finer)
        solver = scene.solver if self.tolerance is None else replace(scene.solver, tolerance=self.tolerance)
        return replace(scene, geometry=geometry, steps=steps, solver=solver)


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
        order = "order 2, " if self.level.order == 2 else ""
        return f"{order}{self.unknowns} unknowns, {self.steps} steps, {self.seconds:.1f} s: {goals}"

    @property
    def met(self) -> bool:
        """Whether it has reached all goals."""
        return all(goal.met for goal in self.goals)

    @property
    def plain(self) -> dict[str, Any]:
        """For result.json."""
        goals = {goal.name: {"value": goal.value, "error": goal.reached, "asked": goal.asked} for goal in self.goals}
        told = {"order": self.level.order, "unknowns": self.unknowns, "steps": self.steps, "seconds": self.seconds}
        return told | {"goals": goals}


@dataclass(frozen=True)
class Move:
    """A step from one round to the next."""

    finer: float  # factor of the error in the energy norm, beside what the order changes
    splits: int  # factor of the number of time steps
    enough: bool = False  # whether it is expected to reach all goals
    order: Literal[1, 2] = 1  # of the next round
    raises: bool = False  # whether the last one had a lower order

    def error(self, goal: Standing) -> float:
        """Return the error of a goal that it is expected to leave: of the mesh with the square of the energy norm's."""
        gain = GAIN if self.raises else 1.0
        rest = goal.rest / TIGHTER if is_loose(goal) else goal.rest
        return float(goal.mesh / gain * self.finer**2 + goal.time_step / self.splits + rest + goal.law)

    def cells(self, dim: int) -> float:
        """Factor of the number of cells; of unknowns, where the order changes."""
        return float(self.finer ** (-dim / self.order) * (UNKNOWNS[dim] if self.raises else 1))

    def work(self, steps: int, dim: int) -> float:
        """Return its cost, in a unit that no clock decides: the same moves are taken on every machine.

        Mesh, assembly and preparation take as long as two steps; 1.4 to 3 with all errors, 2D and 3D.

        Args:
            steps: of the last round.
        """
        return float(self.cells(dim) ** SOLVING * (2 + steps * self.splits))

    def price(self, seconds: Seconds, dim: int, grows: float = 1.0) -> float:
        """About how long it takes [s], after what the last round took.

        Args:
            grows: share of the seconds of solving that grow with the unknowns and the steps.
        """
        cells = self.cells(dim)
        once, each = seconds.assemble + seconds.prepare, seconds.iterate + seconds.error
        solving = (once + each * self.splits) * cells**SOLVING
        return float(seconds.mesh * cells + (1 - grows) * (once + each) + grows * solving)


def is_loose(goal: Standing) -> bool:
    """Whether a goal needs a smaller tolerance."""
    return goal.rest > ITERATION * goal.asked


def next_move(
    goals: Sequence[Standing],
    steps: int,
    dim: int,
    orders: Sequence[Literal[1, 2]] = (1,),
    fits: Callable[[Move], bool] = lambda move: True,
) -> Move | None:
    """The cheapest move that is expected to reach all goals; if none is, the cheapest of those that lower errors most.

    Args:
        steps: of the last round.
        orders: of the last round, and those above it that the next one may have.
        fits: whether there are time and memory for a move.

    Returns:
        None: none that fits lowers the errors.
    """

    def off(move: Move) -> float:
        return max(move.error(goal) / goal.asked for goal in goals)

    factors = FINEST[dim] ** (np.arange(12) / 11)
    options = product(orders, factors, SPLITS)
    moves = [Move(float(f), splits, order=order, raises=order > orders[0]) for order, f, splits in options]
    loose = any(map(is_loose, goals))
    moves = [move for move in moves if (move.finer < 1 or move.splits > 1 or move.raises or loose) and fits(move)]
    least = max(AIM, ALIKE * min(map(off, moves), default=0.0))
    chosen = min((move for move in moves if off(move) <= least), key=lambda move: move.work(steps, dim), default=None)
    if chosen is None or ALIKE * off(chosen) > max(goal.reached / goal.asked for goal in goals):
        return None
    return replace(chosen, enough=off(chosen) <= AIM)


def nearness(simulation: Simulation, steps: Sequence[StepResult], points: Array) -> Array:
    """Weight (p,) of points (p, d): 1 where bodies touch, less with the square of distance by the contact's size.

    A contact is as large as the facets that touch: of one node it has the size of cells.
    """
    weight = np.zeros(len(points))
    for c in simulation.system.contacts:
        touched = _touched(c, steps)
        if touched.any():
            facets = c.surface.facets[touched[c.surface.facets].any(axis=1)]
            size = float(np.ptp(c.surface.points[facets.ravel()], axis=0).max()) / 2
            far = cKDTree(c.surface.points[touched]).query(points)[0]
            weight = np.maximum(weight, (size / (size + far)) ** 2)
    return weight if weight.any() else np.ones(len(points))


def finer_sides(wanted: SizeField, simulation: Simulation, steps: Sequence[StepResult], factor: float) -> SizeField:
    """Sizes of cells of order 2 that are no larger than `factor` times the present facets where bodies touch.

    Tractions of order 2 are as rough as those of order 1: what they leave in forces falls with the square of the
    facets' size, however fine the cells behind them are, and the energy norm's estimate does not see it. Measured on
    `raous`: .94, .23, .057 % of the friction force for 8, 16, 32 facets, with cells of 1/8 or of 1/32 behind them.
    """
    sizes = wanted.sizes.copy()
    for c in simulation.system.contacts:
        facets = c.surface.facets
        corners = c.surface.points[facets[_touched(c, steps)[facets].any(axis=1)][:, : c.surface.dim]]
        if len(corners):
            lengths = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
            far, near = cKDTree(corners.reshape(-1, c.surface.dim)).query(wanted.points)
            length = np.repeat(lengths, c.surface.dim)[near]
            # nodes of the other side lie nearer, and no nodes behind the surface
            sizes = np.where(far < 0.6 * length, np.minimum(sizes, factor * length), sizes)
    return replace(wanted, sizes=sizes)


def _touched(c: ContactRows, steps: Sequence[StepResult]) -> Bools:
    """Nodes (n,) of a contact that touch in some step."""
    return np.asarray(np.any([step.contacts[c.name].status != OPEN for step in steps], axis=0))
