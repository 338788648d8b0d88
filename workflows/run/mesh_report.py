"""Report on a scene's mesh, and warnings if it is too coarse for its contacts, before anything is solved."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from stickslip.geometry.amplitude import Amplitude, listed_times, value_at
from stickslip.geometry.arrays import ROUNDING, Bools
from stickslip.geometry.mesh.cell_quality import worst_quality
from stickslip.geometry.mesh.mesh import Mesh, build_mesh
from stickslip.geometry.mesh.nodes import Nodes
from stickslip.geometry.surfaces.surface import Surface
from stickslip.geometry.units import Units
from stickslip.solvers.accuracy.errors import faced
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.effects import EFFECTS
from stickslip.solvers.fem.supports import find_constraints
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.timeline import Place
from stickslip.solvers.simulation.memory import Counts, Demand, least_available, memory_of, spare
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.stepping.choice import Choice, Size, chosen
from stickslip.solvers.system.system import contact_rows, displacement_space

CORNERS = {"interval": 2, "triangle": 3, "quadrilateral": 4}
EDGES = {"triangle": [(0, 1), (1, 2), (2, 0)], "quadrilateral": [(0, 1), (0, 2), (1, 3), (2, 3)]}


@dataclass(frozen=True)
class ContactReport:
    """A contact surface before it is deformed; lengths [m], areas [m^2], in plane models per metre."""

    normal_points: int
    tangential_points: int
    dropped_multipliers: int
    area: float
    elements_across: int
    smallest_gap: float  # of the points that face the other side
    largest_gap: float
    overlapping_points: int
    overlap_area: float
    points_that_can_touch: int
    other_elements_across: int | None = None  # of the other side; None: a rigid obstacle
    other_size: float | None = None  # of its elements by those of this side, where the gap is smallest


@dataclass(frozen=True)
class MeshReport:
    """Counts of the whole mesh, and its contacts by name."""

    cells: int
    nodes: int
    worst_quality: float
    contacts: Mapping[str, ContactReport]
    plane: bool  # whether areas are those of a metre of thickness
    units: str = "SI"  # as the scene names them
    seams: Mapping[str, int] = field(default_factory=dict)  # pairs of nodes at which a body is open, by body
    note: str = ""  # what was done to the cells of a file

    @property
    def area_unit(self) -> tuple[str, str]:
        """Word for an area, and its unit."""
        return ("length", self.length_unit) if self.plane else ("area", Units.of(self.units)("m²"))

    @property
    def length_unit(self) -> str:
        """The unit of lengths."""
        return Units.of(self.units).length

    def lines(self) -> Iterator[str]:
        """Sentences for the terminal and the log."""
        area, unit = self.area_unit
        yield f"mesh: {self.cells} cells, {self.nodes} nodes, worst quality {self.worst_quality:.2f}"
        yield from filter(None, [self.note])
        for name, c in self.contacts.items():
            overlap = f"{c.overlapping_points} points overlap, {c.overlap_area:.4g} {unit}"
            other = ""
            if c.other_elements_across is not None:
                other = (
                    f" ({c.other_elements_across} of the other side, {c.other_size:.3g} times as large where nearest)"
                )
            yield (
                f"contact {name}: {c.normal_points} normal and {c.tangential_points} tangential points, {area} "
                f"{c.area:.4g} {unit}, {c.elements_across} elements across{other}, gap {c.smallest_gap:.4g} to "
                f"{c.largest_gap:.4g} {self.length_unit}, {overlap if c.overlapping_points else 'no overlap'}"
            )

    def warnings(self) -> Iterator[str]:
        """Warnings, one line each."""
        if self.worst_quality < 0.1:
            yield f"worst cell quality {self.worst_quality:.2g} is below 0.1; change mesh_size or the geometry"
        for name, pairs in self.seams.items():
            yield (
                f"body {name} is in pieces: {pairs} pairs of nodes lie at the same place and do not hold; "
                "join them in the file (in gmsh Coherence or fragment, or remove duplicate nodes)"
            )
        for name, c in self.contacts.items():
            if not c.points_that_can_touch:
                gap = f"{c.smallest_gap:.4g} {self.length_unit}"
                yield f"contacts.{name}: never touches: the gap is {gap}, and nothing closes it"
            elif c.points_that_can_touch < 4:
                yield (
                    f"contacts.{name}: only {c.points_that_can_touch} points can touch, fewer than 4; refine "
                    "contact_mesh_size, or check the gap"
                )


def report_mesh(scene: Scene, mesh: Mesh, nodes: int, contacts: Sequence[ContactRows]) -> MeshReport:
    """Report on a mesh and its contact surfaces; collective.

    Args:
        nodes: number of nodes of the mesh.
        contacts: rows of every contact.
    """
    size = float(np.max(np.ptp(mesh.box(), axis=0)))
    return MeshReport(
        cells=int(mesh.domain.topology.index_map(mesh.dim).size_global),
        nodes=nodes,
        worst_quality=worst_quality(mesh.domain, mesh.degree),
        contacts={c.name: _report_contact(scene, c, size) for c in contacts},
        plane=scene.model.startswith("plane"),
        units=scene.units,
        seams=mesh.seams,
        note=scene.geometry.note(scene.dim),
    )


def _report_contact(scene: Scene, c: ContactRows, size: float) -> ContactReport:
    facing = c.node_weights > 0
    facing |= not facing.any()  # what slides may meet its partner later
    overlap, gaps = facing & (c.node_gap < -ROUNDING * size), c.node_gap[facing]
    changes = c.fields is not None and c.fields.change
    times = scene.requested_times() if changes else ()
    least = np.min([c.node_gap, *(c.at(t).node_gap for t in times)], axis=0)
    nearest = facing & (c.node_gap <= gaps.min(initial=np.inf) + ROUNDING * size)
    return ContactReport(
        normal_points=len(c.W_n),
        tangential_points=len(c.W_t),
        dropped_multipliers=c.dropped,
        area=float(c.node_weights.sum()),
        elements_across=elements_across(c.surface),
        smallest_gap=float(gaps.min()),
        largest_gap=float(gaps.max()),
        overlapping_points=int(overlap.sum()),
        overlap_area=float(c.node_weights[overlap].sum()),
        points_that_can_touch=int(np.sum(can_touch(scene, least[facing], size))),
        other_elements_across=None if c.master is None else elements_across(c.master),
        other_size=None if c.master is None else _size_at(c.master, faced(c, nearest)) / _size_at(c.surface, nearest),
    )


def _size_at(surface: Surface, nodes: Bools) -> float:
    """Mean edge [m] of the facets at these nodes (n,); of all facets without nodes."""
    facets = surface.facets[nodes[surface.facets].any(axis=1)] if nodes.any() else surface.facets
    ends = surface.points[facets[:, :2]]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).mean())


def can_touch(scene: Scene, gap: Any, size: float) -> Any:
    """Which points may come into contact (m,): the motions of supports and obstacles are large enough to close the gap.

    Under forces a body may also move as a whole until its first point touches, and is then indented by at most 1 % of
    its size: more is not a small strain.

    Args:
        gap: (m,) [m].
        size: of the bodies [m].
    """
    end = scene.steps.end
    moved = [a for place, a in scene.drives().items() if place.quantity == "displacement"]
    of_place = [place for place in scene.expressions() if place.quantity == "displacement"]
    reach = float(np.sum([_largest(a, end) for a in moved]))
    reach += sum(float(np.abs([scene.sampled(p, t) for t in scene.requested_times()]).max()) for p in of_place)
    turned = [_largest(o.rotation.angle, end) for o in scene.obstacles.values() if o.rotation is not None]
    reach += size * float(np.sum(turned))
    forced = bool(scene.loads) or any(effect.acts and effect.because(scene) for effect in EFFECTS)
    forced = forced or any(_largest(a, end) > 0 for place, a in scene.drives().items() if _pushes(place))
    if forced:
        gap, reach = gap - max(0.0, float(np.min(gap))), reach + 0.01 * size
    return gap <= reach + ROUNDING * size


def _pushes(place: Place) -> bool:
    """Whether a value in time is a force or a moment, or turns a side about a point, however far away that is."""
    return place.quantity in ("force", "moment") or (place.table, place.quantity) == ("remote_points", "rotation")


def _largest(amplitude: Amplitude, end: float) -> float:
    """Largest absolute value up to the end [s]."""
    return max(abs(value_at(amplitude, t, end)) for t in (*listed_times(amplitude), end))


def elements_across(surface: Surface) -> int:
    """Number of facets across the surface at its widest place, from edge to edge; halfway around if it is closed."""
    facets, n = surface.facets[:, : CORNERS[surface.shape]], len(surface.nodes)
    pairs = np.concatenate([facets[:, pair] for pair in EDGES.get(surface.shape, [(0, 1)])])
    ones = np.ones(len(pairs))
    graph = sparse.csr_matrix((ones, (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    depth = dijkstra(graph, directed=False, unweighted=True, indices=_edge_nodes(pairs, facets), min_only=True)
    reached = depth[facets]
    reached = reached[np.isfinite(reached).all(axis=1)]
    return int(np.max(reached.min(axis=1) + reached.max(axis=1), initial=0) + 1)


def _edge_nodes(pairs: Any, facets: Any) -> Any:
    """Nodes on the edge of the surface; any one node if it is closed."""
    if facets.shape[1] == 2:
        found, count = np.unique(facets, return_counts=True)
        ends = found[count == 1]
    else:
        edges, count = np.unique(np.sort(pairs, axis=1), axis=0, return_counts=True)
        ends = np.unique(edges[count == 1])
    return ends if len(ends) else facets[:1, 0]


def look(scene: Scene) -> tuple[MeshReport, Choice, Demand]:
    """The mesh report, the choice of methods, and the memory that a run will take; assembles nothing; collective."""
    problem = resolve(scene)
    mesh = build_mesh(problem.shape, problem.request, MPI.COMM_WORLD)
    space = displacement_space(mesh)
    nodes = Nodes.of(mesh, space)
    constraints = find_constraints(problem, mesh, space, nodes)
    contacts = contact_rows(problem, mesh, space, nodes, constraints)
    report = report_mesh(scene, mesh, nodes.total, contacts)
    size = Size.of(problem, mesh, constraints, contacts)
    choice = chosen(size, scene.solver, least_available(mesh.comm))
    return report, choice, memory_of(scene.output, Counts.of(mesh), size, choice)


def count(scene: Scene) -> dict[str, Any]:
    """The mesh report and the choice of methods as plain data, for `stickslip plan --mesh`."""
    report, choice, demand = look(scene)
    return {
        **asdict(report),
        "displacement_unknowns": demand.unknowns,
        "method": choice.stages[0].method,
        "choice": {**asdict(choice.stages[0]), "because": choice.because},
        "memory": demand.plain(spare(MPI.COMM_WORLD)),
        "warnings": list(report.warnings()),
    }
