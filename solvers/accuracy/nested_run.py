"""Error of the mesh of every number, order 2 in the plane: the same steps once more on a mesh cut where it matters.

The run's own cells are cut twice, nested, at all places that the error comes from, see `Places`, and the
history is solved again there. One step of bubbles of order 3 after each of these steps, see `two_level`, sees the
smooth errors far from there. Largest pressures, penetrations and slips are those without bubbles, which disturb single
nodes. Stated is FACTOR times the difference to the run, EDGE times that for areas, whose edge then lies between nodes;
areas are no better known than ANYWHERE says of the half facets that their edges cross in the run.
New nodes of curved sides lie on circles: what sides of order 2 miss of these is part of the mesh's error, and that of
the geometry is zero. A largest pressure that grows by more than GROWS with each cut has no limit and no error; with
compliance it has one.

Both histories have the same steps, so that the error of the time steps cancels: which nodes stick depends on them.
A step of the finer mesh takes four to five times as long as one of the run, its preparation once or twice. Where the
cost model of `auto` finds that to be more than SOON and than MOST times the run, cells are cut once, with a larger
FACTOR; if that is too dear as well, there is no error of the mesh. Nor is there from the first step on that was cut.

Not in 3D, where the edge of contact is a line along which many cells would be cut: see `lower_order`. A run's script
has no such error: its history is not solved again.

Source: of the bubbles Bank & Smith, SIAM J. Numer. Anal. 30 (1993); cutting cells nested: Bank, Sherman & Weiser, in
Scientific Computing (1983).

`Places` finds where the error of a run of order 2 in the plane comes from: places at which its mesh is to be cut.
These are the corners of the bodies and the changes of side where something acts on one of both sides; in every step
the facets whose nodes differ in status, and those at the largest pressure; and of the other side of a contact the
facets that they face. Elsewhere displacements are smooth.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stickslip.geometry.arrays import Array, Bools, Ints
from stickslip.geometry.curved_facets import SHARP
from stickslip.geometry.nested_mesh import FlatMesh
from stickslip.solvers.accuracy.areas import areas_of_order_2, scatter_of_order_2
from stickslip.solvers.accuracy.errors import AREAS
from stickslip.solvers.accuracy.lower_order import OtherMeshRun, on_other_mesh, sides_of
from stickslip.solvers.accuracy.mesh_error import Values, at_points, with_ends
from stickslip.solvers.accuracy.two_level import MeshCorrection
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.results.observe import Observer
from stickslip.solvers.results.step_result import ErrorParts, Errors, Quantity, StepResult, quantities
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.stepping.choice import Size
from stickslip.solvers.stepping.stepper import Accepted, StepError


@dataclass(frozen=True)
class Places:
    """Places at which a mesh, and the meshes that are cut from it, are to be cut."""

    acted: tuple[str, ...]  # sides that contacts, supports and loads act on
    segments: Mapping[str, Array]  # by side, segments (s, 3, 2) [m]: their ends, and a point between

    @classmethod
    def of(cls, problem: Problem, contacts: Sequence[ContactRows], steps: Sequence[StepResult]) -> Places:
        """The places of a run.

        Args:
            contacts: of its mesh.
            steps: all its steps.
        """
        acted = [side for pair in problem.pairs.values() for side in (pair.slave, pair.master)]
        acted += [support.boundary for support in problem.supports.values()]
        acted += [load.boundary for load in problem.loads.values()]
        segments = dict[str, list[Array]]()
        for c in contacts:
            pair = problem.pairs[c.name]
            segments.setdefault(pair.slave, []).extend(mine for mine, _ in _changes(c, steps))
            if pair.master is not None:
                segments.setdefault(pair.master, []).extend(faced for _, faced in _changes(c, steps))
        return cls(
            tuple(sorted({side for side in acted if side is not None})),
            {side: np.concatenate([np.zeros((0, 3, 2)), *parts]) for side, parts in segments.items()},
        )

    def nodes(self, mesh: FlatMesh) -> Ints:
        """Corners of cells at these places: all cells that have one of them are to be cut."""
        found = [_corners(mesh, self.acted)]
        for side, segments in self.segments.items():
            facets = mesh.facets(side)
            found.append(facets[_overlap(mesh.points[facets], segments)][:, :2].ravel())
        return np.unique(np.concatenate(found))

    def contact_nodes(self, mesh: FlatMesh) -> int:
        """Number of nodes of all contact sides."""
        return len(np.unique(np.concatenate([mesh.facets(side).ravel() for side in self.segments])))


def _changes(c: ContactRows, steps: Sequence[StepResult]) -> Iterator[tuple[Array, Array]]:
    """By step, the facets (f, 3, 2) [m] of the slave that the contact changes in, and where they lie on the other side.

    The other side counts undeformed, like the slave: what slides by, lies elsewhere.
    """
    for step in steps:
        contact = step.contacts[c.name]
        status, facets = contact.status[c.surface.facets], c.surface.facets
        changes = (status != status[:, :1]).any(axis=1) | (facets == np.argmax(contact.pressure)).any(axis=1)
        mine = c.surface.points[facets[changes]]
        yield mine, mine + c.sense * contact.slip[facets[changes]]


def _overlap(facets: Array, segments: Array) -> Bools:
    """Which facets (f, 3, 2) overlap with a segment (s, 3, 2), across a small gap."""
    found = np.zeros(len(facets), bool)
    half = np.linalg.norm(facets[:, 1] - facets[:, 0], axis=1) / 2
    size = float(np.ptp(facets[:, :2], axis=(0, 1)).max())
    # in nine digits segments of several steps are the same; midpoints that are nearer belong to segments that overlap
    for a, b, middle in segments[np.unique((segments / size).round(9), axis=0, return_index=True)[1]]:
        found |= np.linalg.norm(facets[:, 2] - middle, axis=1) < 0.999 * (half + np.linalg.norm(b - a) / 2)
    return found


def _corners(mesh: FlatMesh, acted: Sequence[str]) -> Ints:
    """Nodes where the boundary has a corner or passes to another side, if something acts on one of the two sides.

    Where more than two facets meet, always.
    """
    edges = mesh.boundary()
    names = list(mesh.sides)
    side_of = {m: k for k, name in enumerate(names) for m in mesh.sides[name][:, 2].tolist()}
    number = np.array([side_of.get(m, -1) for m in edges[:, 2].tolist()])
    active = np.isin(number, [k for k, name in enumerate(names) if name in acted])
    for skin in (side for side in acted if side not in mesh.sides):
        active |= np.isin(edges[:, 2], mesh.facets(skin)[:, 2])
    ends, middles = edges[:, :2].ravel(), np.repeat(edges[:, 2], 2)
    order = np.argsort(ends, kind="stable")
    nodes, first, count = np.unique(ends[order], return_index=True, return_counts=True)
    two = first[count == 2]
    one, other = order[two], order[two + 1]
    away = [mesh.points[middles[k]] - mesh.points[ends[k]] for k in (one, other)]
    lengths = np.linalg.norm(away[0], axis=1) * np.linalg.norm(away[1], axis=1)
    turned = -np.einsum("nd,nd->n", *away) < np.cos(np.radians(SHARP)) * lengths
    differs = turned | (number[one // 2] != number[other // 2])
    acts = active[one // 2] | active[other // 2]
    return np.concatenate([nodes[count != 2], ends[one][differs & acts]])


log = logging.getLogger(__name__)
FACTOR = {2: 1.3, 1: 1.6}  # stated error over difference, by the number of times that cells are cut
EDGE = 1.5
ANYWHERE = 0.15  # of the half facets that edges of areas cross; edges that lie anywhere in them make .29
GROWS = 0.1
MOST, SOON = 3.0, 15.0  # times the run, and [s]
WITHOUT_BUBBLES = ("max_pressure", "max_penetration", "max_slip")


class NestedRun(OtherMeshRun):
    """Order 2 in the plane: the own cells cut into smaller ones."""

    DIM = 2

    def _each(self, steps: Sequence[StepResult], counters: Counters) -> Iterator[Errors]:
        cuts, mesh = self._cut_mesh(steps)
        if mesh is None:
            return
        log.info("the same history on a finer mesh of %d nodes, for the error of the mesh", len(mesh.points))
        for step, finer in zip(steps, self._finer(mesh, [step.time for step in steps], counters), strict=True):
            yield self._errors(step, finer, cuts)

    def _errors(self, step: StepResult, finer: Values, cuts: int) -> Errors:
        """Errors of the numbers of a step.

        Args:
            finer: what they are on the finer mesh.
            cuts: how often its cells are cut.
        """
        errors, least = dict[Quantity, ErrorParts](), dict[Quantity, float]()
        for c in self._stepper.system.contacts:
            edges = scatter_of_order_2(c.surface, step.contacts[c.name], c.node_weights)
            least |= {Quantity("contacts", c.name, area): ANYWHERE * size for area, size in edges.items()}
        for key, value in quantities(step).items():
            if key in finer:
                off = (EDGE if key.quantity in AREAS else FACTOR[cuts]) * np.abs(finer[key] - value)
                off = np.maximum(off, least.get(key, 0.0))
                errors[key] = ErrorParts(mesh=off, geometry=0.0 * off, converges=True, corrected=finer[key])
        for c in self._stepper.system.contacts:
            key, pressure = Quantity("contacts", c.name, "max_pressure"), step.contacts[c.name].max_pressure
            if finer[key] > (1 + GROWS) ** cuts * pressure and not c.normal.at_quadrature:
                errors[key] = ErrorParts(converges=False)
        errors = with_ends(self._stepper.system.contacts, step, errors)
        return errors | at_points(self._stepper.system.problem, quantities(step))

    def _finer(self, mesh: FlatMesh, times: Sequence[float], counters: Counters) -> Iterator[Values]:
        """Numbers of the history on the finer mesh at each time [s]; collective.

        Raises:
            StickslipError: the mesh cannot be prepared, or a step cannot be solved as a whole.
        """
        stepper = on_other_mesh(self._stepper.system, mesh, counters)
        observe, follow = Observer.of(stepper), MeshCorrection(stepper, quick=True)
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
            plain, values = quantities(observe.numbers(accepted)), _numbers(observe, bubbles)
            values |= {key: value for key, value in plain.items() if key.quantity in WITHOUT_BUBBLES}
            yield values | follow.displacement_at(refined, observe.probes)
            state = replace(accepted.state, refined=refined)

    def _cut_mesh(self, steps: Sequence[StepResult]) -> tuple[int, FlatMesh | None]:
        """Cut cells on every rank: how often, and the finer mesh; None: it would be too dear; collective."""
        system = self._stepper.system
        mesh, size = self._flat(), Size.of(system.problem, system.mesh, system.constraints, system.contacts)
        found: tuple[int, FlatMesh | None] = 0, None
        if mesh is not None:
            found = _cut(mesh, Places.of(system.problem, system.contacts, steps), replace(size, steps=len(steps)))
        found = system.mesh.comm.bcast(found)
        return found

    def _flat(self) -> FlatMesh | None:
        """The mesh of the run, on rank 0; collective."""
        system, data = self._stepper.system, self._data
        sides, edges = sides_of(system)
        if system.mesh.comm.rank:
            return None
        return FlatMesh(
            kind=data.shape,
            points=data.points,
            cells=data.cells,
            body=data.body,
            names=data.bodies,
            sides=sides,
            edges_of=edges,
            periodic=system.problem.request.periodic,
            turns=system.problem.request.turns,
        )


def _cut(mesh: FlatMesh, places: Places, size: Size) -> tuple[int, FlatMesh | None]:
    """Cut the cells at some places: how often, and the mesh then; None: it would be too dear.

    Args:
        size: of the run.
    """
    most = max(SOON, MOST * _seconds(size))
    for cuts in FACTOR:
        finer = mesh
        for _ in range(cuts):
            finer = finer.cut(finer.touching(places.nodes(finer)))
        contact_dofs = size.contact_dofs * places.contact_nodes(finer) // places.contact_nodes(mesh)
        dofs = size.dofs * len(finer.points) // len(mesh.points)
        # problems of contact: that of a step, and that with bubbles, which is about twice as dear
        seconds = _seconds(replace(size, dofs=dofs, contact_dofs=contact_dofs, steps=3 * size.steps))
        if seconds <= most:
            return cuts, finer
    log.info("no error of the mesh: it would take about %.0f s", seconds)
    return 0, None


def _seconds(size: Size) -> float:
    """Expected time [s] by the cost model of `auto`, and 10 ms for a problem of contact, however small."""
    return size.condensed_seconds + 0.01 * size.steps


def _numbers(observe: Observer, accepted: Accepted) -> Values:
    """All numbers of a step on the finer mesh but those of probes, areas with edges between nodes; collective."""
    numbers = observe.numbers(accepted)
    values = quantities(numbers)
    for name, contact in numbers.contacts.items():
        side = next(c.surface for c in accepted.stepper.system.contacts if c.name == name)
        areas = areas_of_order_2(side, contact, contact.weight)
        values |= {Quantity("contacts", name, key): area for key, area in areas.items()}
    return values
