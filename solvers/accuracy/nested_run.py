"""Error of the mesh of every number, order 2 in the plane: the same steps once more on a mesh cut where it matters.

The run's own cells are cut twice, nested, at all places that the error comes from, see `where_to_refine`, and the
history is solved again there. After each of these steps one step of bubbles of order 3, see `two_level`, sees the smooth
errors far from there. Largest pressures, penetrations and slips are those without bubbles, which disturb single nodes.
Stated is FACTOR times the difference to the run, EDGE times that for areas, whose edge lies between nodes then. New
nodes of curved sides lie on circles: what sides of order 2 miss of them is part of the mesh's error, and that of the
geometry is zero. A largest pressure that grows by more than GROWS with each cut has no limit and no error, nor has the
penetration that it causes.

Stated / true against order 2 on meshes three times finer, 17 plane and axisymmetric problems on three meshes each, 2
to 8 steps: SHARES

The second history has the run's steps, so that the error of the time steps cancels. It costs what the run costs, and
more where the contact has few nodes and many edges: if the cost model of `auto` finds it more than MOST times as dear
as the run, cells are cut once, with a larger FACTOR (in [.7, 3]: .93), and if that does not help, there is no error of
the mesh; so from the first step on that the run was cut in. Not in 3D: at an edge of contact cells cannot be cut
nested without cutting many, and order 3 needs matrices of order 2's size many times over.

Source: of the bubbles Bank & Smith, SIAM J. Numer. Anal. 30 (1993); cutting cells nested: Bank, Sherman & Weiser, in
Scientific Computing (1983).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from geometry.arrays import Array
from geometry.errors import StickslipError
from geometry.mesh.mesh import build_mesh
from geometry.nested_mesh import FlatMesh
from geometry.surfaces.surface import gather_surface
from solvers.accuracy.areas import areas_of_order_2
from solvers.accuracy.mesh_error import AREAS, EDGE, Values
from solvers.accuracy.two_level import MeshCorrection
from solvers.accuracy.where_to_refine import Places
from solvers.parallel.counters import Counters
from solvers.parallel.gather import nodes_of
from solvers.results.error_parts import ErrorParts, Errors, Quantity
from solvers.results.numbers import quantities
from solvers.results.observe import Observer
from solvers.results.step_result import MeshData, StepResult
from solvers.scene.settings import Solver
from solvers.stepping.choice import Size
from solvers.stepping.history import HistoryRow
from solvers.stepping.method_chain import MethodChain
from solvers.stepping.stepper import Accepted, StepError, Stepper
from solvers.system.system import System, assemble

log = logging.getLogger(__name__)
FACTOR = {2: 1.3, 1: 1.6}  # stated error over difference, by the number of times that cells are cut
BUBBLES = 1  # steps of their iteration
GROWS = 0.1
MOST = 4.0  # times the price of the run
SOON = 10.0  # [s] that it may cost in any case
SOLVES = 3.0  # problems of contact in a step: that of the step, and two with bubbles
WITHOUT_BUBBLES = ("max_pressure", "max_penetration", "max_slip")


class NestedRun:
    """Estimates the error of the mesh of a run of order 2 in the plane that is solved; collective."""

    @staticmethod
    def works_for(stepper: Stepper) -> bool:
        """Whether it can: order 2 in the plane, with contact, by a method with the exact contact laws."""
        mesh, contacts = stepper.system.mesh, stepper.system.contacts
        return mesh.degree == 2 and mesh.dim == 2 and len(contacts) > 0 and stepper.chain.exact_laws

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
        self._cuts = max(FACTOR)

    def __call__(self, steps: Sequence[StepResult]) -> tuple[Errors, ...]:
        """Mesh and geometry of the errors of the first steps, up to one that fails or that the run has cut; collective.

        Args:
            steps: results at the requested times of a run from rest, without a gap.
        """
        found, system = list[Errors](), self._stepper.system
        uncut = next((k for k, step in enumerate(steps) if step.substeps > 1), len(steps))
        mesh = self._cut_mesh(steps) if uncut else None
        if mesh is None:
            return ()
        log.info("the same history on a finer mesh of %d nodes, for the error of the mesh", len(mesh.points))
        counters = Counters()
        try:
            for step, (plain, corrected) in zip(
                steps[:uncut], self._history(mesh, steps[:uncut], counters), strict=False
            ):
                found.append(self._errors(quantities(step), plain, corrected))
        except StickslipError as error:
            log.info("no error of the mesh from there on: %s", error)
        system.counters.error_solves += counters.volume_solves + counters.error_solves
        return tuple(found)

    def _errors(self, own: Values, plain: Values, corrected: Values) -> Errors:
        """Errors of the numbers of one step of the run.

        Args:
            plain, corrected: on the finer mesh, without bubbles and with them.
        """
        errors = dict[Quantity, ErrorParts]()
        for key, value in own.items():
            theirs = (plain if key.quantity in WITHOUT_BUBBLES else corrected).get(key)
            if theirs is not None:
                factor = EDGE if key.quantity in AREAS else FACTOR[self._cuts]
                off = factor * np.abs(theirs - value)
                errors[key] = ErrorParts(mesh=off, geometry=0.0 * off, converges=True, corrected=theirs)
        for c in self._stepper.system.contacts:
            key = Quantity("contacts", c.name, "max_pressure")
            if plain[key] > (1 + GROWS) ** self._cuts * own[key]:
                for quantity in ("max_pressure", "max_penetration") if c.normal.at_quadrature else ("max_pressure",):
                    errors[Quantity("contacts", c.name, quantity)] = ErrorParts(converges=False)
        return errors

    def _history(
        self, mesh: FlatMesh, steps: Sequence[StepResult], counters: Counters
    ) -> Iterator[tuple[Values, Values]]:
        """Numbers of each step on the finer mesh, without bubbles and with them; collective.

        Raises:
            StickslipError: the mesh cannot be prepared, or a step cannot be solved as a whole.
        """
        stepper = self._prepared(mesh, counters)
        observe, follow = Observer.of(stepper), MeshCorrection(stepper, steps=BUBBLES)
        state = stepper.start()
        for step in steps:
            with stepper.chain.repeating(stepper.system):
                accepted = stepper.reach(state, step.time, self._on_iteration)
            refined = follow(accepted.stepper, accepted.substep_start, accepted.state, accepted.problem)
            if refined is None:
                raise StepError(step.time, "contact could not be solved with bubbles", accepted.history, accepted)
            start, before = accepted.start, accepted.substep_start
            bubbles = replace(
                accepted,
                state=refined,
                start=start.refined or start,
                substep_start=before.refined or before,
            )
            moved = follow.displacement_at(refined, observe.probes)
            yield _numbers(observe, accepted, {}), _numbers(observe, bubbles, moved)
            state = replace(accepted.state, refined=refined)

    def _prepared(self, mesh: FlatMesh, counters: Counters) -> Stepper:
        """The bodies on the finer mesh; collective."""
        own = self._stepper.system.problem
        problem = replace(own, solver=replace(Solver.default(), tolerance=own.solver.tolerance))
        system = assemble(problem, build_mesh(mesh, problem.request, self._stepper.system.mesh.comm), counters)
        return Stepper(system, MethodChain(system))

    def _cut_mesh(self, steps: Sequence[StepResult]) -> FlatMesh | None:
        """The finer mesh, the same on every rank; None: it would be too dear; collective."""
        system = self._stepper.system
        mesh, own = self._flat(), Size.of(system.problem, system.mesh, system.constraints, system.contacts)
        found: FlatMesh | None = None
        cuts = 0
        if mesh is not None:
            places = Places.of(system.problem, system.contacts, steps)
            most = max(SOON, MOST * replace(own, steps=len(steps)).seconds["condensed"])
            for cuts in FACTOR:
                finer = mesh
                for _ in range(cuts):
                    finer = finer.cut(finer.touching(places.nodes(finer)))
                size = replace(
                    own,
                    dofs=own.dofs * len(finer.points) // len(mesh.points),
                    contact_dofs=own.contact_dofs * _contact_nodes(system, finer) // _contact_nodes(system, mesh),
                    steps=round(SOLVES * len(steps)),
                )
                if size.seconds["condensed"] <= most:
                    found = finer
                    break
            else:
                log.info("no error of the mesh: it would take about %.0f s", size.seconds["condensed"])
        found, self._cuts = system.mesh.comm.bcast((found, cuts))
        return found

    def _flat(self) -> FlatMesh | None:
        """The mesh of the run, on rank 0; collective."""
        system, data = self._stepper.system, self._data
        mesh, nodes = system.mesh, system.nodes
        known = nodes_of(mesh, nodes)(nodes.input[: nodes.owned])
        sides = {name: gather_surface(mesh, system.space, nodes, name) for name in mesh.sides}
        if mesh.comm.rank:
            return None
        return FlatMesh(
            kind=data.shape,
            points=data.points,
            cells=data.cells,
            body=data.body,
            names=data.bodies,
            sides={name: np.searchsorted(known, side.input)[side.facets] for name, side in sides.items()},
            periodic=system.problem.request.periodic,
        )


def _contact_nodes(system: System, mesh: FlatMesh) -> int:
    """Number of nodes of all contact sides."""
    pairs = system.problem.pairs.values()
    return len(np.unique(np.concatenate([mesh.sides[s].ravel() for p in pairs for s in (p.slave, p.master) if s])))


def _numbers(observe: Observer, accepted: Accepted, moved: Mapping[str, Array]) -> Values:
    """All numbers of a step on the finer mesh, areas with edges between nodes; collective.

    Args:
        moved: displacement (d,) [m] of each probe.
    """
    numbers = observe.numbers(accepted)
    values = quantities(numbers)
    values |= {Quantity("probes", name, "displacement"): value for name, value in moved.items()}
    for c in accepted.stepper.system.contacts:
        areas = areas_of_order_2(c.surface, numbers.contacts[c.name], c.node_weights)
        values |= {Quantity("contacts", c.name, key): area for key, area in areas.items()}
    return values
