"""Mesh, time steps and tolerance of a round, and the cheapest ones that are expected to reach the goals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from geometry.size_field import SizeField
from solvers.scene.scene import Scene, prefixed
from solvers.simulation.simulation import Seconds
from workflows.accuracy.standing import Standing

AIM = 0.7  # of what is asked: estimates scatter from mesh to mesh
FINEST = {2: 0.25, 3: 0.5}  # least factor of the energy error in a round, by dimension: its trend holds no further
FACTORS = 12  # of the energy error, tried from 1 down to the least
SPLITS = (1, 2, 4, 8)  # of the time steps
SOLVING = 1.3  # power of the number of cells with which solving grows
SETUP = 2  # steps that take as long as mesh, assembly and preparation; 1.4 to 3 with all errors, 2D and 3D
RATE = 2.0  # with which errors of numbers fall, by that of the energy norm
ALIKE = 1.3  # times the least error that a move can lead to: others up to there are as good, if they are cheaper
ITERATION = 0.1  # of what is asked: more needs a smaller tolerance
SMALLEST = 1e-12  # tolerance


@dataclass(frozen=True)
class Level:
    """What a round is solved with."""

    factor: float = 1.0  # of the scene's mesh sizes
    sizes: SizeField | None = None  # instead of them; on rank 0
    splits: int = 1  # time steps for each of the scene
    tolerance: float | None = None  # None: that of the scene

    def scene(self, scene: Scene) -> Scene:
        """The scene of the round, of order 1: of that the errors are known."""
        with prefixed("geometry"):
            geometry = scene.geometry if self.factor == 1 else scene.geometry.refined(self.factor)
            geometry = replace(geometry, order=1)
        steps = replace(scene.steps, count=scene.steps.count * self.splits)
        solver = scene.solver if self.tolerance is None else replace(scene.solver, tolerance=self.tolerance)
        return replace(scene, geometry=geometry, steps=steps, solver=solver)


@dataclass(frozen=True)
class Move:
    """From one round to the next."""

    finer: float  # factor of the error in the energy norm
    splits: int  # factor of the number of time steps
    enough: bool  # whether it is expected to reach all goals

    def error(self, goal: Standing) -> float:
        """What it is expected to leave of a goal's error."""
        return float(goal.mesh * self.finer**RATE + goal.time_step / self.splits + goal.rest)

    def work(self, steps: int, dim: int) -> float:
        """What it costs, in a unit that no clock decides: the same moves are taken on every machine.

        Args:
            steps: of the last round.
        """
        return float(self.finer ** (-dim * SOLVING) * (SETUP + steps * self.splits))

    def price(self, seconds: Seconds, dim: int) -> float:
        """About how long it takes [s], after what the last round took."""
        cells = self.finer**-dim
        solving = seconds.assemble + seconds.prepare + (seconds.iterate + seconds.error) * self.splits
        return float(seconds.mesh * cells + solving * cells**SOLVING)


COARSE = Move(0.5, 1, enough=False)  # where a contact is too coarse for its errors to be known


def next_move(goals: Sequence[Standing], steps: int, dim: int) -> Move:
    """The cheapest move that is expected to reach all goals; if none is, the cheapest of those that lower errors most.

    Args:
        steps: of the last round.
    """

    def off(move: Move) -> float:
        return max(move.error(goal) / goal.asked for goal in goals)

    factors = FINEST[dim] ** (np.arange(FACTORS) / (FACTORS - 1))
    moves = [Move(float(f), splits, False) for f, splits in product(factors, SPLITS) if f < 1 or splits > 1]
    least = max(AIM, ALIKE * min(map(off, moves)))
    chosen = min((move for move in moves if off(move) <= least), key=lambda move: move.work(steps, dim))
    return replace(chosen, enough=off(chosen) <= AIM)
