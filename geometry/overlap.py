"""Quadrature over the part of a slave surface that faces a master surface, cell by cell of the two meshes' overlay."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geometry import dolfinx_versions as dx
from geometry.cells import Cells, cut_apart, nearest
from geometry.clipping import triangles
from geometry.facet_map import locate, place
from geometry.segments import segments
from geometry.surface import Surface

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Overlap:
    """Quadrature points of the part of a slave surface that faces a master surface: q points, ordered by slave facet.

    Cells are cut in the reference coordinates of the slave facet and weigh what its area weighs there: over a facet
    that is covered as a whole they add up to its integral, whatever its curvature.
    """

    slave_facet: Ints  # (q,) row of slave.facets
    slave_local: Array  # (q, d-1) reference coordinates there
    master_facet: Ints  # (q,)
    master_local: Array  # (q, d-1)
    weights: Array  # (q,) [m^(d-1)]: integral over the slave surface (2 pi r included if axisymmetric)
    gap: Array  # (q,) [m] signed, along the slave normal, positive = open
    normals: Array  # (q, d) unit slave normals used there: nodal averaged normals, interpolated, normalised


def overlap(slave: Surface, master: Surface, reach: float, degree: int) -> Overlap:
    """Lay two surfaces over each other.

    A master facet counts where it faces the slave (their normals are opposed) at no more than `reach` [m], the nearest
    one if there are several; both are decided for a cell as a whole, at its centre. In the plane a point's partner
    lies along its own normal, in space along the averaged normal at the centre of its facet.

    Args:
        degree: of the quadrature on a cell, in reference coordinates: that of the integrand, and of the area.
    """
    normals = slave.node_normals()

    def gap(cells: Cells, local: Array) -> Array:
        return _face(slave, master, normals, cells, local, np.zeros(len(local))).gap

    if slave.dim == 2:
        cells = cut_apart(Cells(*segments(slave, master, normals, reach)), master)
    else:
        cells = Cells(*triangles(slave, master, normals, reach))
    cells = cells[np.abs(gap(cells, cells.corners.mean(axis=1))) <= reach]
    cells = cells[nearest(cells, master, gap)]
    cells = cells[np.argsort(cells.slave_facet, kind="stable")]
    points, weights = dx.reference_rule("interval" if slave.dim == 2 else "triangle", degree)
    each = cells[np.repeat(np.arange(len(cells.areas)), len(weights))]
    local = cells.at(points).reshape(-1, slave.dim - 1)
    return _face(slave, master, normals, each, local, np.outer(cells.areas, weights).ravel())


def _face(slave: Surface, master: Surface, normals: Array, cells: Cells, local: Array, areas: Array) -> Overlap:
    """What faces one place (q, d-1) on each of the cells (q,); `areas` (q,) in reference coordinates."""
    here = place(slave, cells.slave_facet, local)
    normal = np.einsum("qk,qkd->qd", here.basis, normals[slave.facets[cells.slave_facet]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    middle = dx.reference_nodes(master.shape, 1).mean(axis=0)
    start = np.tile(middle, (len(local), 1))
    along = normal if cells.directions is None else cells.directions
    partner = locate(master, cells.master_facet, start, here.points, along)
    away = place(master, cells.master_facet, partner).points - here.points
    weights = areas * here.stretch
    if slave.axisymmetric:
        weights = weights * 2 * np.pi * here.points[:, 0]
    gap = np.einsum("qd,qd->q", away, normal)
    return Overlap(cells.slave_facet, local, cells.master_facet, partner, weights, gap, normal)
