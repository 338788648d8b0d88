"""Error of the mesh of every number, order 2 in the plane: the same steps once more on a mesh cut where it matters.

The run's own cells are cut twice, nested, at all places that the error comes from, see `where_to_refine`, and the
history is solved again there. One step of bubbles of order 3 after each of these steps, see `two_level`, sees the
smooth errors far from there. Largest pressures, penetrations and slips are those without bubbles, which disturb single
nodes. Stated is FACTOR times the difference to the run, EDGE times that for areas, whose edge then lies between nodes.
New nodes of curved sides lie on circles: what sides of order 2 miss of these is part of the mesh's error, and that of
the geometry is zero. A largest pressure that grows by more than GROWS with each cut has no limit and no error; with
compliance it has one.

Both histories have the same steps, so that the error of the time steps cancels. Steps of the finer mesh take about
SLOWER times as long as the run's. So of a run of more than FEW steps every second one is left out, once or several
times; the history of the rest is solved on the run's mesh too, and at times left out errors follow as in `time_steps`.
Every turn of a value in time is kept: if more than ENOUGH steps and half of the run's are left, there is no error of
the mesh. If the cost model of `auto` finds the finer mesh MOST times as dear as the run's, cells are cut once, with a
larger FACTOR; if it is too dear even so, there is no error either. Nor is there from the first step on that was cut.

SHARES

Not in 3D, where the edge of contact is a line along which many cells would be cut. A run's script has no such error:
its history is not solved again.

Source: of the bubbles Bank & Smith, SIAM J. Numer. Anal. 30 (1993); cutting cells nested: Bank, Sherman & Weiser, in
Scientific Computing (1983).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from geometry.errors import StickslipError
from geometry.mesh.mesh import build_mesh
from geometry.nested_mesh import FlatMesh
from geometry.surfaces.surface import gather_surface
from solvers.accuracy.areas import areas_of_order_2
from solvers.accuracy.histories import Columns, Difference, Stretches, count, halved, signed, stretches
from solvers.accuracy.iteration_errors import AREAS
from solvers.accuracy.mesh_error import Values
from solvers.accuracy.two_level import MeshCorrection
from solvers.accuracy.where_to_refine import Places
from solvers.parallel.counters import Counters
from solvers.parallel.gather import nodes_of
from solvers.results.error_parts import ErrorParts, Errors, Quantity
from solvers.results.numbers import quantities
from solvers.results.observe import Observer
from solvers.results.step_result import MeshData, StepResult
from solvers.scene.settings import Solver
from solvers.scene.timeline import Timeline
from solvers.stepping.choice import Size
from solvers.stepping.history import HistoryRow
from solvers.stepping.method_chain import MethodChain
from solvers.stepping.stepper import Accepted, StepError, Stepper
from solvers.system.system import System, assemble

log = logging.getLogger(__name__)
FACTOR = {2: 1.3, 1: 1.6}  # stated error over difference, by the number of times that cells are cut
EDGE = 1.5
BUBBLES = 1  # steps of their iteration
GROWS = 0.1
FEW, ENOUGH = 8, 16
SLOWER = 8.0
MOST = 4.0
SOON = 10.0  # [s] that it may take in any case
SOLVES = 3  # problems of contact in a step: that of the step, and two with bubbles
WITHOUT_BUBBLES = ("max_pressure", "max_penetration", "max_slip")


class NestedRun:
    """Estimates the error of the mesh of a run of order 2 in the plane that is solved; collective."""

    @staticmethod
    def works_for(stepper: Stepper) -> bool:
        """Whether it can: order 2 in the plane, with contact, by a method with the exact contact laws."""
        mesh, contacts = stepper.system.mesh, stepper.system.contacts
        return mesh.degree == 2 and mesh.dim == 2 and len(contacts) > 0 and stepper.chain.exact_laws

    def __init__(
        self,
        stepper: Stepper,
        observer: Observer,
        data: MeshData,
        on_iteration: Callable[[HistoryRow], None] = lambda row: None,
    ) -> None:
        """
        Args:
            stepper, observer: of the run.
            data: its mesh.
            on_iteration: called after each iteration, on every rank.
        """
        self._stepper, self._data, self._on_iteration = stepper, data, on_iteration
        self._observe = observer.without_errors()

    def __call__(self, steps: Sequence[StepResult]) -> tuple[Errors, ...]:
        """Mesh and geometry of the errors of each step, None where they are not known; collective.

        Args:
            steps: results at the requested times of a run from rest, without a gap.
        """
        uncut = next((k for k, step in enumerate(steps) if step.substeps > 1), len(steps))
        plan = thinned([step.time for step in steps[:uncut]], self._stepper.system.problem.timeline)
        if count(plan) > max(ENOUGH, uncut / 2):
            log.info(
                "no error of the mesh: it would take about %.0f times the run's steps", SLOWER * count(plan) / uncut
            )
            return ()
        own = list(steps[:uncut]) if count(plan) == uncut else self._own(plan)
        cuts, mesh = self._cut_mesh(own) if own else (0, None)
        if mesh is None:
            return ()
        log.info("the same history on a finer mesh of %d nodes, for the error of the mesh", len(mesh.points))
        finer, counters = list[Values](), Counters()
        try:
            finer.extend(self._finer(mesh, [step.time for step in own], counters))
        except StickslipError as error:
            log.info("no error of the mesh from there on: %s", error)
        self._stepper.system.counters.error_solves += counters.volume_solves + counters.error_solves
        stiff = {c.name for c in self._stepper.system.contacts if not c.normal.at_quadrature}
        return _errors(steps[:uncut], own[: len(finer)], finer, cuts, stiff)

    def _own(self, plan: Stretches) -> list[StepResult]:
        """The history in fewer steps on the run's mesh, up to a step that would have to be cut; collective."""
        log.info("the same history in %d steps, for the error of the mesh", count(plan))
        found, stepper = list[StepResult](), self._stepper
        state = stepper.start()
        with stepper.chain.repeating(stepper.system):
            for time in (time for stretch in plan for time in stretch):
                try:
                    accepted = stepper.reach(state, time, self._on_iteration)
                except StepError as error:
                    log.info("no error of the mesh from there on: %s", error)
                    break
                found.append(self._observe(accepted))
                state = accepted.state
        return found

    def _finer(self, mesh: FlatMesh, times: Sequence[float], counters: Counters) -> Iterator[Values]:
        """Numbers of the history on the finer mesh at each time [s]; collective.

        Raises:
            StickslipError: the mesh cannot be prepared, or a step cannot be solved as a whole.
        """
        stepper = self._prepared(mesh, counters)
        observe, follow = Observer.of(stepper), MeshCorrection(stepper, steps=BUBBLES)
        state = stepper.start()
        for time in times:
            with stepper.chain.repeating(stepper.system):
                accepted = stepper.reach(state, time, self._on_iteration)
            refined = follow(accepted.stepper, accepted.substep_start, accepted.state, accepted.problem)
            if refined is None:
                raise StepError(time, "contact could not be solved with bubbles", accepted.history, accepted)
            start, before = accepted.start, accepted.substep_start
            bubbles = replace(
                accepted, state=refined, start=start.refined or start, substep_start=before.refined or before
            )
            plain, values = _numbers(observe, accepted), _numbers(observe, bubbles)
            values |= {key: value for key, value in plain.items() if key.quantity in WITHOUT_BUBBLES}
            moved = follow.displacement_at(refined, observe.probes)
            yield values | {Quantity("probes", name, "displacement"): value for name, value in moved.items()}
            state = replace(accepted.state, refined=refined)

    def _prepared(self, mesh: FlatMesh, counters: Counters) -> Stepper:
        """The bodies on the finer mesh; collective."""
        own = self._stepper.system.problem
        problem = replace(own, solver=replace(Solver.default(), tolerance=own.solver.tolerance))
        system = assemble(problem, build_mesh(mesh, problem.request, self._stepper.system.mesh.comm), counters)
        return Stepper(system, MethodChain(system))

    def _cut_mesh(self, steps: Sequence[StepResult]) -> tuple[int, FlatMesh | None]:
        """How often cells are cut, and the finer mesh, on every rank; None: it would be too dear; collective."""
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
                    steps=SOLVES * len(steps),
                )
                if size.seconds["condensed"] <= most:
                    found = finer
                    break
            else:
                log.info("no error of the mesh: it would take about %.0f s", size.seconds["condensed"])
        cuts, found = system.mesh.comm.bcast((cuts, found))
        return cuts, found

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


