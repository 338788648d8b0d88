"""The history of a run once more, with the same bodies on other cells or of another order, for its errors.

Cells of another order are the run's own: gmsh makes the same mesh again, and puts the nodes between corners on the
curved surfaces. Coarser cells are those of a fresh mesh with all sizes larger; where the run's own mesh was cut from
that of a file, the file's is cut less. Meshes that are cut from the run's are passed as they are, see `nested_run`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.errors import SceneError, StickslipError
from stickslip.geometry.mesh.mesh import Mesh, build_mesh
from stickslip.geometry.shape import Shape
from stickslip.solvers.accuracy.areas import areas_inside_facets
from stickslip.solvers.accuracy.bubbles import beyond
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.results.observe import Observer
from stickslip.solvers.results.recovered_stress import RecoveredStress
from stickslip.solvers.results.step_result import Quantity, StepResult
from stickslip.solvers.scene.settings import Solver
from stickslip.solvers.stepping.choice import choose
from stickslip.solvers.stepping.history import HistoryRow
from stickslip.solvers.stepping.method_chain import MethodChain, Reached
from stickslip.solvers.stepping.stepper import Accepted, StepError, Stepper
from stickslip.solvers.system.system import System, assemble

log = logging.getLogger(__name__)
OnIteration = Callable[[HistoryRow], None]
T = TypeVar("T")
FINER = 1.5  # times the cells along a line, where nothing but smaller cells is better: three to four times the unknowns
LOOSE = 1e-4  # tolerance that moves nine in ten differences of orders 1 and 2 by less than 1 %, for half the iterations


class OtherHistory:
    """Solves histories of a run's scene with its bodies on another mesh, by the default method; collective.

    Attributes:
        stepper: of the bodies on the other mesh.
        observe: makes the results of its steps; `corrected` are areas with edges between nodes, and stresses of bodies
            at corners of cells.
    """

    def __init__(
        self, own: System, mesh: Mesh, on_iteration: OnIteration = lambda row: None, loosest: float = 0.0
    ) -> None:
        """Prepare the bodies; collective.

        Args:
            own: of the run, at whose tolerance steps are solved.
            on_iteration: called after each iteration, on every rank.
            loosest: another tolerance, where volume solves are iterative and it is the looser one.

        Raises:
            StickslipError: they cannot be prepared.
        """
        self._own, self._on_iteration = own, on_iteration
        self._work = Counters()
        solver = replace(Solver.default(), tolerance=own.problem.solver.tolerance)
        finer = beyond(mesh) if mesh.degree > own.mesh.degree else None  # loads narrower than a facet show
        system = assemble(replace(own.problem, shape=mesh.shape, solver=solver), mesh, self._work, finer)
        choice = choose(system)
        if choice.stages[0].surface == "matrix-free":
            solver = replace(solver, tolerance=max(solver.tolerance, loosest))
            system = replace(system, problem=replace(system.problem, solver=solver))
        system.course.batches = own.course.batches
        self.stepper = Stepper(system, MethodChain(system, Reached(choice, 0, ())))
        recovered = RecoveredStress(system)

        def sharper(observe: Observer, accepted: Accepted, step: StepResult) -> StepResult:
            areas = {str(key): area for key, area in areas_inside_facets(system.contacts, step).items()}
            return replace(step, corrected=largest_stresses(observe, recovered, accepted, step) | areas)

        self.observe = Observer.of(self.stepper, estimate=sharper)

    @classmethod
    def of_order(cls, own: System, order: int, on_iteration: OnIteration = lambda row: None) -> OtherHistory:
        """That of the run's own cells with displacements of another order; arguments and errors as above.

        Loose volume solves are enough for a difference of two orders.
        """
        return cls(own, own.mesh.of_order(order), on_iteration, LOOSE)

    @classmethod
    def coarser(cls, own: System, factor: float, on_iteration: OnIteration = lambda row: None) -> OtherHistory:
        """That of a fresh mesh with sizes `factor` times as long; arguments and errors as above.

        Raises:
            SceneError: the mesh is that of a file, and it was not cut.
        """
        return cls(own, coarser(own.mesh, factor), on_iteration)

    @classmethod
    def on(cls, own: System, shape: Shape, on_iteration: OnIteration = lambda row: None) -> OtherHistory:
        """That of another shape, meshed as the run's own; arguments and errors as above."""
        mesh = build_mesh(shape, own.mesh.request, own.mesh.comm)
        return cls(own, mesh, on_iteration, LOOSE if mesh.degree > own.mesh.degree else 0.0)

    def __call__(self, times: Sequence[float], wanted: Sequence[float] | None = None) -> tuple[StepResult, ...]:
        """Solve a history from rest: its results, up to a step that cannot be solved; arguments as below."""
        found = list[StepResult]()
        try:
            found.extend(self.results(times, wanted))
        except StickslipError as error:
            log.info("no error of the mesh or of the time steps from there on: %s", error)
        return tuple(found)

    def results(self, times: Sequence[float], wanted: Sequence[float] | None = None) -> Iterator[StepResult]:
        """Solve a history from rest: yield its results, each when it is found; collective.

        Args:
            times: at the ends of its steps [s].
            wanted: those of them that results are asked for; None: all.

        Raises:
            StepError: a step cannot be solved, in parts neither.
        """
        return self.read(times, self.observe, wanted)

    def read(
        self, times: Sequence[float], of: Callable[[Accepted], T], wanted: Sequence[float] | None = None
    ) -> Iterator[T]:
        """The same, `of` each step in place of its result."""
        asked = frozenset(times if wanted is None else wanted)
        try:
            for time, accepted in zip(times, self.steps(times), strict=True):
                if time in asked:
                    yield of(accepted)
        finally:
            self._own.counters.error_solves += self._work.volume_solves + self._work.error_solves
            self._work.volume_solves = self._work.error_solves = 0

    def steps(self, times: Sequence[float]) -> Iterator[Accepted]:
        """Solve a history from rest step by step; collective.

        Raises:
            StepError: one cannot be solved, in parts neither.
        """
        chain, state = self.stepper.chain, self.stepper.start()
        for time in self._own.counters.clock.counted(times):
            try:
                with chain.repeating(self.stepper.system):
                    accepted = self.stepper.reach(state, time, self._on_iteration)
            except StepError:  # as a whole
                accepted = self.stepper.reach(state, time, self._on_iteration)
            yield accepted
            state = accepted.state


