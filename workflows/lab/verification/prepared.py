"""Scenes as verification solves them: without estimates of errors, or with what no scene file can describe."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from stickslip.geometry.arrays import Array
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.geometry.protocols import Comm
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.results.observe import Observer
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation import simulation
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.simulation.simulation import Simulation
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
