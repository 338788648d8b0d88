"""Nodes of a space of displacements: their local, global and gmsh numbers, coordinates and connected parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import ROUNDING, Array, Ints
from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.protocols import FunctionSpace


@dataclass(frozen=True)
class Nodes:
    """The k local nodes, those that this rank owns first, then ghosts."""

    owned: int  # nodes that this rank owns
    offset: int  # global number of the first owned node
    total: int  # nodes of the whole mesh
    number: Ints  # (k,) global
    input: Ints  # (k,) number in the gmsh model, see `of`: the same on any number of ranks
    points: Array  # (k, d) [m]
    part: Ints  # (k,) part of the mesh, see `find_parts`

    @staticmethod
    def of(mesh: Mesh, space: FunctionSpace) -> Nodes:
        """Nodes of a Lagrange space of the degree of the mesh's geometry, or of the next one.

        A node that is none of the mesh gets a number beyond those, of a pair of nodes of the mesh around it, see
        `_pair`: the same in all cells that have it.
        """
        domain, index_map = space.mesh, space.dofmap.index_map
        count = index_map.size_local + index_map.num_ghosts
        x, dofs = domain.geometry.x[:, : domain.geometry.dim], dx.cell_dofs(space)
        number, points = np.empty(count, np.int64), np.empty((count, x.shape[1]))
        of_cells, inputs = dx.cell_nodes(domain), np.asarray(domain.geometry.input_global_indices, np.int64)
        of_mesh, total = inputs[of_cells], mesh.node_count
        shape = domain.topology.cell_type.name
        at = dx.reference_nodes(shape, dx.degree(space))
        around = [x[corner] for corner in of_cells.T]
        for k, weights in enumerate(dx.reference_basis(shape, mesh.geometry_degree, at)[0]):
            same = np.flatnonzero(weights > 1 - ROUNDING)  # of a basis function: less is rounding
            if len(same):
                number[dofs[:, k]], points[dofs[:, k]] = of_mesh[:, same[0]], x[of_cells[:, same[0]]]
                continue
            points[dofs[:, k]] = sum(share * x_n for share, x_n in zip(weights, around, strict=True) if share)
            pair = _pair(shape, mesh.geometry_degree, at[k], of_mesh)
            number[dofs[:, k]] = (total * (1 + pair[:, :, 0]) + pair[:, :, 1]).min(axis=1)
        return Nodes(
            owned=index_map.size_local,
            offset=index_map.local_range[0],
            total=index_map.size_global,
            number=np.asarray(index_map.local_to_global(np.arange(count, dtype=np.int32)), np.int64),
            input=number,
            points=points,
            part=mesh.parts_of(number),
        )


def _pair(shape: str, degree: int, point: Array, nodes: Ints) -> Ints:
    """Pairs (c, p, 2) of nodes of each cell that tell a point (k,) of the reference cell from all others.

    The point lies on an edge, in a face or inside the cell. On straight cells it is half way between its corners: pairs
    of corners that lie opposite each other. On curved cells it is the nearest corner and the node in the middle of the
    edge, face or cell, or where there is none, the first two nodes between its corners.

    Args:
        nodes: (c, n) of the cells, in the mesh's numbers.
    """
    corners = np.flatnonzero(dx.reference_basis(shape, 1, point[None])[0][0] > ROUNDING)
    if degree == 1:
        opposite = np.stack([corners, corners[::-1]], axis=1)[: len(corners) // 2]
        return np.asarray(np.sort(nodes[:, opposite], axis=2))
    lattice = dx.reference_nodes(shape, degree)
    off = np.linalg.norm(lattice - lattice[corners].mean(axis=0), axis=1)
    if off.min() < ROUNDING:
        near = corners[np.argmin(np.linalg.norm(lattice[corners] - point, axis=1))]
        return np.asarray(nodes[:, None, [near, np.argmin(off)]])
    others = np.setdiff1d(np.arange(len(lattice)), corners)
    inside = dx.reference_basis(shape, 1, lattice[others])[0] > ROUNDING  # the corners that each is between
    between = others[~np.delete(inside, corners, axis=1).any(axis=1)]
    return np.asarray(np.sort(nodes[:, between], axis=1)[:, None, :2])
