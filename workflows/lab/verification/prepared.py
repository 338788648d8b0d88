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
from stickslip.solvers.stepping.history import OnIteration
from stickslip.solvers.stepping.method_chain import Reached
from stickslip.solvers.stepping.stepper import Accepted, Stepper
from stickslip.solvers.system.system import System, assemble

PRESSED = {2: 0.1, 3: 0.05}  # [m] of the ready scenes `block` and `cube`, by dimension
Move = Callable[[Array], Array]  # maps points (n, 3) [m] to their new places; a plane model's third coordinate stays 0


def prepare(scene: Scene, comm: Comm | None = None, reached: Reached | None = None) -> Simulation:
    """The scene, prepared without estimates of errors, see `Simulation`: a closed form says more than they do."""
    return simulation.prepare(replace(scene, output=replace(scene.output, error=False)), comm, reached)


def solved(scene: Scene) -> tuple[Simulation, list[StepResult]]:
    """The scene, prepared, and its steps."""
    simulation = prepare(scene)
    return simulation, [*simulation.steps()]


def system_of(scene: Scene, move: Move = lambda points: points) -> System:
    """The scene, assembled on a mesh whose nodes were moved."""
    from mpi4py import MPI

    mesh = build_mesh(scene.geometry, scene.request(), MPI.COMM_WORLD)
    mesh.domain.geometry.x[:] = move(mesh.domain.geometry.x.copy())
    return assemble(resolve(scene), mesh, Counters())


def accepted(system: System) -> Iterator[Accepted]:
    """Solve the requested times, one after the other."""
    yield from march(Stepper(system))


def observed(system: System) -> Iterator[StepResult]:
    """Results of the requested times."""
    stepper = Stepper(system)
    observe = Observer.of(stepper)
    yield from map(observe, march(stepper))


def march(stepper: Stepper, on_iteration: OnIteration = lambda row: None) -> Iterator[Accepted]:
    """Solve the requested times, one after the other, without results for readers."""
    state = stepper.start()
    for time in stepper.system.problem.timeline.times:
        step = stepper.reach(state, time, on_iteration)
        state = step.state
        yield step


def pressed(
    dim: int, n: int, drag: float | None = None, height: float = 1.0, at_once: bool = False, further: bool = False
) -> list[str]:
    """Settings of the ready scene `block` (dim 2) or `cube` (dim 3): n cells over the height, pressed, then dragged.

    Args:
        drag: displacement of the top along x [m], in 3D half of it along y; None: the scene's own.
        height: times the cube's: a slab of the same cells; its displacements are smaller by the same factor.
        at_once: whether it is pressed and dragged in one step.
        further: whether a third step drags it on by a fifth.
    """
    size, own = (2 / n, 0.05) if dim == 2 else (1 / n, 0.02)
    moved = height * (own if drag is None else drag)
    ends = [(1 if at_once else 2, moved), *([(3, 1.2 * moved)] if further else [])]
    tables = {
        axis: [[0, 0], *([] if at_once else [[1, 0]]), *([t, share * x] for t, x in ends)]
        for axis, share in zip("xy"[: dim - 1], (1.0, 0.5), strict=False)
    }
    tables["xyz"[dim - 1]] = [[0, 0], [1, -PRESSED[dim] * height]]
    shape = {"mesh_size": size} | ({"contact_mesh_size": size} if dim == 2 else {})
    return [
        *(f"geometry.{key}={value!r}" for key, value in shape.items()),
        *([f"geometry.height={height!r}"] if height != 1 else []),
        f"supports.top.displacement={{ {', '.join(f'{axis} = {table}' for axis, table in tables.items())} }}",
        f"steps={{ end = {ends[-1][0]}.0, count = {ends[-1][0]} }}",
    ]


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
