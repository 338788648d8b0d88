"""A side of a body as a small mesh of its own, the same on every rank.

The volume is distributed, the surface is replicated: O(N^(2/3)) data.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from geometry import dolfinx_versions as dx
from geometry.arrays import Array, Bools, Ints
from geometry.mesh.mesh import Mesh
from geometry.mesh.nodes import Nodes

CREASE = 40.0  # [degrees] smooth sides bend less from facet to facet, edges that are meant as edges more
TIE = 1e-9  # areas that differ by less are equal


def largest_smooth_part(facets: Ints, normals: Array, crease: float) -> Bools:
    """Whether a facet is in the smooth part with the largest area at its node (f, k).

    Two facets of a node are smooth together if their normals there differ by no more than `crease` degrees, or if
    others lead from one to the other in such steps. The average over a crease belongs to neither side: a line along
    it leaves the body slantwise and misses the surface that lies against the node's larger side. Of equal parts the
    one with the lowest facet has it.

    Args:
        facets: (f, k) nodes of facets.
        normals: (f, k, d) outward normals, as long as the area.
    """
    node = facets.ravel()
    area = np.linalg.norm(normals, axis=2).ravel()
    direction = normals.reshape(len(node), -1) / area[:, None]
    corners = sparse.csr_matrix((np.ones(len(node)), (np.arange(len(node)), node)))  # of facets, at their nodes
    i, j = (corners @ corners.T).nonzero()
    smooth = np.einsum("cd,cd->c", direction[i], direction[j]) >= np.cos(np.radians(crease)) - TIE
    parts, part = connected_components(sparse.csr_matrix((smooth[smooth], (i[smooth], j[smooth]))), directed=False)
    size = np.bincount(part, area, parts)[part]
    largest = np.zeros(node.max() + 1)
    np.maximum.at(largest, node, size)
    large = np.flatnonzero(size >= (1 - TIE) * largest[node])
    first = np.full(node.max() + 1, len(node))
    np.minimum.at(first, node[large], large)
    return np.asarray(part == part[first[node]]).reshape(facets.shape)


FACET_OF = {
    "triangle": "interval",
    "quadrilateral": "interval",
    "tetrahedron": "triangle",
    "hexahedron": "quadrilateral",
}
EDGES = {"interval": {2: (0, 1)}, "triangle": {3: (1, 2), 4: (0, 2), 5: (0, 1)}}  # midside node -> its corners
ALPHA = 0.2  # part of a midside basis function that each corner of its edge takes over


@dataclass(frozen=True)
class Surface:
    """n nodes, f facets of k nodes each; ordered by the gmsh model's numbers, whatever the number of ranks.

    A quadratic triangle's corner functions have no integral, nor has that of a node on the axis of symmetry. There
    contact works with another basis of the same displacements, phi~ = change @ phi, all of whose integrals are
    positive: each corner takes over a part of its midside functions. Elsewhere phi~ = phi.

    Source of phi~: Popp, Wohlmuth, Gee & Wall, SIAM J. Sci. Comput. 34 (2012).
    """

    shape: str  # interval, triangle or quadrilateral
    degree: int
    nodes: Ints  # (n,) global node numbers
    input: Ints  # (n,) numbers in the gmsh model, increasing
    points: Array  # (n, d) [m]
    facets: Ints  # (f, k) rows of `nodes`, in dolfinx's order on a facet
    outward: Array  # (f,) 1 or -1: whether the facet's tangents make an outward normal
    axisymmetric: bool

    @property
    def dim(self) -> int:
        return int(self.points.shape[1])

    def quadrature(self, degree: int) -> tuple[Array, Array]:
        """Weights (f, q) [m^(d-1)], 2 pi r included, and values of the basis (q, k), at quadrature points."""
        points, weights = dx.reference_rule(self.shape, degree)
        basis, gradient = dx.reference_basis(self.shape, self.degree, points)
        corners = self.points[self.facets]
        scale = np.linalg.norm(_normals(corners, gradient), axis=2)
        if self.axisymmetric:
            scale = scale * 2 * np.pi * np.einsum("qk,fk->fq", basis, corners[:, :, 0])
        return weights * scale, basis

    @cached_property
    def change(self) -> Array:
        """(k, k): phi~ = change @ phi on a facet."""
        k = self.facets.shape[1]
        matrix = np.eye(k)
        if self.degree == 2 and (self.axisymmetric or self.shape == "triangle"):
            for middle, corners in EDGES[self.shape].items():
                matrix[list(corners), middle] = ALPHA
                matrix[middle, middle] = 1 - 2 * ALPHA
        return matrix

    @cached_property
    def transform(self) -> Any:
        """(n, n) sparse: nodal values, coefficients of phi, to coefficients of phi~."""
        return self._at_nodes(np.linalg.inv(self.change.T))

    @cached_property
    def forces_transform(self) -> Any:
        """(n, n) sparse: forces that work on nodal values to forces that work on the coefficients of phi~."""
        return self._at_nodes(self.change.T).T.tocsr()

    def _at_nodes(self, matrix: Array) -> Any:
        """The (k, k) matrix, the same on every facet, over all nodes; facets agree about shared entries."""
        n = len(self.nodes)
        i = np.broadcast_to(self.facets[:, :, None], (*self.facets.shape, len(matrix)))
        j = np.broadcast_to(self.facets[:, None, :], i.shape)
        values = np.broadcast_to(matrix, i.shape)
        at, first = np.unique(i[values != 0] * n + j[values != 0], return_index=True)
        return sparse.csr_matrix((values[values != 0][first], (at // n, at % n)), shape=(n, n))

    def node_weights(self) -> Array:
        """∫ phi~_j ds (n,), the lumped weights, all positive."""
        weights, basis = self.quadrature(2 * self.degree + self.axisymmetric)
        total = self.scatter(weights @ basis @ self.change.T)
        assert np.all(total > 0)
        return total

    def dual_basis(self, degree: int) -> Array:
        """Biorthogonal basis psi (f, q, k): on each facet ∫ psi_i phi~_k ds = delta_ik ∫ phi~_k ds."""
        weights, basis = self.quadrature(degree)
        basis = basis @ self.change.T
        mass = np.einsum("fq,qi,qk->fik", weights, basis, basis)
        lumped = weights @ basis
        coefficients = lumped[:, :, None] * np.linalg.inv(mass)
        return np.asarray(np.einsum("fik,qk->fqi", coefficients, basis))

    def node_normals(self, crease: float = 180.0) -> Array:
        """Outward unit normals (n, d), averaged over the facets of the side, area weighted.

        Args:
            crease: [degrees]; a node where the facets differ by more takes the largest smooth part of them.
        """
        local = dx.reference_nodes(self.shape, self.degree)
        normals = _normals(self.points[self.facets], dx.reference_basis(self.shape, self.degree, local)[1])
        normals *= self.outward[:, None, None]  # as long as the area that the facet has there
        if crease < 180:
            normals *= largest_smooth_part(self.facets, normals, crease)[:, :, None]
        total = np.zeros_like(self.points)
        np.add.at(total, self.facets, normals)
        return np.asarray(total / np.linalg.norm(total, axis=1, keepdims=True))

    def neighbours(self) -> Any:
        """(n, n) sparse, 1 for nodes that share a facet."""
        n, k = len(self.nodes), self.facets.shape[1]
        pairs = np.repeat(self.facets, k, axis=1).ravel(), np.tile(self.facets, k).ravel()
        matrix = sparse.csr_matrix((pairs[0] != pairs[1], pairs), shape=(n, n))  # of booleans: repeated pairs stay 1
        return matrix.astype(float)

    def scatter(self, values: Array) -> Array:
        """Add facet values (f, k) up at the nodes (n,)."""
        total = np.zeros(len(self.nodes))
        np.add.at(total, self.facets, values)
        return total


def gather_surface(mesh: Mesh, space: Any, nodes: Nodes, side: str) -> Surface:
    """Collect a side from all ranks."""
    shape = FACET_OF[mesh.domain.topology.cell_type.name]
    cells = dx.facet_cells(mesh.domain, mesh.facets(side))
    dofs = dx.cell_dofs(space)
    local = np.array([dx.facet_dofs(space, i) for i in range(mesh.dim + 1 if _simplex(mesh) else 2 * mesh.dim)])
    found = dofs[cells[:, :1], local[cells[:, 1]]]  # (own facets, k)
    outward = _outward(nodes.points[found], nodes.points[dofs[cells[:, 0]]].mean(axis=1), shape, mesh.degree)
    comm = mesh.comm
    numbers = np.concatenate(comm.allgather(nodes.number[found]))
    inputs = np.concatenate(comm.allgather(nodes.input[found]))
    points = np.concatenate(comm.allgather(nodes.points[found]))
    signs = np.concatenate(comm.allgather(outward))
    unique, first, rows = np.unique(inputs, return_index=True, return_inverse=True)
    facets = rows.reshape(inputs.shape)
    order = np.lexsort(np.sort(facets, axis=1).T[::-1])
    return Surface(
        shape=shape,
        degree=mesh.degree,
        nodes=numbers.ravel()[first],
        input=unique,
        points=points.reshape(-1, mesh.dim)[first],
        facets=facets[order],
        outward=signs[order],
        axisymmetric=mesh.axisymmetric,
    )


def _simplex(mesh: Mesh) -> bool:
    return mesh.domain.topology.cell_type.name in ("triangle", "tetrahedron")


def _normals(corners: Array, gradient: Array) -> Array:
    """Normals (f, q, d) of facets with nodes (f, k, d), as long as the area of the reference facet's image."""
    tangents = np.einsum("aqk,fki->afqi", gradient, corners)
    if corners.shape[2] == 2:
        return np.stack([tangents[0, ..., 1], -tangents[0, ..., 0]], axis=2)
    return np.asarray(np.cross(tangents[0], tangents[1]))


def _outward(corners: Array, inside: Array, shape: str, degree: int) -> Array:
    """1 where the tangents' normal of a facet (f, k, d) points away from the point `inside` (f, d), else -1."""
    middle = dx.reference_nodes(shape, degree).mean(axis=0, keepdims=True)
    basis, gradient = dx.reference_basis(shape, degree, middle)
    away = np.einsum("k,fkd->fd", basis[0], corners) - inside
    return np.asarray(np.sign(np.einsum("fd,fd->f", _normals(corners, gradient)[:, 0], away)))
