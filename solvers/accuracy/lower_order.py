"""Error of the mesh of what an edge of contact decides, order 2 in 3D: the same steps on the same cells with order 1.

What order 2 adds to order 1 is the error of order 1. At an edge of contact order 2 is hardly better: stated is ROUGH
times the difference for areas, largest pressures and penetrations. Of all other numbers the error is known already
from bubbles of order 3, see `smooth_errors`; where a step with these was not solved, SHARE of the difference is
stated. It tells how large the error is, no more. A largest pressure that grows without end with order 1 has no limit,
see `grows`. The part of curved sides is in it; that of the geometry is zero.

`smooth_errors` finds the error of the mesh of the smooth numbers of each step, order 2 in 3D: the same step with
bubbles of order 3. Two steps of Jacobi's iteration, which neither bodies nor contact answer to, find the bubbles; then
contact is solved again with them, see `two_level`. Stated is FACTOR times the difference, no less than `by_chance`
says of the nodes. `AT_THE_EDGE`, what an edge of contact decides, does not change by bubbles; see the first paragraph.
Nor do bubbles tell how supports that meet share what they hold, or where on periodic sides it is held. The part of
curved sides is in it, that of the geometry is zero.

`OtherMeshRun` solves the same history with the bodies of a run on another mesh.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np

from stickslip.geometry.arrays import LAST_DIGITS, Ints
from stickslip.geometry.errors import StickslipError
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.geometry.nested_mesh import CornerMesh
from stickslip.geometry.shape import Shape
from stickslip.geometry.surfaces.surface import gather_surface
from stickslip.solvers.accuracy.mesh_error import Values, at_points, least_errors, observed, with_ends, without_limit
from stickslip.solvers.accuracy.two_level import MeshCorrection
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.parallel.gather import nodes_of
from stickslip.solvers.results.observe import Observer
from stickslip.solvers.results.step_result import ErrorParts, Errors, MeshData, Quantity, StepResult, quantities
from stickslip.solvers.scene.record import Value
from stickslip.solvers.scene.settings import Solver
from stickslip.solvers.stepping.history import HistoryRow
from stickslip.solvers.stepping.method_chain import MethodChain
from stickslip.solvers.stepping.stepper import Accepted, Stepper
from stickslip.solvers.system.system import System, assemble

log = logging.getLogger(__name__)


class OtherMeshRun(ABC):
    """Estimates the error of the mesh of a solved run of order 2, from its history on another mesh; collective."""

    DIM: ClassVar[int]  # of the models that it is for

    @classmethod
    def works_for(cls, stepper: Stepper) -> bool:
        """Whether it can: order 2 in its dimension, with contact, by a method with the exact contact laws."""
        mesh, contacts = stepper.system.mesh, stepper.system.contacts
        return mesh.degree == 2 and mesh.dim == cls.DIM and len(contacts) > 0 and stepper.chain.exact_laws

    def __init__(
        self, stepper: Stepper, data: MeshData, on_iteration: Callable[[HistoryRow], None] = lambda row: None
    ) -> None:
        """
        Args:
            stepper: of the run.
            data: its mesh.
            on_iteration: called after each iteration, on every rank.
        """
        self._stepper, self._data, self._on_iteration = stepper, data, on_iteration

    def __call__(self, steps: Sequence[StepResult]) -> tuple[Errors, ...]:
        """Mesh and geometry of the errors of the first steps, up to one that fails or that the run has cut; collective.

        Args:
            steps: results at the requested times of a run from rest, without a gap.
        """
        whole = steps[: next((k for k, step in enumerate(steps) if step.substeps > 1), len(steps))]
        counters, found = Counters(), list[Errors]()
        try:
            for errors in self._each(whole, counters) if whole else ():
                found.append(errors)
        except StickslipError as error:
            log.info("no error of the mesh from there on: %s", error)
        self._stepper.system.counters.error_solves += counters.volume_solves + counters.error_solves
        return tuple(found)

    @abstractmethod
    def _each(self, steps: Sequence[StepResult], counters: Counters) -> Iterator[Errors]:
        """Errors of one step after the other.

        Args:
            steps: solved in one substep each.
            counters: of the other mesh.

        Raises:
            StickslipError: a step cannot be solved there.
        """


def on_other_mesh(own: System, mesh: Shape, counters: Counters) -> Stepper:
    """The bodies of a system on another mesh, by the default method at the same tolerance; collective.

    Args:
        mesh: on every rank.

    Raises:
        StickslipError: they cannot be prepared.
    """
    problem = replace(own.problem, solver=replace(Solver.default(), tolerance=own.problem.solver.tolerance))
    system = assemble(problem, build_mesh(mesh, problem.request, own.mesh.comm), counters)
    return Stepper(system, MethodChain(system))


def sides_of(system: System) -> tuple[Mapping[str, Ints], Mapping[str, Ints]]:
    """Facets (f, k) of all sides of a system's mesh by the numbers of all its nodes, and edges of sides; collective.

    Both are on rank 0 alone.
    """
    mesh, nodes = system.mesh, system.nodes
    known = nodes_of(mesh, nodes)(nodes.input[: nodes.owned])
    sides = {name: gather_surface(mesh, system.space, nodes, name) for name in mesh.sides}
    if mesh.comm.rank:
        return {}, {}
    facets = {name: np.searchsorted(known, side.input)[side.facets] for name, side in sides.items()}
    return facets, {name: np.searchsorted(known, rows) for name, rows in mesh.edges.items()}


FACTOR = 2.0
AT_THE_EDGE = ("contact_area", "stick_area", "slip_area", "max_pressure", "max_penetration")


def smooth_errors(
    observe: Observer, accepted: Accepted, result: StepResult
) -> tuple[Values, dict[Quantity, ErrorParts]]:
    """Numbers of a step with bubbles, and the errors of its result's, but for those that an edge decides; collective.

    Nothing if the step was not followed, nor of numbers that have no limit.
    """
    refined, companion = accepted.state.refined, observe.stepper.companion
    if refined is None or not isinstance(companion, MeshCorrection):
        return {}, {}
    numbers = observed(observe, accepted, refined)
    better, least = quantities(numbers), least_errors(accepted.stepper.system.contacts, result, numbers)
    better |= companion.displacement_at(refined, observe.probes)
    corrected, errors = dict[Quantity, Value](), dict[Quantity, ErrorParts]()
    system = accepted.stepper.system
    found = quantities(result)
    endless = at_points(system.problem, found)
    for c in system.contacts:
        endless |= without_limit(c, result.contacts[c.name], LAST_DIGITS * system.extent)
    mesh, constraints = system.mesh, system.constraints
    unknown = () if mesh.comm.allreduce(constraints.apart, min) else ("supports",)
    for key, value in found.items():
        known = key in better and key not in endless and key.kind not in unknown
        if known and key.quantity not in (*AT_THE_EDGE, "stress"):
            corrected[key] = better[key]
            off = np.maximum(FACTOR * np.abs(better[key] - value), least.get(key, 0.0))
            errors[key] = ErrorParts(mesh=off, geometry=0.0 * off, converges=True)
    return corrected, with_ends(system.contacts, result, errors)


SHARE, ROUGH = 0.33, 1.5


class LowerOrderRun(OtherMeshRun):
    """Order 2 in 3D: the same cells with order 1."""

    DIM = 3

    def _each(self, steps: Sequence[StepResult], counters: Counters) -> Iterator[Errors]:
        own = self._stepper.system
        log.info("the same history with cells of order 1, for the error of the mesh")
        stepper = on_other_mesh(own, own.mesh.comm.bcast(self._of_order_1()), counters)
        observe, state = Observer.of(stepper), stepper.start()
        for step in steps:
            with stepper.chain.repeating(stepper.system):
                accepted = stepper.reach(state, step.time, self._on_iteration)
            yield _errors(stepper, step, observe(accepted))
            state = accepted.state

    def _of_order_1(self) -> CornerMesh | None:
        """The cells of the run with their corners alone, on rank 0; collective."""
        data, (sides, edges) = self._data, sides_of(self._stepper.system)
        if self._stepper.system.mesh.comm.rank:
            return None
        return CornerMesh(
            kind=data.shape,
            points=data.points,
            cells=data.cells,
            body=data.body,
            names=data.bodies,
            sides=sides,
            edges_of=edges,
        )


def _errors(stepper: Stepper, step: StepResult, coarser: StepResult) -> Errors:
    """Errors of the numbers of a step.

    Args:
        stepper: of order 1.
        coarser: the step with order 1.
    """
    of_order_1, errors = quantities(coarser), dict[Quantity, ErrorParts]()
    for key, value in quantities(step).items():
        known = step.errors.get(str(key))
        if key.quantity != "stress" and (known is None or known.mesh is None):
            part = ROUGH if key.quantity in AT_THE_EDGE else SHARE
            off = part * np.abs(value - of_order_1[key])
            errors[key] = ErrorParts(mesh=off, geometry=0.0 * off, converges=True)
    for c in stepper.system.contacts:
        errors |= without_limit(c, coarser.contacts[c.name], LAST_DIGITS * stepper.system.extent)
    return errors | at_points(stepper.system.problem, of_order_1)
