"""A scene solved step by step: plan, mesh, system, surface problem, steps."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields
from typing import Any

from geometry.mesh.mesh import Mesh, build_mesh
from solvers.parallel.counters import Counters
from solvers.results.observe import Observer, mesh_data
from solvers.results.step_result import MeshData, StepResult
from solvers.scene.problem import PlanRow, Problem
from solvers.scene.scene import Scene
from solvers.simulation.plan import planned
from solvers.simulation.script import Script
from solvers.stepping.attempts import Attempts, Reached
from solvers.stepping.history import HistoryRow
from solvers.stepping.state import State
from solvers.stepping.stepper import StepError, Stepper
from solvers.system.system import System, assemble


@dataclass
class Seconds:
    """Wall time by phase [s]."""

    mesh: float = 0.0
    assemble: float = 0.0
    prepare: float = 0.0
    iterate: float = 0.0
    output: float = 0.0

    def add(self, earlier: Seconds) -> None:
        """Take in those of a process before this one."""
        for f in fields(self):
            setattr(self, f.name, getattr(self, f.name) + getattr(earlier, f.name))


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """Everything prepared; `steps` marches. Collective: every rank of the communicator takes part."""

    scene: Scene
    problem: Problem
    mesh: Mesh
    system: System
    stepper: Stepper
    observer: Observer
    counters: Counters
    seconds: Seconds
    data: MeshData = field(repr=False)

    @property
    def plan(self) -> tuple[PlanRow, ...]:
        """Every effect, whether it is active, and the scene key that calls for it."""
        return self.problem.plan

    def steps(
        self,
        on_iteration: Callable[[HistoryRow], None] = lambda row: None,
        done: int = 0,
        state: State | None = None,
    ) -> Iterator[StepResult]:
        """Results of the requested times, one after the other; `stepper.reported` is what the last one was read off.

        Args:
            done: how many of them were reported before, and the state that the last of these left.

        Raises:
            StepError: a step could not be solved; its last good substep was yielded before.
        """
        observe = self.observer
        state = state or self.stepper.start()
        for time in self.scene.requested_times()[done:]:
            began = clock.perf_counter()
            try:
                try:
                    accepted = self.stepper.reach(state, time, on_iteration)
                finally:  # a step that was given up or interrupted has its cost too
                    self.seconds.iterate += clock.perf_counter() - began
            except StepError as failure:
                if failure.reached is not None:
                    self.stepper.reported = failure.reached
                    yield observe(failure.reached)
                raise
            self.stepper.reported = accepted
            solved = clock.perf_counter()
            result = observe(accepted)
            self.seconds.output += clock.perf_counter() - solved
            yield result
            state = accepted.state

    def script(self) -> Script:
        """A history of its own, from rest, whose steps are told one by one; nothing is prepared again."""
        return Script(self.scene, self.stepper, self.observer)


def prepare(scene: Scene, comm: Any = None, reached: Reached | None = None) -> Simulation:
    """Plan, mesh, assemble, factorise; collective.

    Args:
        reached: how far down its chain of methods a run has come that is to be resumed.

    Raises:
        SceneError: the scene cannot be solved, known before solving.
        GeometryError: the shape cannot be meshed.
    """
    from mpi4py import MPI

    problem = planned(scene)
    seconds, counters = Seconds(), Counters()
    began = clock.perf_counter()
    mesh = build_mesh(problem.shape, problem.request, comm or MPI.COMM_WORLD)
    meshed = clock.perf_counter()
    system = assemble(problem, mesh, counters)
    _ = system.K_B  # assembled too
    assembled = clock.perf_counter()
    stepper = Stepper(system, Attempts(system, reached))
    seconds.mesh, seconds.assemble = meshed - began, assembled - meshed
    seconds.prepare = clock.perf_counter() - assembled
    return Simulation(
        scene=scene,
        problem=problem,
        mesh=mesh,
        system=system,
        stepper=stepper,
        observer=Observer.of(stepper),
        counters=counters,
        seconds=seconds,
        data=mesh_data(system),
    )
