"""A side of a body as a surface mesh, replicated on every rank.

The volume mesh is distributed; the surface has O(N^(2/3)) data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy import sparse

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import TINY, Array, Bools, Ints
from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.mesh.nodes import Nodes
from stickslip.geometry.mesh.ranks import of_all_ranks
from stickslip.geometry.protocols import FunctionSpace, Sparse
from stickslip.geometry.shape import Turn

FACET_OF = {
    "triangle": "interval",
    "quadrilateral": "interval",
    "tetrahedron": "triangle",
    "hexahedron": "quadrilateral",
}
EDGES = {"interval": {2: (0, 1)}, "triangle": {3: (1, 2), 4: (0, 2), 5: (0, 1)}}  # midside node -> its corners
ALPHA = 0.2  # share of a midside basis function that is added to those of the corners of its edge
SECTOR = 1 << 40  # added to the numbers of nodes for each further sector of a cyclic body, see `of_sectors`
HALVED = {
    "interval": np.array([[0, 2], [2, 1]]),
    "triangle": np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2], [3, 4, 5]]),
    "quadrilateral": np.array([[0, 4, 5, 8], [4, 1, 8, 6], [5, 8, 2, 7], [8, 6, 7, 3]]),
}  # nodes of order 2 at the corners of a facet's parts
BERNSTEIN = np.array([[1, 1 / 4, 0], [0, 1 / 2, 0], [0, 1 / 4, 1]])  # (1-x)², 2x(1-x), x² at x = 0, 1/2, 1


@dataclass(frozen=True)
class Surface:
    """n nodes and f facets of k nodes each, in the order of the gmsh model's numbers on any number of ranks.

    The integral of a corner's basis function is zero on a quadratic triangle, and at a node on the axis of symmetry.
    There contact uses another basis of the same space, phi~ = change @ phi, whose functions all have positive
    integrals: a share of each midside function is added to those of the corners. Elsewhere phi~ = phi, or, if the
    basis is to be `positive`, Bernstein's polynomials: means of pressures with phi~ are then not below zero.

    Source of phi~: Popp, Wohlmuth, Gee & Wall, SIAM J. Sci. Comput. 34 (2012).
    """

    shape: str  # interval, triangle or quadrilateral
    degree: int
    nodes: Ints  # (n,) global node numbers
    input: Ints  # (n,) numbers in the gmsh model, increasing
    points: Array  # (n, d) [m]
    facets: Ints  # (f, k) rows of `nodes`, in dolfinx's order on a facet
    outward: Array  # (f,) 1 if the cross product of the facet's tangents points outward, else -1
    axisymmetric: bool
    parts: Ints | None = None  # (n,) of the mesh, see `find_parts`; None: all nodes are of part 0
    positive: bool = False  # phi~ >= 0 everywhere: Bernstein's polynomials if the degree is 2
    images: tuple[Ints, Ints, Array] | None = None  # nodes (k,) of a cyclic sector, those they turn to, turns
    depth: Array | None = None  # (f,) [m] of the middle of the cell behind each facet; None: it does not matter
    ends: Ints | None = None  # (n,) 1 at edges to other sides, 2 there of sides that come first; 0 elsewhere
    beside: Surface | None = None  # where it has ends: it and the sides of its body; None: of cyclic sectors
    faces: Ints | None = None  # (n,) tell nodes apart that faces have at an edge, see `split_at_edges`; None: one face

    @property
    def dim(self) -> int:
        return int(self.points.shape[1])

    @property
    def facet_size(self) -> float:
        """Mean extent of the facets along an axis [m]; inf without any."""
        return float(np.ptp(self.points[self.facets], axis=1).max(axis=1).mean()) if len(self.facets) else np.inf

    @property
    def part(self) -> Ints:
        """Part of the mesh of each node (n,)."""
        return np.zeros(len(self.nodes), np.int64) if self.parts is None else self.parts

    @cached_property
    def at_edge(self) -> Array:
        """1.0 at the nodes (n,) of edges, where several faces have one each, else 0.0."""
        if self.faces is None:
            return np.zeros(len(self.nodes))
        _, each, count = np.unique(self.nodes, return_inverse=True, return_counts=True)
        return np.asarray((count[each] > 1) | (False if self.ends is None else self.ends > 0), float)

    @cached_property
    def shares_at_edges(self) -> Array:
        """Share (n,) that each node has in ∫ phi_j ds of all faces there; 1.0 where there is one."""
        weights, basis = self.quadrature(2 * self.degree + self.axisymmetric)
        own, (_, each) = self.scatter(weights @ basis), np.unique(self.nodes, return_inverse=True)
        total = np.bincount(each, own)[each]
        return np.divide(own, total, out=np.ones_like(own), where=(self.at_edge > 0) & (total > 0))

    def quadrature(self, degree: int) -> tuple[Array, Array]:
        """Quadrature weights (f, q) [m^(d-1)], 2 pi r included if axisymmetric, and values of the basis (q, k)."""
        points, weights = dx.reference_rule(self.shape, degree)
        basis, gradient = dx.reference_basis(self.shape, self.degree, points)
        corners = self.points[self.facets]
        scale = np.linalg.norm(_normals(corners, gradient), axis=2)
        if self.axisymmetric:
            scale = scale * 2 * np.pi * np.einsum("qk,fk->fq", basis, corners[:, :, 0])
        return weights * scale, basis

    @cached_property
    def change(self) -> Array:
        """Change of basis (k, k) on a facet: phi~ = change @ phi."""
        k = self.facets.shape[1]
        matrix = np.eye(k)
        if self.degree == 2 and self.positive and self.shape == "quadrilateral":
            x, y = np.rint(2 * dx.reference_nodes(self.shape, 2)).astype(int).T  # 0, 1 or 2
            return np.asarray(BERNSTEIN[np.ix_(x, x)] * BERNSTEIN[np.ix_(y, y)])
        if self.degree == 2 and (self.positive or self.axisymmetric or self.shape == "triangle"):
            alpha = BERNSTEIN[0, 1] if self.positive else ALPHA
            for middle, corners in EDGES[self.shape].items():
                matrix[list(corners), middle] = alpha
                matrix[middle, middle] = 1 - 2 * alpha
        return matrix

    @property
    def borrows(self) -> bool:
        """Whether the corners' functions phi~ of a rigid law have shares of the midside functions."""
        return self.degree == 2 and not self.positive and (self.axisymmetric or self.shape == "triangle")

    @cached_property
    def transform(self) -> Sparse:
        """Matrix (n, n) from nodal values, the coefficients of phi, to coefficients of phi~."""
        return self._at_nodes(np.linalg.inv(self.change.T))

    @cached_property
    def forces_transform(self) -> Sparse:
        """Matrix (n, n) from forces dual to nodal values to forces dual to the coefficients of phi~."""
        return self._at_nodes(self.change.T).T.tocsr()

    def _at_nodes(self, matrix: Array) -> Sparse:
        """Matrix (n, n) over all nodes of a (k, k) matrix that all facets have; entries of shared nodes count once."""
        n = len(self.nodes)
        i = np.broadcast_to(self.facets[:, :, None], (*self.facets.shape, len(matrix)))
        j = np.broadcast_to(self.facets[:, None, :], i.shape)
        values = np.broadcast_to(matrix, i.shape)
        at, first = np.unique(i[values != 0] * n + j[values != 0], return_index=True)
        found: Sparse = sparse.csr_matrix((values[values != 0][first], (at // n, at % n)), shape=(n, n))
        return found

    def node_weights(self, part: Bools | None = None) -> Array:
        """Integrals ∫ phi~_j ds (n,) [m^(d-1)] over all facets, all positive; or over some of them (f,)."""
        weights, basis = self.quadrature(2 * self.degree + self.axisymmetric)
        total = self.scatter((weights if part is None else weights * part[:, None]) @ basis @ self.change.T)
        assert part is not None or np.all(total > 0)
        return total

    @cached_property
    def all_weights(self) -> Array:
        """`node_weights` over all facets."""
        return self.node_weights()

    @cached_property
    def of_corners(self) -> tuple[Surface, Array]:
        """This side of order 2 as one of order 1, its facets cut at their nodes, and the weights (n,) of its nodes."""
        parts = HALVED[self.shape]
        facets = self.facets[:, parts].reshape(-1, parts.shape[1])
        found = replace(self, degree=1, facets=facets, outward=np.repeat(self.outward, len(parts)))
        return found, found.node_weights()

    def dual_basis(self, degree: int) -> Array:
        """Dual (biorthogonal) basis psi (f, q, k): on each facet ∫ psi_i phi~_k ds = delta_ik ∫ phi~_k ds."""
        weights, basis = self.quadrature(degree)
        basis = basis @ self.change.T
        mass = np.einsum("fq,qi,qk->fik", weights, basis, basis)
        lumped = weights @ basis
        coefficients = lumped[:, :, None] * np.linalg.inv(mass)
        return np.asarray(np.einsum("fik,qk->fqi", coefficients, basis))

    def node_normals(self) -> Array:
        """Unit outward normals (n, d) at nodes: area-weighted averages over the facets of the side."""
        total = self._sums_of_normals()
        return np.asarray(total / np.linalg.norm(total, axis=1, keepdims=True))

    def _sums_of_normals(self) -> Array:
        """Sums (n, d) over the facets of the side at each node, before they are made unit; see `node_normals`."""
        normals, total = self.facet_normals(), np.zeros_like(self.points)
        np.add.at(total, self.facets, normals)
        if self.images is None:
            return total
        here, there, turn = self.images
        whole = total.copy()  # with the facets of the next sector
        whole[here] += np.einsum("kji,kj->ki", turn, total[there])
        whole[there] += np.einsum("kij,kj->ki", turn, total[here])
        return whole

    def facet_normals(self) -> Array:
        """Outward normals (f, k, d) of the facets at their nodes; their length is the Jacobian of the facet there."""
        local = dx.reference_nodes(self.shape, self.degree)
        normals = _normals(self.points[self.facets], dx.reference_basis(self.shape, self.degree, local)[1])
        return normals * self.outward[:, None, None]

    @cached_property
    def fold(self) -> Sparse:
        """Matrix (n, n) that moves integrals at turned nodes of a cyclic sector to those that they are images of."""
        own, n = np.arange(len(self.nodes)), len(self.nodes)
        onto = own.copy()
        if self.images is not None:
            onto[self.images[1]] = self.images[0]
        found: Sparse = sparse.csr_matrix((np.ones(n), (onto, own)), shape=(n, n))
        return found

    @cached_property
    def neighbours(self) -> Sparse:
        """Adjacency (n, n): 1 for different nodes that share a facet."""
        n, k = len(self.nodes), self.facets.shape[1]
        pairs = np.repeat(self.facets, k, axis=1).ravel(), np.tile(self.facets, k).ravel()
        different = pairs[0] != pairs[1]  # booleans: a pair that occurs twice stays 1
        matrix: Sparse = sparse.csr_matrix((different, pairs), shape=(n, n))
        return matrix.astype(float)

    def scatter(self, values: Array) -> Array:
        """Sum values at the nodes of facets (f, k) to values at nodes (n,)."""
        total = np.zeros(len(self.nodes))
        np.add.at(total, self.facets, values)
        return total


def selected(surface: Surface, nodes: Ints, facets: Ints, of: Ints | Bools | slice = slice(None)) -> Surface:
    """Surface of some of its nodes (n,), in this order, with facets (f, k) among them.

    Args:
        of: which of the surface's facets they are.
    """
    every = ("nodes", "input", "points", "parts", "ends", "faces"), ("outward", "depth")
    found = {key: getattr(surface, key)[at] for keys, at in zip(every, (nodes, of), strict=True)
             for key in keys if getattr(surface, key) is not None}  # fmt: skip
    return replace(surface, facets=facets, **found)


def joined(surfaces: Sequence[Surface]) -> Surface:
    """Several surfaces with facets of one kind as one, whose nodes and facets follow each other."""
    first, counts = surfaces[0], [len(surface.nodes) for surface in surfaces]
    starts, faces, images = np.cumsum([0, *counts[:-1]]), None, None
    ends = [np.zeros(len(s.nodes), np.int64) if s.ends is None else s.ends for s in surfaces]
    turned = [(k + i[0], k + i[1], i[2]) for k, i in zip(starts, (s.images for s in surfaces), strict=True) if i]
    if turned:
        here, there, turn = (np.concatenate(parts) for parts in zip(*turned, strict=True))
        images = here, there, turn
    if any(surface.faces is not None for surface in surfaces):
        of_each = [np.zeros(n, np.int64) if s.faces is None else s.faces for s, n in zip(surfaces, counts, strict=True)]
        after = np.cumsum([0, *(own.max() + 1 for own in of_each[:-1])])
        faces = np.concatenate([own + k for own, k in zip(of_each, after, strict=True)])
    return replace(
        first,
        nodes=np.concatenate([surface.nodes for surface in surfaces]),
        input=np.concatenate([surface.input for surface in surfaces]),
        points=np.concatenate([surface.points for surface in surfaces]),
        facets=np.concatenate([surface.facets + k for surface, k in zip(surfaces, starts, strict=True)]),
        outward=np.concatenate([surface.outward for surface in surfaces]),
        parts=np.concatenate([surface.part for surface in surfaces]),
        images=images,
        ends=np.concatenate(ends) if any(each.any() for each in ends) else None,
        depth=None,
        faces=faces,
    )


def of_sectors(side: Surface, turns: Sequence[Turn]) -> Surface:
    """A side of a cyclic body in a sector and in those beside it, to which its points turn; their nodes have numbers
    of their own."""
    copies = [
        replace(side, nodes=side.nodes + k * SECTOR, input=side.input + k * SECTOR, points=turn.moved(side.points))
        for k, turn in enumerate(turns, 1)
    ]
    return replace(joined([side, *copies]), beside=side.beside and of_sectors(side.beside, turns))


def in_sectors(values: Array, nodes: Ints, sectors: Array) -> Array:
    """Vectors (n, d) at nodes, from those that these have in the first sector.

    Args:
        sectors: (s, d, d) by which vectors turn to each of them, the first 1.
    """
    if len(sectors) == 1:
        return values
    return np.asarray(np.einsum("nij,nj->ni", sectors[nodes // SECTOR], values))


def gather_surface(mesh: Mesh, space: FunctionSpace, nodes: Nodes, side: str) -> Surface:
    """Gather a side (named body.side) from all ranks on every rank; collective."""
    (_, own), every = _own_facets(mesh, space, nodes, side), partial(of_all_ranks, mesh.comm)
    unique, first = np.unique(every(own.input), return_index=True)
    facets = np.searchsorted(unique, every(own.input[own.facets]))
    order = np.lexsort(np.sort(facets, axis=1).T[::-1])
    return replace(
        own,
        nodes=every(own.nodes)[first],
        input=unique,
        points=every(own.points)[first],
        facets=facets[order],
        outward=every(own.outward)[order],
        depth=None if own.depth is None else every(own.depth)[order],
        parts=None if own.parts is None else every(own.parts)[first],
    )


@dataclass(frozen=True)
class OwnNodes:
    """The n nodes of a side that this rank owns, in the order of the gmsh model's numbers."""

    local: Ints  # (n,) local numbers
    normals: Array  # (n, d) unit outward, see `Surface.node_normals`
    weights: Array  # (n,) integrals of phi_j over the side [m^(d-1)]


def own_nodes(mesh: Mesh, space: FunctionSpace, nodes: Nodes, side: str) -> OwnNodes:
    """The nodes of a side (named body.side) by their owners, whoever owns the facets there; collective."""
    local, facets = _own_facets(mesh, space, nodes, side)
    total, count = np.zeros(nodes.points.shape), np.zeros(nodes.points.shape)
    total[local], count[local] = facets._sums_of_normals(), 1.0
    weights, basis = facets.quadrature(2 * facets.degree)
    count[local, 1] = facets.scatter(weights @ basis)
    total, count = dx.sums_on_owners(space, total), dx.sums_on_owners(space, count)
    found = np.flatnonzero(count[:, 0])
    found = found[np.argsort(nodes.input[found])]
    size = np.linalg.norm(total[found], axis=1, keepdims=True)  # 0 at the ends of a crack
    return OwnNodes(found, total[found] / np.maximum(size, TINY), count[found, 1])


def _own_facets(mesh: Mesh, space: FunctionSpace, nodes: Nodes, side: str) -> tuple[Ints, Surface]:
    """The facets of a side that this rank owns; local numbers (n,) of their nodes first."""
    shape, degree = FACET_OF[mesh.domain.topology.cell_type.name], dx.degree(space)
    cells = dx.facet_cells(mesh.domain, mesh.facets(side))
    dofs = dx.cell_dofs(space)
    of_facet = np.array([dx.facet_dofs(space, i) for i in range(mesh.dim + 1 if mesh.simplicial else 2 * mesh.dim)])
    found = dofs[cells[:, :1], of_facet[cells[:, 1]]]  # (own facets, k)
    local, facets = np.unique(found, return_inverse=True)
    outward, depth = _outward(nodes.points[found], nodes.points[dofs[cells[:, 0]]].mean(axis=1), shape, degree)
    return local, Surface(
        shape=shape,
        degree=degree,
        nodes=nodes.number[local],
        input=nodes.input[local],
        points=nodes.points[local],
        facets=facets.reshape(found.shape),
        outward=outward,
        depth=depth,
        axisymmetric=mesh.axisymmetric,
        parts=nodes.part[local] if mesh.part_count > 1 else None,
    )


def _normals(corners: Array, gradient: Array) -> Array:
    """Normals (f, q, d) of facets with nodes (f, k, d); their length is the Jacobian of the facet."""
    tangents = np.einsum("aqk,fki->afqi", gradient, corners)
    if corners.shape[2] == 2:
        return np.stack([tangents[0, ..., 1], -tangents[0, ..., 0]], axis=2)
    return np.asarray(np.cross(tangents[0], tangents[1]))


def _outward(corners: Array, inside: Array, shape: str, degree: int) -> tuple[Array, Array]:
    """1 where the tangents' normal of a facet (f, k, d) points away from the point `inside` (f, d), else -1; its depth.

    Depths (f,) [m] are those of the points behind the middles of the facets.
    """
    middle = dx.reference_nodes(shape, degree).mean(axis=0, keepdims=True)
    basis, gradient = dx.reference_basis(shape, degree, middle)
    away = np.einsum("k,fkd->fd", basis[0], corners) - inside
    normals = _normals(corners, gradient)[:, 0]
    depth = np.einsum("fd,fd->f", normals, away) / np.linalg.norm(normals, axis=1)
    return np.sign(depth), np.abs(depth)


def surface_stiffness(surface: Surface) -> Sparse:
    """Laplace-Beltrami stiffness ∫ grad phi_i . grad phi_j ds (n, n) [m^(d-3)] of the nodal basis phi.

    grad is the gradient along the surface.
    """
    degree = 2 * surface.degree
    weights, _ = surface.quadrature(degree)
    points, _ = dx.reference_rule(surface.shape, degree)
    gradient = dx.reference_basis(surface.shape, surface.degree, points)[1]
    tangents = np.einsum("aqk,fki->fqai", gradient, surface.points[surface.facets])
    inverse = np.linalg.inv(tangents @ tangents.swapaxes(2, 3))  # of the first fundamental form
    return _assembled(surface, np.einsum("fq,aqi,fqab,bqj->fij", weights, gradient, inverse, gradient, optimize=True))


def consistent_mass(surface: Surface) -> Sparse:
    """Consistent mass ∫ phi_i phi_j ds (n, n) [m^(d-1)] of the nodal basis phi."""
    weights, basis = surface.quadrature(2 * surface.degree + surface.axisymmetric)
    return _assembled(surface, np.einsum("fq,qi,qj->fij", weights, basis, basis, optimize=True))


def _assembled(surface: Surface, local: Array) -> Sparse:
    """Sum (n, n) of the matrices of the facets (f, k, k)."""
    i = np.broadcast_to(surface.facets[:, :, None], local.shape)
    j = np.broadcast_to(surface.facets[:, None, :], local.shape)
    n = len(surface.nodes)
    matrix: Sparse = sparse.csr_matrix((local.ravel(), (i.ravel(), j.ravel())), shape=(n, n))
    return matrix


def lumped_mass(surface: Surface) -> Array:
    """Lumped mass (n,) [m^(d-1)] of the nodal basis, all positive: each facet's area in the ratio of its ∫ phi_i² ds.

    Source: Hinton, Rock & Zienkiewicz, Earthquake Eng. Struct. Dyn. 4 (1976).
    """
    weights, basis = surface.quadrature(2 * surface.degree + surface.axisymmetric)
    share = weights @ basis**2
    return surface.scatter(share * (weights.sum(axis=1) / share.sum(axis=1))[:, None])
