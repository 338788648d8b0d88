"""A scene, meshed and prepared once, then solved step by step."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace

from stickslip.geometry.keys import typed
from stickslip.geometry.mesh.mesh import Mesh, build_mesh
from stickslip.geometry.mesh_sizes import SizeField
from stickslip.geometry.protocols import Comm
from stickslip.geometry.user_files.user_file import UserFile
from stickslip.solvers.accuracy.budget import BETTER, TIME, Estimates, bubbles_follow
from stickslip.solvers.accuracy.errors import with_errors
from stickslip.solvers.accuracy.two_level import MeshCorrection
from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.interface.prepare import Volume
from stickslip.solvers.parallel.counters import Clock, Counters
from stickslip.solvers.parallel.released import return_memory
from stickslip.solvers.results.observe import Observer, mesh_data
from stickslip.solvers.results.step_result import ErrorParts, Errors, MeshData, StepResult, quantities
from stickslip.solvers.scene.parameters import Sensitivity
from stickslip.solvers.scene.problem import PlanRow, Problem
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.memory import Counts, Demand, affordable, memory_of, spare
from stickslip.solvers.simulation.plan import planned
from stickslip.solvers.simulation.resolve import refuse_loose_parts
from stickslip.solvers.simulation.script import Script
from stickslip.solvers.simulation.sensitivity import Slopes, neighbours
from stickslip.solvers.stepping.choice import Size, choose
from stickslip.solvers.stepping.history import HistoryRow
from stickslip.solvers.stepping.method_chain import MethodChain, Reached
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.stepper import Accepted, StepError, Stepper
from stickslip.solvers.system.system import System, assemble


@dataclass(frozen=True)
class Bodies:
    """A mesh and, if it was factorised, its stiffness."""

    problem: Problem  # that they were prepared for
    mesh: Mesh
    volume: Volume
    content: str  # hash of the geometry's file, if there is one

    def mesh_for(self, problem: Problem) -> Mesh | None:
        """The mesh, if that of another problem is the same."""
        same = problem.shape == self.problem.shape and replace(problem.request, sizes=None) == self.problem.request
        return self.mesh if same and _content(problem) == self.content else None

    def factor_for(self, system: System) -> FactorisedVolume | None:
        """The factor, if a system on this mesh has the same stiffness, to the last bit; collective."""
        factor = self.volume
        if system.mesh is not self.mesh or not isinstance(factor, FactorisedVolume) or not factor.K.equal(system.K_B):
            return None
        return factor.counting(system.counters)


def _content(problem: Problem) -> str:
    return problem.shape.digest() if isinstance(problem.shape, UserFile) else ""


@dataclass
class Seconds:
    """Wall time by phase [s], of this rank: a collective phase waits for the slowest one."""

    mesh: float = 0.0  # gmsh, and distributing the mesh
    assemble: float = 0.0  # forms, stiffness, loads, contact rows
    prepare: float = 0.0  # factor or multigrid of the bodies, and what the method prepares
    iterate: float = 0.0  # all steps, failed ones included
    error: float = 0.0  # estimates of errors
    output: float = 0.0  # reading results off the steps, and writing files


@dataclass(eq=False, kw_only=True)
class Simulation:
    """A scene that is meshed, assembled and factorised: what `prepare` returns.

    Solve the scene's own history with `steps`, or a history that is decided from step to step with `script`. Both may
    be called several times: each starts at rest at t = 0, and the bodies are not prepared again.

    Collective: every rank of the communicator calls the same methods in the same order. An example::

        simulation = stickslip.prepare(stickslip.read("block"))
        for step in simulation.steps():
            print(step.time, step.contacts["base"].normal_force)

    Attributes:
        scene: what is solved, as it was given to `prepare`; where memory is short without `output.error`.
        problem: the scene, resolved: sides, contact pairs, values in time, active effects.
        data: the mesh as plain arrays, on rank 0.
        counters: work done so far: volume solves, factorisations, linear iterations.
        seconds: wall time so far, by phase.
        clock: the same with parts of phases, calls and volume solves.
        mesh: the distributed mesh with its named parts.
        system: stiffness, loads, constraints and contact rows.
        stepper: solves one step.
        observer: makes the `StepResult` of a solved step.
        demand: the memory that a run was foretold to take.
        slopes: reads the derivatives that the scene asks for; None: it asks for none.
        short: a warning if that is more than there is, else empty; errors may be left out for it, see `affordable`.
        reported: the step that the last result of `steps` was read from.
    """

    scene: Scene
    problem: Problem
    mesh: Mesh
    system: System
    stepper: Stepper
    observer: Observer
    counters: Counters
    data: MeshData = field(repr=False)
    demand: Demand
    short: str = ""
    slopes: Slopes | None = None
    reported: Accepted | None = None

    @property
    def clock(self) -> Clock:
        return self.counters.clock

    @property
    def seconds(self) -> Seconds:
        return Seconds(**{f.name: self.clock.seconds(f.name) for f in fields(Seconds)})

    @property
    def plan(self) -> tuple[PlanRow, ...]:
        """Every effect: its name, whether it is on, and the scene key that asks for it."""
        return self.problem.plan

    @property
    def bodies(self) -> Bodies:
        """The mesh and its factor, for `prepare` of other scenes with the same bodies."""
        return Bodies(self.problem, self.mesh, self.stepper.chain.volume, _content(self.problem))

    def steps(
        self, on_iteration: Callable[[HistoryRow], None] = lambda row: None, done: int = 0, state: State | None = None
    ) -> Iterator[StepResult]:
        """Solve the scene's history, one requested time after the other; collective.

        A step is solved when the iterator is asked for it. Results stay valid when later steps are solved.

        Args:
            on_iteration: called with a `HistoryRow` after each iteration of each attempt, on every rank.
            done: to resume: how many of the requested times are solved already.
            state: to resume: the state at the last of these; None: at rest at t = 0.

        Returns:
            An iterator over `StepResult`, one for each of `scene.requested_times()` after the first `done`, and of a
            clock for each beginning and end of an event in between.

        Raises:
            StepError: a step could not be solved. If some of its substeps succeeded, the result of the last one was
                yielded before; its time is not a requested one.
            NoEquilibriumError: so, and it is shown that contact and friction cannot balance the loads.
        """
        times = self.scene.requested_times()
        if state is not None and self.stepper.clock is not None:
            done = sum(time <= state.time for time in times)
        state = state or self.stepper.start()
        for time in self.clock.counted(times, done):
            while True:
                try:
                    with self.clock.phase("iterate"):
                        accepted = self.stepper.reach(state, time, on_iteration, pauses=True)
                except StepError as failure:
                    if failure.last_good is not None:
                        self.reported = failure.last_good
                        yield self._observed(failure.last_good)
                    raise
                self.reported = accepted
                yield self._observed(accepted)
                state = accepted.state
                if state.time >= time:
                    break

    def _observed(self, accepted: Accepted) -> StepResult:
        with self.clock.phase("output", "results"):
            found = self.observer(accepted)
        if self.slopes is None:
            return found
        with self.clock.phase("output", "sensitivity"):
            return self.slopes(found, accepted, self.scene.parameters())

    def errors(
        self, steps: Sequence[StepResult], on_iteration: Callable[[HistoryRow], None] = lambda row: None
    ) -> tuple[Errors, ...]:
        """Errors of every number by their parts, as far as `output.error_budget` pays for them; collective.

        Call it after the last step: histories on other meshes are solved now, in `seconds.error`.

        Returns:
            For each step its numbers' errors; a part that is not known is None.
        """
        estimates = self.estimates(steps, on_iteration)
        estimates.solve(estimates.choose())
        return estimates.errors

    def estimates(
        self,
        steps: Sequence[StepResult],
        on_iteration: Callable[[HistoryRow], None] = lambda row: None,
        tell: Callable[[str], None] = lambda line: None,
    ) -> Estimates:
        """The errors of a run, to be found piece by piece."""
        return Estimates(self.stepper, steps, self.scene.output, on_iteration, tell)

    def time_step_errors(
        self, steps: Sequence[StepResult], on_iteration: Callable[[HistoryRow], None] = lambda row: None
    ) -> tuple[Errors, ...]:
        """Error of the time steps of every number, from the same history in half as long steps; collective.

        Call it after the last step: the history is solved now on a coarser mesh, in `seconds.error`. Where the state
        does not depend on the path nothing is solved.

        Args:
            steps: results of `steps`, all from the first on.
            on_iteration: as in `steps`, for the iterations on the coarser mesh.

        Returns:
            For each step its numbers' errors, in `time_step`; None where that is not known.
        """
        found = self.estimates(steps, on_iteration).only(TIME)
        return (*found, *(dict.fromkeys(quantities(step), ErrorParts()) for step in steps[len(found) :]))

    def mesh_errors(
        self, steps: Sequence[StepResult], on_iteration: Callable[[HistoryRow], None] = lambda row: None
    ) -> tuple[Errors, ...]:
        """Error of the mesh of every number, from the same history on better cells and on coarser ones; collective.

        Call it after the last step; the histories are solved now, in `seconds.error`.

        Args:
            steps: results of `steps`, all from the first on.
            on_iteration: as in `steps`, for the iterations on the other meshes.

        Returns:
            For each step its numbers' errors, in `mesh` and `geometry`.
        """
        return self.estimates(steps, on_iteration).only(BETTER)

    def release(self) -> None:
        """Free what solving steps needs beside the stiffness; no step can be solved after that; collective.

        A factor stays, which another simulation may have from `bodies`.
        """
        self.stepper.companion = None
        self.stepper.chain.release()
        return_memory(self.mesh.comm)

    def script(self) -> Script:
        """A history whose steps are decided one by one, from rest at t = 0; nothing is prepared again.

        Each script has a history of its own, apart from that of `steps`. Errors of the mesh come from bubbles that
        follow each step, as long as `output.error_budget` pays for them; those of other meshes and of the time steps
        come when a history is over: `run` the `scene` of the script.
        """
        stepper = Stepper(self.system, self.stepper.chain)
        if self.scene.output.error not in (False, "rough") and MeshCorrection.works_for(stepper):
            stepper.companion = self.stepper.companion or MeshCorrection(stepper)
        stepper.neighbours = neighbours(self.scene, stepper)
        observer = replace(self.observer, stepper=stepper)
        slopes = Slopes(observer, stepper.neighbours, self.scene) if stepper.neighbours else None
        asks_none = replace(self.scene, sensitivity=Sensitivity(), uncertainty={})  # of values that are 0 so far
        return Script(asks_none, stepper, observer, slopes)


@typed
def prepare(
    scene: Scene,
    comm: Comm | None = None,
    reached: Reached | None = None,
    sizes: SizeField | None = None,
    bodies: Bodies | None = None,
    counters: Counters | None = None,
) -> Simulation:
    """Mesh a scene, assemble it and factorise it, or set up multigrid; collective. No step is solved.

    Args:
        scene: what to solve, from `read` or built from its parts.
        comm: mpi4py communicator whose ranks share the mesh; None: MPI.COMM_WORLD.
        reached: to resume a run: the methods that it had tried and left. None: the scene's method, or the chain that
            `auto` chooses for the size of the problem.
        sizes: mesh sizes instead of those of the scene, on rank 0; the mesh is then free of grids.
        bodies: of another simulation, `Simulation.bodies`: what is the same in this scene is not prepared again.
        counters: new ones whose clock runs already; None: it begins now.

    Returns:
        The simulation; `steps` solves the scene's history, `script` one of your own.

    Raises:
        SceneError: the scene cannot be solved, for example because nothing holds a body.
        GeometryError: the shape cannot be meshed.
        MachineError: the scene does not fit in memory, or not by the method that it asks for.
    """
    from mpi4py import MPI

    counters = counters or Counters()
    with counters.clock.phase("prepare"):
        problem = planned(scene)
        return_memory(comm or MPI.COMM_WORLD)
    with counters.clock.phase("mesh"):
        mesh = bodies.mesh_for(problem) if bodies and sizes is None else None
        mesh = mesh or build_mesh(problem.shape, replace(problem.request, sizes=sizes), comm or MPI.COMM_WORLD)
    with counters.clock.phase("assemble"):
        system = assemble(problem, mesh, counters)
        refuse_loose_parts(system)
        choice = reached.choice if reached else choose(system)
        counts, size = Counts.of(mesh), Size.of(problem, mesh, system.constraints, system.contacts)
        demand, counters.clock.expected = memory_of(scene.output, counts, size, choice), size.condensed_seconds
        output, short = affordable(scene.output, demand, spare(system.mesh.comm), bool(scene.accuracy.goals))
        scene = replace(scene, output=output)
        system.assembled()  # too
    with counters.clock.phase("prepare"):
        factor = bodies.factor_for(system) if bodies else None
        stepper = Stepper(system, MethodChain(system, reached or Reached(choice, 0, ()), factor))
    with counters.clock.phase("output", "results"):
        data = mesh_data(system)
        observer = Observer.of(stepper, data, with_errors) if scene.output.error else Observer.of(stepper)
    with counters.clock.phase("prepare", "sensitivity"):
        stepper.neighbours = neighbours(scene, stepper)
    slopes = Slopes(observer, stepper.neighbours, scene) if stepper.neighbours else None
    follows = scene.output.error and MeshCorrection.works_for(stepper)
    if follows and bubbles_follow(
        scene.output, size, choice.stages[0], mesh, problem.shape.meshing_time(problem.request)
    ):
        with counters.clock.phase("error", "mesh"):
            stepper.companion = MeshCorrection(stepper)
    return Simulation(
        scene=scene,
        problem=problem,
        mesh=mesh,
        system=system,
        stepper=stepper,
        observer=observer,
        counters=counters,
        data=data,
        demand=demand,
        short=short,
        slopes=slopes,
    )
