"""A scene rotated as a whole about any axis: nodes, obstacles and drives; scalar results must not change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from stickslip.geometry.amplitude import Amplitude, listed_times, value_at
from stickslip.geometry.arrays import Array
from stickslip.geometry.expression import Varying
from stickslip.geometry.obstacles.obstacle import AXES, Obstacle, unit
from stickslip.geometry.obstacles.plane import Plane
from stickslip.solvers.scene.loads import Direction
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.system.system import System
from stickslip.workflows.lab.verification.prepared import system_of


def rotation(axis: tuple[float, float, float], angle: float) -> Array:
    """Rotation matrix (3, 3) of a right-handed turn.

    >>> rotation((0.0, 0.0, 2.0), np.pi / 2).round(12)[0]
    array([ 0., -1.,  0.])
    """
    cross = np.cross(np.eye(3), unit(axis)).T * -1
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def turned_system(scene: Scene, Q: Array) -> System:
    """A rotated scene; its obstacles are planes, its supports prescribe all components; a 2D scene turns about z."""
    turn = Q[: scene.dim, : scene.dim]
    planes = {name: _plane(obstacle, turn) for name, obstacle in scene.obstacles.items()}
    end = scene.steps.end
    supports = {
        name: replace(support, displacement=_path(support.displacement, turn, end))
        for name, support in scene.supports.items()
    }
    return system_of(replace(scene, obstacles=planes, supports=supports), lambda points: points @ Q.T)


def _plane(obstacle: Obstacle, Q: Array) -> Plane:
    assert isinstance(obstacle, Plane)
    return replace(obstacle, point=_times(Q, obstacle.point), normal=_times(Q, obstacle.normal))


def _path(displacement: Mapping[Direction, Varying], Q: Array, end: float) -> dict[Direction, Amplitude]:
    """A table of the same times for each component, turned; numbers alone are ramps, expressions are not known."""
    tables = {axis: value for axis, value in displacement.items() if not isinstance(value, str)}
    times = sorted({time for table in tables.values() for time in listed_times(table)}) or [0.0, end]
    axes = AXES[: len(Q)]
    path = np.array([[value_at(tables[axis], time, end) for axis in axes] for time in times]) @ Q.T
    return {axis: tuple(zip(times, column, strict=True)) for axis, column in zip(axes, path.T.tolist(), strict=True)}


def _times(Q: Array, vector: ArrayLike) -> tuple[float, ...]:
    return tuple((Q @ np.asarray(vector)).tolist())
