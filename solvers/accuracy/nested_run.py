"""The cells of a run in the plane, of order 2, cut where its error comes from: the better cells of both orders.

They are cut twice, nested, at all places that the error comes from, see `Places`; of a run of order 2 also where half
of the error in the energy norm is that recovered stresses tell of, which order 2 itself shows of a run of order 1. New
nodes of curved sides lie on circles: what sides of order 2 miss of these is part of the mesh's error. Both histories
have the same steps, so that the error of the time steps cancels: which nodes stick depends on them. Smooth errors far
from there do not show; cells twice as long show these, see `mesh_error`.

Where that is too dear, cells are cut once, or not at all. Not in 3D, where the edge of contact is a line along which
many cells would be cut.

Source of cutting cells nested: Bank, Sherman & Weiser, in Scientific Computing (1983).

`Places` finds where the error of a run of order 2 in the plane comes from: places at which its mesh is to be cut.
These are the corners of the bodies and the changes of side where something acts on one of both sides; in every step
the facets whose nodes differ in status, and those at the largest pressure; and of the other side of a contact the
facets that they face; and the cells around probes, whose stress nothing else shows. Elsewhere displacements are smooth.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import Array, Bools, Ints
from stickslip.geometry.curved_facets import SHARP
from stickslip.geometry.nested_mesh import EDGES, FlatMesh
from stickslip.geometry.surfaces.surface import gather_surface
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.parallel.gather import nodes_of
from stickslip.solvers.results.observe import mesh_data
from stickslip.solvers.results.step_result import MeshData, Quantity, StepResult
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.stepping.choice import Size
from stickslip.solvers.system.system import System


@dataclass(frozen=True)
class Places:
    """Places at which a mesh, and the meshes that are cut from it, are to be cut."""

    acted: tuple[str, ...]  # sides that contacts, supports and loads act on
    segments: Mapping[str, Array]  # by side, segments (s, 3, 2) [m]: their ends, and a point between
    probes: Sequence[Array] = ()  # points (2,) [m] at which stresses are asked for

    @classmethod
    def of(cls, problem: Problem, contacts: Sequence[ContactRows], steps: Sequence[StepResult]) -> Places:
        """The places of a run.

        Args:
            contacts: of its mesh.
            steps: all its steps.
        """
        segments = dict[str, list[Array]]()
        for c in contacts:
            pair = problem.pairs[c.name]
            segments.setdefault(pair.slave, []).extend(mine for mine, _ in _changes(c, steps))
            if pair.master is not None:
                segments.setdefault(pair.master, []).extend(faced for _, faced in _changes(c, steps))
        return cls(
            acted_on(problem),
            {side: np.concatenate([np.zeros((0, 3, 2)), *parts]) for side, parts in segments.items()},
            [np.array(probe.point) for probe in problem.probes.values()],
        )

    def nodes(self, mesh: FlatMesh) -> Ints:
        """Corners of cells at these places: all cells that have one of them are to be cut."""
        found = [_corners(mesh, self.acted)]
        for side, segments in self.segments.items():
            facets = mesh.facets(side)
            found.append(facets[_overlap(mesh.points[facets], segments)][:, :2].ravel())
        middles = mesh.points[mesh.cells].mean(axis=1)
        nearest = [int(np.linalg.norm(middles - point, axis=1).argmin()) for point in self.probes]
        found += [mesh.cells[cell, : len(EDGES[mesh.kind])] for cell in nearest]
        return np.unique(np.concatenate(found))

    def contact_nodes(self, mesh: FlatMesh) -> int:
        """Number of nodes of all contact sides."""
        return len(set().union(*(mesh.facets(side).ravel().tolist() for side in self.segments)))


def acted_on(problem: Problem) -> tuple[str, ...]:
    """Sides that contacts, supports and loads act on."""
    sides = [side for pair in problem.pairs.values() for side in (pair.slave, pair.master)]
    sides += [each.boundary for table in (problem.supports, problem.loads) for each in table.values()]
    return tuple(sorted({side for side in sides if side is not None}))


def _changes(c: ContactRows, steps: Sequence[StepResult]) -> Iterator[tuple[Array, Array]]:
    """By step, the facets (f, 3, 2) [m] of the slave that the contact changes in, and where they lie on the other side.

    The other side counts undeformed, like the slave: what slides by, lies elsewhere.
    """
    for step in steps:
        contact = step.contacts[c.name]
        status, facets = contact.status[c.surface.facets], c.surface.facets
        changes = (status != status[:, :1]).any(axis=1) | (facets == np.argmax(contact.pressure)).any(axis=1)
        mine = c.surface.points[facets[changes]]
        yield _with_middles(mine), _with_middles(mine + c.sense * contact.slip[facets[changes]])


def _with_middles(facets: Array) -> Array:
    """Facets (f, 3, 2) [m] as they are, those of order 1 (f, 2, 2) with the points between their ends."""
    return facets if facets.shape[1] == 3 else np.concatenate([facets, facets.mean(axis=1, keepdims=True)], axis=1)


def _overlap(facets: Array, segments: Array) -> Bools:
    """Which facets (f, 3, 2) overlap with a segment (s, 3, 2), across a small gap."""
    found = np.zeros(len(facets), bool)
    half = np.linalg.norm(facets[:, 1] - facets[:, 0], axis=1) / 2
    size = float(np.ptp(facets[:, :2], axis=(0, 1)).max())
    # in nine digits segments of several steps are the same; midpoints that are nearer belong to segments that overlap
    for a, b, middle in segments[np.unique((segments / size).round(9), axis=0, return_index=True)[1]]:
        found |= np.linalg.norm(facets[:, 2] - middle, axis=1) < 0.999 * (half + np.linalg.norm(b - a) / 2)
    return found


def _corners(mesh: FlatMesh, acted: Sequence[str], mirrors: Sequence[str] = ()) -> Ints:
    """Nodes where the boundary has a corner or passes to another side, if something acts on one of the two sides.

    Where more than two facets meet, always; a corner of at most a right angle on a mirror, a side that is held along
    its normal alone, is none: the body goes on behind it.
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
    mirror = np.isin(number, [k for k, name in enumerate(names) if name in mirrors])
    inside = np.zeros_like(mesh.points)
    for corner in range(len(EDGES[mesh.kind])):  # as many as edges
        node = mesh.cells[:, corner]
        np.add.at(inside, node, mesh.points[mesh.cells].mean(axis=1) - mesh.points[node])
    convex = np.einsum("nd,nd->n", away[0] + away[1], inside[ends[one]]) > 0
    right = np.einsum("nd,nd->n", *away) > -np.sin(np.radians(SHARP)) * lengths  # as far as curved sides tell
    goes_on = (mirror[one // 2] | mirror[other // 2]) & convex & right
    return np.concatenate([nodes[count != 2], ends[one][differs & acts & ~goes_on]])


log = logging.getLogger(__name__)
CUTS = (2, 1)  # number of times that cells are cut


def cut_cells(
    own: System, order_2: System, steps: Sequence[StepResult], fits: Callable[[Size], bool]
) -> FlatMesh | None:
    """The cells of a run in the plane, cut at its places, on every rank; None: that would be too dear; collective.

    Args:
        own: of the run.
        order_2: of the same cells; it is `own` if the run has order 2.
        steps: results at all requested times.
        fits: whether a history of a size is not too dear.
    """
    size = Size.of(order_2.problem, order_2.mesh, order_2.constraints, order_2.contacts)
    mesh = flat_mesh(order_2, mesh_data(order_2)) if own.mesh.comm.bcast(fits(size)) else None
    found: FlatMesh | None = None
    if mesh is not None:
        error = steps[-1].stress_error if own is order_2 else np.zeros(0)
        rough = np.unique(mesh.cells[_roughest(mesh, error)] if len(error) else np.zeros(0, np.int64))
        found = _cut(mesh, Places.of(own.problem, own.contacts, steps), rough, size, fits)
    found = own.mesh.comm.bcast(found)
    return found


def flat_mesh(system: System, data: MeshData) -> FlatMesh | None:
    """The mesh of bodies of order 2 in the plane, on rank 0; collective."""
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


@dataclass(frozen=True)
class Corners:
    """Where stresses may grow without end: corners of bodies in the plane, and ends of what acts on them."""

    points: Array  # (n, 2) [m]
    middles: Array  # (c, 2) of cells [m]
    sizes: Array  # (c,) farthest node from there [m]
    body: Ints  # (c,)

    @classmethod
    def of(cls, system: System) -> Corners | None:
        """Those of bodies of order 2; None: in space, and on other ranks than the first; collective."""
        mesh = flat_mesh(system, mesh_data(system)) if system.mesh.dim == 2 else None
        if mesh is None:
            return None
        nodes = mesh.points[mesh.cells]
        middles = nodes.mean(axis=1)
        sizes = np.linalg.norm(nodes - middles[:, None], axis=2).max(axis=1)
        supports = system.problem.supports.values()
        mirrors = [each.boundary for each in supports if each.boundary is not None and len(each.displacement) == 1]
        return cls(mesh.points[_corners(mesh, acted_on(system.problem), mirrors)], middles, sizes, mesh.body)

    def far(self, point: Array) -> bool:
        """Whether all corners are beyond the cells around a point (2,) [m], and those around these."""
        cell = int(np.linalg.norm(self.middles - point, axis=1).argmin())
        return bool(np.linalg.norm(self.points - point, axis=1).min(initial=np.inf) > 4 * self.sizes[cell])

    def smooth(self, step: StepResult, probes: Mapping[str, Array]) -> frozenset[Quantity]:
        """Numbers of a step that are those of a place far from all corners: they have a limit.

        Args:
            probes: their points (2,) [m].
        """
        places = {Quantity("probes", name, "stress"): point for name, point in probes.items()}
        for name, contact in step.contacts.items():
            places[Quantity("contacts", name, "max_pressure")] = contact.points[int(contact.pressure.argmax())]
        for index, name in enumerate(step.bodies):
            own = np.flatnonzero(self.body == index)
            place = self.middles[own[int(step.von_mises[own].argmax())]]
            places[Quantity("bodies", name, "max_von_mises")] = place
        return frozenset(key for key, place in places.items() if self.far(place))


def _roughest(mesh: FlatMesh, error: Array) -> Ints:
    """The cells with the largest errors of the stress (c,) [Pa] that hold half of the squared error of all."""
    middles = mesh.points[mesh.cells].mean(axis=1, keepdims=True)
    squares = error**2 * np.square(mesh.points[mesh.cells] - middles).sum(axis=(1, 2))  # as large as the cells are
    order = np.argsort(-squares)
    sums = np.cumsum(squares[order])
    return order[: 1 + np.searchsorted(sums, sums[-1] / 2)]


def _cut(mesh: FlatMesh, places: Places, rough: Ints, size: Size, fits: Callable[[Size], bool]) -> FlatMesh | None:
    """Cut the cells at some places; None: it would be too dear.

    Args:
        rough: nodes whose cells are cut, too.
        size: of a history on the mesh.
    """
    for cuts in CUTS:
        finer = mesh
        for _ in range(cuts):
            finer = finer.cut(finer.touching(np.concatenate([places.nodes(finer), rough])))
        more = places.contact_nodes(finer) / max(places.contact_nodes(mesh), 1)  # there may be no contact
        if fits(size.times(len(finer.points) / len(mesh.points), more)):
            return finer
    log.info("cells are not cut where the error comes from: that would be too dear")
    return None


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
