"""Motion of rigid obstacles: prescribed, or unknown if a force drives them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.fem.constraints import AXES
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.timeline import Course, Place


@dataclass(frozen=True)
class Obstacles:
    """The obstacles of a problem; `driven` (o,) are the motions [m] that forces drive, unknowns of the problem."""

    problem: Problem
    course: Course

    @cached_property
    def driven(self) -> tuple[tuple[str, int], ...]:
        """Name of the obstacle and index of the axis, for each unknown motion (o,)."""
        return tuple((name, AXES[axis]) for name, axis in self.problem.driven)

    def driving_force(self, time: float) -> Array:
        """Forces (o,) [N] on the driven obstacles at a time [s]."""
        places = [Place("obstacles", name, "force", axis) for name, axis in self.problem.driven]
        return np.array([self.course.value(place, time) for place in places], float)

    def translation(self, name: str, time: float, driven: Array) -> Array:
        """Translation (d,) [m] of an obstacle at a time [s]; driven: the unknown motions (o,) [m]."""
        moved = self._prescribed(name, time)
        for (other, axis), size in zip(self.driven, driven, strict=True):
            moved[axis] += size * (other == name)
        return moved

    def motion(self, pair: str, points: Array, time: float, driven: Array) -> Array:
        """Motion of a pair's obstacle (m, d) [m], at its points closest to `points`, or if tied at `points` themselves.

        Args:
            pair: name of the contact.
            points: (m, d) [m].
            time: [s].
            driven: unknown motions (o,) [m].
        """
        known = self.problem.pairs[pair]
        assert known.obstacle is not None
        obstacle, name = self.problem.obstacles[known.obstacle], known.obstacle
        angle = 0.0
        if obstacle.rotation is not None:
            angle = self.course.value(Place("obstacles", name, "rotation", "angle"), time)
        tied = known.contact.normal.ties
        motion = obstacle.motion(points, self._prescribed(name, time), angle, tied=tied)
        for (other, axis), size in zip(self.driven, driven, strict=True):
            if other == name:
                motion[:, axis] += size
        return motion

    def motions(self, contacts: tuple[ContactRows, ...], time: float, driven: Array) -> dict[str, Array]:
        """Motion (n_all, d) [m] of each contact's obstacle at the nodes of its surface; zero between bodies."""
        return {
            c.name: np.zeros(c.points.shape) if c.master else self.motion(c.name, c.points, time, driven)
            for c in contacts
        }

    def resultants(self, pair: str, force: Array) -> Array:
        """Components (o,) [N] of a contact's force (d,) [N] along the driven motions; zero for other obstacles."""
        against = self.problem.pairs[pair].obstacle
        return np.array([force[axis] * (name == against) for name, axis in self.driven], float)

    def unit_motions(self, pair: str, count: int) -> Mapping[int, Array]:
        """Displacement (count d,) of `count` points for a motion of 1 m, by index of the pair's unknown motions."""
        against = self.problem.pairs[pair].obstacle
        unit = np.eye(self.problem.dim)
        return {k: np.tile(unit[axis], count) for k, (name, axis) in enumerate(self.driven) if name == against}

    def _prescribed(self, name: str, time: float) -> Array:
        given = self.problem.obstacles[name].displacement
        places = [(axis, Place("obstacles", name, "displacement", axis)) for axis in "xyz"[: self.problem.dim]]
        return np.array([self.course.value(place, time) if axis in given else 0.0 for axis, place in places])
