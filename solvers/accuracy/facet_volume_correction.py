"""Volume between straight facets and the curved surfaces of bodies: its forces, and the rim of flat sides.

Cells at a curved surface stand for a part of the body that is larger than they are, or smaller, by the facet times its
mean bulge, see `find_bulging`. To first order their stiffness, weight and thermal load grow by the same ratio. Where a
flat side ends at a curved line its facets leave out a rim, which tractions and pressure act on as well. Drawn bolts
stay as they are.

Source: the derivative of the energy with respect to the shape, Sokolowski & Zolésio, Introduction to Shape
Optimization (1992), section 2.

`bulges` finds how far curved sides bulge out of their straight facets, from the facets alone. In 2D a facet of length
L bulges by k L²/8 in its middle, k the curvature of the side: the angle between two facets by the distance of their
middles. Of the curvatures at its two ends the smaller one counts, none if their signs differ: an arc has the same
everywhere, a kink between straight facets has one on neither of them. In 3D an edge with the outward normals n_a, n_b
at its ends bulges by L/8 (n_b - n_a) . t, t its direction.

Source: of the edges in 3D Vlachos, Peters, Boyd & Mitchell, Proc. I3D (2001).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import ROUNDING, Array, Ints, inverse_and_determinant
from stickslip.geometry.curved_facets import SHARP, Bulging, normals_of
from stickslip.geometry.protocols import UflForm, Vec
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.accuracy.bubbles import inner_forces
from stickslip.solvers.effects import active
from stickslip.solvers.fem.forms import multiplied
from stickslip.solvers.fem.terms import LoadTerm
from stickslip.solvers.scene.timeline import Place
from stickslip.solvers.system.applied_loads import AppliedLoads
from stickslip.solvers.system.system import System


def bulges(straight: Surface, middles: Surface) -> Array:
    """Displacement (n, d) [m] of the nodes of a side of order 2 from its straight facets, zero at their corners.

    Args:
        straight: the side at order 1.
        middles: the same facets at the next order, their nodes between the corners on those facets.
    """
    found = np.zeros_like(middles.points)
    if straight.dim == 2:
        found[middles.facets[:, 2]] = _of_facets(straight)
        return found
    normals = straight.node_normals()
    corners = dx.reference_basis(straight.shape, 1, dx.reference_nodes(straight.shape, 2))[0]
    # of a basis function: less is rounding
    edges = {k: np.flatnonzero(row > ROUNDING) for k, row in enumerate(corners)}
    for k, ends in edges.items():
        if len(ends) == 2:
            a, b = straight.facets[:, ends].T
            turned = np.einsum("fd,fd->f", normals[b] - normals[a], straight.points[b] - straight.points[a])
            found[middles.facets[:, k]] = turned[:, None] / 16 * (normals[a] + normals[b])
    for k, ends in edges.items():
        if len(ends) == 4:  # the middle of a quadrilateral bulges in both directions
            around = [j for j, pair in edges.items() if len(pair) == 2]
            found[middles.facets[:, k]] = found[middles.facets[:, around]].sum(axis=1) / 2
    return found


def _of_facets(side: Surface) -> Array:
    """Bulge (f, 2) [m] of each facet in 2D."""
    ends = side.points[side.facets]
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    normals = side.outward[:, None] * np.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
    curvature = np.full(side.facets.shape, np.nan)  # nan: the side ends there, or has a crease
    count, ends_of = np.bincount(side.facets.ravel()), np.repeat(np.arange(len(ends)), 2)
    total = np.bincount(side.facets.ravel(), ends_of)
    for k, sign in enumerate((-1.0, 1.0)):
        node, each = side.facets[:, k], np.arange(len(ends))
        other = np.where(count[node] == 2, total[node] - each, each).astype(int)
        smooth = np.einsum("fd,fd->f", normals, normals[other]) > np.cos(np.radians(SHARP))
        turned = sign * np.einsum("fd,fd->f", normals[other] - normals, along) / length
        curvature[:, k] = np.where((other != each) & smooth, 2 * turned / (length + length[other]), np.nan)
    first, last = (np.where(np.isnan(a), b, a) for a, b in (curvature.T, curvature.T[::-1]))
    both = np.where(first * last > 0, np.sign(first) * np.minimum(np.abs(first), np.abs(last)), 0.0)
    return np.asarray((both * length**2 / 8)[:, None] * normals)


FACETS = {"triangle": 3, "tetrahedron": 4, "quadrilateral": 4, "hexahedron": 6}


class LeftOut:
    """Forces on the nodes of the mesh of order 1, of what its facets leave out of the bodies."""

    def __init__(self, system: System) -> None:
        """Compile the forms; collective."""
        problem, mesh, weak = system.problem, system.mesh, system.weak
        self._system, self._u = system, dx.fem.Function(system.space)
        share = _share_left_out(system)
        for strain in system.initial.strains:
            if strain.shrunk is not None:  # the tension of a bolt is that of its section in the mesh
                share[mesh.cells_of(strain.body)] = 0.0
        denser = dx.cell_function(mesh.domain, share)
        sides = {load.boundary for load in problem.loads.values() if load.force is None}
        rims = dx.cell_function(mesh.domain, _share_of_rims(system, sorted(sides)))

        def grown(form: UflForm, loaded: bool = True) -> UflForm | None:
            return multiplied(form, {"cell": denser} | ({"exterior_facet": rims} if loaded else {}))

        inner = [grown(form, loaded=False) for form in inner_forces(problem, weak, self._u)]
        self._inner = [weak.compile(form) for form in inner if form is not None]
        terms = [*weak.loads(), *(term for effect in active(problem) for term in effect.loads(problem, weak))]
        forms = [(term, grown(term.form, not _is_resultant(term))) for term in terms]
        self._loads = AppliedLoads(weak, [replace(term, form=form) for term, form in forms if form is not None])
        initial = [grown(weak.initial_load(strain)) for strain in system.initial.strains]
        self._initial = [None if form is None else dx.assemble_vector(weak.compile(form)) for form in initial]

    def load(self, time: float) -> Vec:
        """External forces at a time [s], without initial strains [N]; collective."""
        total = self._system.vector()
        self._loads.add_to(total, self._system.course, time)
        return total

    def inner(self, u: Vec, initial: Array) -> Vec:
        """Inner forces [N] of a displacement u [m] and of initial strains with values (k,); collective."""
        dx.fill(self._u, u.array_r)
        first, *others = (dx.assemble_vector(form) for form in self._inner)
        total = sum(others, start=first)
        for value, vector in zip(initial, self._initial, strict=False):  # springs come behind strains
            if vector is not None:
                total.axpy(-value, vector)
        return total


def _share_left_out(system: System) -> Array:
    """Volume that facets leave out, by that of the cell (cells,), ghosts included."""
    mesh = system.mesh
    nodes, x = dx.cell_nodes(mesh.domain), mesh.domain.geometry.x
    numbers = np.asarray(mesh.domain.geometry.input_global_indices, np.int64)
    shape = mesh.domain.topology.cell_type.name
    found, bulging = np.zeros(len(nodes)), mesh.bulging
    curved = np.zeros(mesh.node_count, bool)
    curved[bulging.facets[bulging.facets >= 0]] = True
    near = np.flatnonzero(curved[numbers[nodes]].sum(axis=1) >= mesh.dim)
    own = nodes[near]
    known = {tuple(row): out for row, out in zip(bulging.facets.tolist(), bulging.out, strict=True)}
    gradient = dx.reference_basis(shape, 1, dx.midpoint(mesh.domain))[1][:, 0]
    jacobian = np.einsum("an,cni->iac", gradient, x[own][:, :, : mesh.dim])
    volume = dx.reference_rule(shape, 1)[1].sum() * np.abs(inverse_and_determinant(jacobian)[1])
    middle = x[own].mean(axis=1)
    for corners in (dx.facet_dofs(system.space, k) for k in range(FACETS[shape])):
        rows = np.sort(numbers[own[:, corners]], axis=1)
        rows = np.pad(rows, ((0, 0), (bulging.facets.shape[1] - rows.shape[1], 0)), constant_values=-1)
        at = [k for k, row in enumerate(rows.tolist()) if tuple(row) in known]
        if not at:
            continue
        out = np.array([known[tuple(row)] for row in rows[at].tolist()])
        points = x[_in_order(own[at][:, corners])]
        area, centre = normals_of(points), points.mean(axis=1)
        area *= np.sign(np.einsum("fi,fi->f", area, centre - middle[at]))[:, None]
        more = np.einsum("fi,fi->f", out, area[:, : mesh.dim]) / volume[at]
        if mesh.axisymmetric:
            more *= centre[:, 0] / middle[at, 0]
        found[near[at]] += more
    return found


def _share_of_rims(system: System, sides: Iterable[str]) -> Array:
    """Area of the rims of sides by that of the facet of the cell (cells,), ghosts included."""
    mesh = system.mesh
    nodes, found = dx.cell_nodes(mesh.domain), np.zeros(len(dx.cell_nodes(mesh.domain)))
    if mesh.dim == 2 or not len(mesh.bulging.edges):
        return found
    x = mesh.domain.geometry.x
    numbers = np.asarray(mesh.domain.geometry.input_global_indices, np.int64)
    for side in sides:
        cells, local = dx.facet_cells(mesh.domain, mesh.facets(side)).T
        if not len(cells):
            continue
        facets = np.array([nodes[cell][dx.facet_dofs(system.space, k)] for cell, k in zip(cells, local, strict=True)])
        corners = _in_order(facets)
        found[cells] = sum(_rims(x, numbers, corners, mesh.bulging)) / np.linalg.norm(normals_of(x[corners]), axis=1)
    return found


def _in_order(facets: Ints) -> Ints:
    """Corners (f, k) of facets, one after the other around them."""
    return facets if facets.shape[1] < 4 else facets[:, [0, 1, 3, 2]]


def _edges_of(corners: Ints) -> list[tuple[Ints, Ints]]:
    """Both ends (f,) of each edge of facets with corners (f, k)."""
    count = corners.shape[1]
    return [(corners[:, k], corners[:, (k + 1) % count]) for k in range(count)]


def _rims(points: Array, numbers: Ints, corners: Ints, bulging: Bulging) -> list[Array]:
    """Area (f,) [m²] of the rim beyond each edge of the facets with corners (f, k) in 3D.

    Args:
        numbers: of the points in the gmsh model.
    """
    known = {tuple(row): beside for row, beside in zip(bulging.edges.tolist(), bulging.beside, strict=True)}
    centre, found = points[corners].mean(axis=1), []
    for a, b in _edges_of(corners):
        rows = np.sort(np.stack([numbers[a], numbers[b]], axis=1), axis=1).tolist()
        beside = np.array([known.get(tuple(row), np.zeros(3)) for row in rows]).reshape(-1, 3)
        along = points[b] - points[a]
        length = np.linalg.norm(along, axis=1, keepdims=True)
        outward = points[a] - centre
        outward = outward - np.einsum("fi,fi->f", outward, along)[:, None] * along / length**2
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        found.append(np.einsum("fi,fi->f", beside, outward) * length[:, 0])
    return found


def _is_resultant(term: LoadTerm) -> bool:
    """Whether a load is given by its resultant, which no rim changes."""
    return isinstance(term.drive, Place) and term.drive.quantity == "force"