def _numbers(observe: Observer, accepted: Accepted) -> Values:
    """All numbers of a step on the finer mesh but those of probes, areas with edges between nodes; collective."""
    numbers = observe.numbers(accepted)
    values = quantities(numbers)
    for name, contact in numbers.contacts.items():
        side = next(c.surface for c in accepted.stepper.system.contacts if c.name == name)
        areas = areas_of_order_2(side, contact, contact.weight)
        values |= {Quantity("contacts", name, key): area for key, area in areas.items()}
    return values


def thinned(times: Sequence[float], timeline: Timeline) -> Stretches:
    """The times of a history [s] without every second one, until FEW are left or no more can be left out.

    >>> from solvers.scene.timeline import Place
    >>> line = Timeline({Place("supports", "top", "displacement", "x"): ((1.0, 0.0), (2.0, 1.0))}, end=2.0, count=24)
    >>> [len(stretch) for stretch in thinned(line.times, line)]
    [3, 3]
    """
    plan = stretches(times, timeline)
    while count(plan) > FEW and (fewer := tuple(halved(stretch) for stretch in plan)) != plan:
        plan = fewer
    return plan


def _errors(
    steps: Sequence[StepResult], own: Sequence[StepResult], finer: Sequence[Values], cuts: int, stiff: Collection[str]
) -> tuple[Errors, ...]:
    """Errors of the numbers of all steps of a run.

    Args:
        steps: of the run.
        own, finer: of a history in the same or in fewer steps, on the run's mesh and on a finer one.
        cuts: how often cells of the finer one are cut.
        stiff: contacts without compliance.
    """
    values = [quantities(step) for step in steps]
    columns, times = Columns.of(values[0]), np.array([step.time for step in steps])
    rows = [
        columns.row({key: theirs.get(key, np.nan * value) - value for key, value in quantities(step).items()})
        for step, theirs in zip(own, finer, strict=True)
    ]
    ends = np.array([step.time for step in own])
    shape = len(ends), len(columns.row(values[0]))
    errors = signed(Difference(ends, np.reshape(rows, shape), np.ones(len(ends))), times, columns)
    found = list[Errors]()
    for row, mine, at in zip(errors, values, np.searchsorted(ends, times), strict=True):
        here = dict[Quantity, ErrorParts]()
        for key, off in columns.values(row).items():
            if off is not None:
                size = (EDGE if key.quantity in AREAS else FACTOR[cuts]) * np.abs(off)
                here[key] = ErrorParts(mesh=size, geometry=0.0 * size, converges=True, corrected=mine[key] - off)
        if at < len(own):
            keys = [Quantity("contacts", name, "max_pressure") for name in stiff]
            most = {key: (1 + GROWS) ** cuts * own[at].contacts[key.name].max_pressure for key in keys}
            here |= {key: ErrorParts(converges=False) for key in keys if finer[at][key] > most[key]}
        found.append(here)
    return tuple(found)
