"""Scenes as verification solves them: without estimates of errors, or with what no scene file can describe.

Solver settings of the verification problems: surface-uzawa runs matrix-free, as intended for large bodies.

A scene rotated as a whole about any axis: nodes, obstacles and drives; scalar results must not change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from stickslip import Counters, Plane, Scene, Simulation, StepResult
from stickslip.geometry.amplitude import Amplitude, listed_times, value_at
from stickslip.geometry.arrays import Array
from stickslip.geometry.expression import Varying
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.geometry.obstacles.obstacle import AXES, Obstacle, unit
from stickslip.geometry.protocols import Comm
from stickslip.solvers import method_registry
from stickslip.solvers.results.observe import Observer
from stickslip.solvers.scene.loads import Direction
from stickslip.solvers.scene.settings import Solver
from stickslip.solvers.simulation import simulation
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.stepping.method_chain import Reached
from stickslip.solvers.stepping.stepper import Accepted, Stepper
from stickslip.solvers.system.system import System, assemble

Move = Callable[[Array], Array]  # maps points (n, 3) [m] to their new places; a plane model's third coordinate stays 0


def prepare(scene: Scene, comm: Comm | None = None, reached: Reached | None = None) -> Simulation:
    """The scene, prepared without estimates of errors, see `Simulation`: a closed form says more than they do."""
    return simulation.prepare(replace(scene, output=replace(scene.output, error=False)), comm, reached)


def system_of(scene: Scene, move: Move = lambda points: points) -> System:
    """The scene, assembled on a mesh whose nodes were moved."""
    from mpi4py import MPI

    mesh = build_mesh(scene.geometry, scene.request(), MPI.COMM_WORLD)
    mesh.domain.geometry.x[:] = move(mesh.domain.geometry.x.copy())
    return assemble(resolve(scene), mesh, Counters())


def accepted(system: System) -> Iterator[Accepted]:
    """Solve the requested times, one after the other."""
    yield from _march(Stepper(system))


def observed(system: System) -> Iterator[StepResult]:
    """Results of the requested times."""
    stepper = Stepper(system)
    observe = Observer.of(stepper)
    yield from map(observe, _march(stepper))


def _march(stepper: Stepper) -> Iterator[Accepted]:
    state = stepper.start()
    for time in stepper.system.problem.timeline.times:
        step = stepper.reach(state, time, lambda row: None)
        state = step.state
        yield step


def solver(method: str, tolerance: float) -> Solver:
    """`auto` would condense bodies as small as these."""
    surface = "matrix-free" if method == "surface-uzawa" else "auto"
    chosen: Solver = method_registry.Solver(method=method, tolerance=tolerance, surface=surface)
    return chosen


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
