"""A side of a body as a small mesh of its own, the same on every rank.

The volume is distributed, the surface is replicated: O(N^(2/3)) data.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry import dolfinx_versions as dx
from geometry.mesh import Mesh
from geometry.nodes import Nodes

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
FACET_OF = {
    "triangle": "interval",
    "quadrilateral": "interval",
    "tetrahedron": "triangle",
    "hexahedron": "quadrilateral",
}


@dataclass(frozen=True)
class Surface:
    """n nodes, f facets of k nodes each; ordered by the gmsh model's numbers, whatever the number of ranks."""

    shape: str  # interval, triangle or quadrilateral
    nodes: Ints  # (n,) global node numbers
    input: Ints  # (n,) numbers in the gmsh model, increasing
    points: Array  # (n, d) [m]
    facets: Ints  # (f, k) rows of `nodes`
    normals: Array  # (f, d) outward unit normals

    @property
    def dim(self) -> int:
        return int(self.points.shape[1])

    def quadrature(self, degree: int) -> tuple[Array, Array]:
        """Weights (f, q) [m^(d-1)] and values of the basis (q, k) at the facets' quadrature points."""
        points, weights = dx.reference_rule(self.shape, degree)
        basis, gradient = dx.reference_basis(self.shape, 1, points)
        tangents = np.einsum("aqk,fki->fqai", gradient, self.points[self.facets])
        gram = np.einsum("fqai,fqbi->fqab", tangents, tangents)
        return weights * np.sqrt(np.linalg.det(gram)), basis

    def node_weights(self) -> Array:
        """∫ phi_j ds (n,), the lumped weights."""
        weights, basis = self.quadrature(2)
        return self.scatter(weights @ basis)

    def dual_basis(self, degree: int) -> Array:
        """Biorthogonal basis psi (f, q, k): on each facet ∫ psi_i phi_k ds = delta_ik ∫ phi_k ds."""
        weights, basis = self.quadrature(degree)
        mass = np.einsum("fq,qi,qk->fik", weights, basis, basis)
        lumped = weights @ basis
        coefficients = lumped[:, :, None] * np.linalg.inv(mass)
        return np.asarray(np.einsum("fik,qk->fqi", coefficients, basis))

    def node_normals(self) -> Array:
        """Outward unit normals (n, d), averaged over the facets of the side, area weighted."""
        areas = self.quadrature(2)[0].sum(axis=1)
        total = np.zeros_like(self.points)
        for column in self.facets.T:
            np.add.at(total, column, areas[:, None] * self.normals)
        return np.asarray(total / np.linalg.norm(total, axis=1, keepdims=True))

    def neighbours(self) -> dict[int, set[int]]:
        """Nodes that share a facet with each node."""
        found: dict[int, set[int]] = {j: set() for j in range(len(self.nodes))}
        for facet in self.facets:
            for j in facet:
                found[int(j)] |= set(facet.tolist()) - {int(j)}
        return found

    def scatter(self, values: Array) -> Array:
        """Add facet values (f, k) up at the nodes (n,)."""
        total = np.zeros(len(self.nodes))
        np.add.at(total, self.facets, values)
        return total


def gather_surface(mesh: Mesh, space: Any, nodes: Nodes, side: str) -> Surface:
    """Collect a side from all ranks."""
    cells = dx.facet_cells(mesh.domain, mesh.facets(side))
    dofs, per_facet = dx.cell_dofs(space), []
    local = [dx.facet_dofs(space, i) for i in range(mesh.dim + 1 if _simplex(mesh) else 2 * mesh.dim)]
    normals = []
    for cell, facet in cells:
        on_facet = dofs[cell][local[facet]]
        per_facet.append(on_facet)
        corners, centre = nodes.points[on_facet], nodes.points[dofs[cell]].mean(axis=0)
        normals.append(_outward(corners, centre))
    width = len(local[0])
    found = np.array(per_facet, np.int64).reshape(-1, width)
    comm = mesh.comm
    numbers = np.concatenate(comm.allgather(nodes.number[found]))
    inputs = np.concatenate(comm.allgather(nodes.input[found]))
    points = np.concatenate(comm.allgather(nodes.points[found]))
    all_normals = np.concatenate(comm.allgather(np.array(normals).reshape(-1, mesh.dim)))
    unique, first, rows = np.unique(inputs, return_index=True, return_inverse=True)
    facets = rows.reshape(inputs.shape)
    order = np.lexsort(np.sort(facets, axis=1).T[::-1])
    return Surface(
        shape=FACET_OF[mesh.domain.topology.cell_type.name],
        nodes=numbers.ravel()[first],
        input=unique,
        points=points.reshape(-1, mesh.dim)[first],
        facets=facets[order],
        normals=all_normals[order],
    )


def _simplex(mesh: Mesh) -> bool:
    return mesh.domain.topology.cell_type.name in ("triangle", "tetrahedron")


def _outward(corners: Array, inside: Array) -> Array:
    """Unit normal of a flat facet, away from the point `inside`."""
    edge = corners[1] - corners[0]
    normal = np.array([edge[1], -edge[0]]) if len(edge) == 2 else np.cross(edge, corners[2] - corners[0])
    normal = normal / np.linalg.norm(normal)
    return np.asarray(normal * np.sign(normal @ (corners.mean(axis=0) - inside)))
