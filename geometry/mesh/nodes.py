"""Nodes of a space of displacements: their local, global and gmsh numbers, coordinates and connected parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry import dolfinx_versions as dx
from geometry.arrays import Array, Ints
from geometry.mesh.mesh import Mesh
from geometry.protocols import FunctionSpace

SMALL = 1e-9  # of a basis function: less is rounding


@dataclass(frozen=True)
class Nodes:
    """The k local nodes, those that this rank owns first, then ghosts."""

    owned: int  # nodes that this rank owns
    offset: int  # global number of the first owned node
    total: int  # nodes of the whole mesh
    number: Ints  # (k,) global
    input: Ints  # (k,) number in the gmsh model, see `of`: the same on any number of ranks
    points: Array  # (k, d) [m]
    part: Ints  # (k,) part of the mesh, as in `Mesh.parts`

    @staticmethod
    def of(mesh: Mesh, space: FunctionSpace) -> Nodes:
        """Nodes of a Lagrange space of the mesh's own degree, or of degree 2 on straight cells.

        A node between those of the mesh gets a number beyond theirs: that of the pair of corners it is half way
        between, of several pairs the least.
        """
        domain, index_map = space.mesh, space.dofmap.index_map
        count = index_map.size_local + index_map.num_ghosts
        x, dofs = domain.geometry.x[:, : domain.geometry.dim], dx.cell_dofs(space)
        number, points = np.empty(count, np.int64), np.empty((count, x.shape[1]))
        of_cells, inputs = dx.cell_nodes(domain), np.asarray(domain.geometry.input_global_indices, np.int64)
        corners = inputs[of_cells]
        total = len(mesh.parts)
        for k, weights in enumerate(dx.reference_basis(*_lattice(mesh, dx.degree(space)))[0]):
            between = np.flatnonzero(weights > SMALL)
            points[dofs[:, k]] = x[of_cells[:, between]].mean(axis=1)
            if len(between) == 1:
                number[dofs[:, k]] = corners[:, between[0]]
                continue
            ends = np.sort(corners[:, _opposite(between)], axis=2)
            number[dofs[:, k]] = (total * (1 + ends[:, :, 0]) + ends[:, :, 1]).min(axis=1)
        return Nodes(
            owned=index_map.size_local,
            offset=index_map.local_range[0],
            total=index_map.size_global,
            number=np.asarray(index_map.local_to_global(np.arange(count, dtype=np.int32)), np.int64),
            input=number,
            points=points,
            part=mesh.parts_of(number),
        )


def _lattice(mesh: Mesh, degree: int) -> tuple[str, int, Array]:
    """Cell shape, degree of the mesh, and reference nodes of a space of `degree`."""
    shape = mesh.domain.topology.cell_type.name
    return shape, mesh.degree, dx.reference_nodes(shape, degree)


def _opposite(corners: Ints) -> Ints:
    """Pairs (m, 2) of the corners of an edge, a quadrilateral or a hexahedron that lie opposite each other."""
    return np.asarray(np.stack([corners, corners[::-1]], axis=1)[: len(corners) // 2])
