"""Derivatives of the numbers of a step by numbers of the scene, and what the uncertainty of these leaves in them.

Differences of a solution's neighbours are read by the same walk as the solution itself: see `Neighbours`. An area is a
sum of weights of nodes, which no small change alters: its derivative is that of an area whose edge moves, see
`MovingEdges`, and none where there is no edge.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from mpi4py import MPI

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import ROUNDING
from stickslip.geometry.errors import SceneError, SolverError, StickslipError
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.solvers.accuracy.areas import MovingEdges
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.results.observe import Observer
from stickslip.solvers.results.step_result import Quantity, Slope, StepResult, number_of, quantities
from stickslip.solvers.scene.parameters import scaled
from stickslip.solvers.scene.record import Value
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.timeline import Course, Timeline
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.stepping.sensitivity import STEP, Neighbours, beside, condensed, refuse
from stickslip.solvers.stepping.stepper import Accepted, Stepper
from stickslip.solvers.stepping.substep import SubstepSolver
from stickslip.solvers.stepping.update import at_rest
from stickslip.solvers.system.system import System, assemble

log = logging.getLogger(__name__)
WITHOUT_STIFFNESS = ("contacts", "obstacles", "supports", "loads")  # tables that the stiffness of bodies does not see
AREAS = ("contact_area", "stick_area", "slip_area")


def neighbours(scene: Scene, stepper: Stepper) -> Neighbours | None:
    """The neighbours that a scene asks for, on the mesh of its solution; None: it asks for none.

    Raises:
        SceneError: a number has no derivative that could be found, with the reason.
    """
    asked, values = scene.derived_by, scene.parameters()
    if not asked:
        return None
    if stepper.clock is not None:
        raise SceneError("sensitivity: is not built for steps of a clock; give steps.count instead")
    slack = [bolt.shortening for bolt in stepper.system.initial.tightened if bolt.tension is None]
    if slack:
        names = ", ".join(f"{place.table}.{place.name}" for place in slack)
        raise SceneError(f"sensitivity: is not built for springs that act in one way, as {names}")
    refuse(stepper)
    stepper.system.course.found = {bolt.shortening: 0.0 for bolt in stepper.system.initial.tightened}  # until a step
    try:
        base = condensed(stepper)
    except SolverError as error:
        raise SceneError(f"sensitivity: {error}") from None
    with stepper.system.counters.for_error():
        scale = base.posed(at_rest(base.system, base.cone), scene.requested_times()[0])[0].u_ref
    pairs, sizes = dict[str, tuple[SubstepSolver, SubstepSolver]](), dict[str, float]()
    for key in stepper.system.counters.clock.counted(asked):
        try:
            pair, size = _pair(scene, base, key, STEP), STEP
            moved = max(
                (
                    np.abs(one.gap - two.gap).max(initial=0.0) / 2
                    for one, two in zip(*(each.cone.contacts for each in pair), strict=True)
                ),
                default=0.0,
            )
            if moved > STEP * scale > 0:  # of a place far from the origin even a small part is a large gap
                size = STEP * STEP * scale / moved
                pair = _pair(scene, base, key, size)
        except StickslipError as error:
            if key in scene.sensitivity.parameters or key in scene.uncertainty:
                raise SceneError(f"sensitivity: {key}: {error}") from None
            log.warning("sensitivity: %s is left out: %s", key, error)
        else:
            pairs[key], sizes[key] = pair, size * float(np.sign(values[key]))
    return Neighbours(stepper, base, pairs, sizes)


def timelines(scene: Scene, stepper: Stepper) -> Iterator[tuple[Course, Timeline]]:
    """Values in time of a scene and of its neighbours, for the courses of a stepper and of its neighbours."""
    yield stepper.system.course, scene.timeline()
    if stepper.neighbours:
        factors = [(key, 1 + sign * size) for key, size in stepper.neighbours.sizes.items() for sign in (-1, 1)]
        for solver, (key, factor) in zip(stepper.neighbours.solvers[1:], factors, strict=True):
            yield solver.system.course, scaled(scene, key, factor).timeline()


def _pair(scene: Scene, base: SubstepSolver, key: str, size: float) -> tuple[SubstepSolver, SubstepSolver]:
    """Solvers of the scene with a number smaller and larger by a part of its size.

    Raises:
        StickslipError: see `_changed` and `beside`.
    """
    by = size * float(np.sign(scene.parameters()[key]))
    below, above = (beside(base, _changed(scene, base.system, key, each)) for each in (-by, by))
    return below, above


def _changed(scene: Scene, system: System, key: str, by: float) -> System:
    """The scene with a number multiplied by 1 + `by`, assembled on the same cells.

    Raises:
        SceneError: its mesh has other cells.
    """
    problem, mesh = resolve(scaled(scene, key, 1 + by)), system.mesh
    if problem.shape != system.problem.shape:
        mesh = build_mesh(problem.shape, problem.request, mesh.comm)
        one, two = (dx.cell_nodes(each.domain) for each in (mesh, system.mesh))
        same = np.array_equal(one, two) and mesh.sides == system.mesh.sides
        if not mesh.comm.allreduce(same, MPI.MIN):
            raise SceneError("another value gives a mesh of other cells, or divides it otherwise among ranks")
    found = assemble(problem, mesh, Counters())
    alike = key.partition(".")[0] in WITHOUT_STIFFNESS
    return replace(found, assembled=system.assembled) if alike else found


class Slopes:
    """Reads the derivatives of the numbers of a step off its neighbours."""

    def __init__(self, observer: Observer, neighbours: Neighbours, scene: Scene) -> None:
        """Prepare to read each neighbour; of probes the strain is compiled.

        Args:
            observer: of the solution.
            neighbours: of it.
            scene: that asks for them.
        """
        self.neighbours, self._covariance, own = neighbours, scene.covariance, observer.without_errors()
        self._observers = [
            Observer.of(solver) if own.probes and at else replace(own, stepper=solver)
            for at, solver in enumerate(neighbours.solvers)
        ]

    def __call__(self, step: StepResult, accepted: Accepted, known: Mapping[str, float]) -> StepResult:
        """The result of a step with its derivatives; as it is where the neighbours are lost; collective.

        Args:
            known: numbers of the scene; by one that is 0 so far there is no derivative.
        """
        found = self._slopes(accepted, known) if accepted.state.neighbours else {}
        return replace(step, sensitivity=found, covariance=self._covariance if found else {})

    def _slopes(self, accepted: Accepted, known: Mapping[str, float]) -> dict[str, dict[str, Slope]]:
        """By `Quantity`, and by number of the scene."""
        edges: MovingEdges | None = None
        every = list[dict[Quantity, Value]]()
        for at, observer in enumerate(self._observers):
            near = self._near(at, accepted)
            numbers = observer.numbers(near)
            edges = edges or MovingEdges(near.stepper.system.contacts, numbers)
            every.append(quantities(numbers) | (edges(numbers) if at else edges.own) | observer.at_probes(near))
        own, *others = every
        slopes, extent = dict[str, dict[str, Slope]](), accepted.stepper.system.extent
        sizes = {"m": max(float(np.abs(accepted.state.w).max(initial=0.0)), accepted.problem.u_ref)}
        for quantity, value in own.items():
            unit = number_of(quantity).unit
            sizes[unit] = max(sizes.get(unit, 0.0), float(np.abs(value).max()))
        sizes |= {"N m": sizes.get("N", 0.0) * extent, "rad": sizes["m"] / extent}  # of what these are made of
        for (key, size), below, above in zip(self.neighbours.sizes.items(), others[::2], others[1::2], strict=True):
            if (by := size * known[key]) == 0:
                continue
            for quantity, value in own.items():
                one, two = (value - below[quantity]) / by, (above[quantity] - value) / by
                slope = Slope.of(one, two, ROUNDING * sizes[number_of(quantity).unit] / by)
                if np.isnan(one + two).any() or (quantity.quantity in AREAS and not (np.any(one) or np.any(two))):
                    slope = Slope()  # an edge is not found, or there is none
                slopes.setdefault(str(quantity), {})[key] = slope
        return slopes

    def _near(self, at: int, accepted: Accepted) -> Accepted:
        """The step of a neighbour."""
        return replace(
            accepted,
            stepper=self.neighbours.present[at],
            state=accepted.state.neighbours[at],
            start=accepted.start.neighbours[at],
            substep_start=accepted.substep_start.neighbours[at],
        )