def has_coarser(mesh: Mesh) -> bool:
    """Whether there is a coarser mesh than one: not than that of a file, unless it was cut; collective."""
    try:
        mesh.shape.refined(2.0)
    except SceneError:
        return bool(mesh.comm.bcast(mesh.request.sizes is not None))
    return True


def coarser(mesh: Mesh, factor: float) -> Mesh:
    """A fresh mesh with sizes `factor` times as long, or shorter; of a file's that was cut, cut to these; collective.

    Raises:
        SceneError: it is the mesh of a file.
        GeometryError: it cannot be made.
    """
    shape, sizes = mesh.shape, mesh.request.sizes and mesh.request.sizes.times(factor)
    try:
        shape = shape.refined(factor)
    except SceneError:
        if not mesh.comm.bcast(mesh.request.sizes is not None) or factor < 1:  # sizes are on rank 0
            raise
    return build_mesh(shape, replace(mesh.request, sizes=sizes), mesh.comm)


def cells_along(mesh: Mesh) -> float:
    """Number of cells along a line, if all were alike; collective."""
    return float(mesh.domain.topology.index_map(mesh.dim).size_global ** (1 / mesh.dim))


def largest_stresses(
    observe: Observer, recovered: RecoveredStress, accepted: Accepted, step: StepResult
) -> dict[str, float]:
    """Largest stresses of bodies [Pa] at corners of cells, by `Quantity`, not at midpoints as reported; collective."""
    stress = observe.stress(accepted.state.u, accepted.state.initial)
    system = accepted.stepper.system
    u, cells = observe.stress.displacement.x.array.reshape(-1, system.mesh.dim), dx.cell_dofs(system.space)
    found = zip(step.bodies, recovered.largest(u, cells, stress), strict=True)
    return {str(Quantity("bodies", name, "max_von_mises")): size for name, size in found}
