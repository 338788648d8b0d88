"""Segment-based integration: quadrature over the part of a slave surface that faces a master surface.

The cells of quadrature are those of the overlay of the two meshes: segments in 2D, clipped triangles in 3D.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import LAST_DIGITS, ROUNDING, Array, Bools, Ints, Rows, connected
from stickslip.geometry.surfaces.cells import Cells
from stickslip.geometry.surfaces.facet_map import locate, place
from stickslip.geometry.surfaces.overlay import segments, triangles
from stickslip.geometry.surfaces.search import through_body
from stickslip.geometry.surfaces.surface import Surface


def nearest_cells(cells: Cells, master: Surface, gap: Callable[[Cells, Array], Array]) -> Bools:
    """Which cells (c,) are not covered by a nearer master facet, judged at their centres.

    Only cells of different layers can cover each other, and few slave facets face several layers, see `_layers`.

    Args:
        gap: of cells at one point each (c, d-1), given in slave reference coordinates [m].
    """
    kept = np.ones(len(cells.slave_facet), bool)
    layer, rows = _layers(cells, master)
    i, j = _pairs_of_equals(cells.slave_facet[rows])
    i, j = rows[i], rows[j]
    i, j = i[layer[i] != layer[j]], j[layer[i] != layer[j]]
    centres = cells.corners.mean(axis=1)
    arms = cells.corners[j, 1:] - cells.corners[j, :1]
    share = np.linalg.solve(np.swapaxes(arms, 1, 2), (centres[i] - cells.corners[j, 0])[:, :, None])[:, :, 0]
    # relative to a cell: a centre on the edge of a cell is covered by it
    covers = (share > -ROUNDING).all(axis=1) & (share.sum(axis=1) < 1 + ROUNDING)
    i, j = i[covers], j[covers]
    own, other = (np.abs(gap(cells[k], centres[i])) for k in (i, j))
    kept[i[(other < own) | ((other == own) & (j < i))]] = False
    return kept


def split_overlapping(cells: Cells, master: Surface) -> Cells:
    """Split segments (2D) of different layers at each other's ends, so that two of them are equal or disjoint."""
    rows = _layers(cells, master)[1]
    i, j = _pairs_of_equals(cells.slave_facet[rows])
    ends = np.sort(cells.corners[rows, :, 0], axis=1)
    points = np.clip(ends[j], ends[i][:, :1], ends[i][:, 1:]).ravel()
    owner = np.repeat(i, 2)
    order = np.lexsort((points, owner))
    points, owner = points[order], owner[order]
    cut = (owner[1:] == owner[:-1]) & (np.diff(points) > LAST_DIGITS)  # in reference coordinates
    parts = cells[rows[owner[1:][cut]]]
    whole = cells[np.setdiff1d(np.arange(len(cells.slave_facet)), rows)]
    return Cells(
        np.concatenate([whole.slave_facet, parts.slave_facet]),
        np.concatenate([whole.master_facet, parts.master_facet]),
        np.concatenate([whole.corners, np.stack([points[:-1][cut], points[1:][cut]], axis=1)[:, :, None]]),
    )


def _layers(cells: Cells, master: Surface) -> tuple[Ints, Ints]:
    """Layer (c,) of each cell, and the rows of the cells on slave facets with more than one layer.

    A layer consists of the cells of a slave facet whose master facets are connected by nodes. As all of them face the
    slave, cells of one layer do not cover each other.
    """
    count, nodes = len(cells.slave_facet), master.facets[cells.master_facet]
    key = cells.slave_facet[:, None] * len(master.points) + nodes
    met, column = np.unique(key, return_inverse=True)
    row = np.repeat(np.arange(count), nodes.shape[1])
    layer = connected(count + len(met), row, count + column.ravel())[:count]
    pairs = np.unique(np.stack([cells.slave_facet, layer], axis=1), axis=0)
    facets, layers = np.unique(pairs[:, 0], return_counts=True)
    return layer, np.flatnonzero(np.isin(cells.slave_facet, facets[layers > 1]))


def _pairs_of_equals(keys: Ints) -> tuple[Ints, Ints]:
    """All pairs of rows with the same key, also of each row with itself.

    >>> _pairs_of_equals(np.array([7, 3, 7]))
    (array([0, 0, 1, 2, 2]), array([0, 2, 1, 0, 2]))
    """
    _, inverse, counts = np.unique(keys, return_inverse=True, return_counts=True)
    order, start = np.argsort(inverse, kind="stable"), np.cumsum(counts) - counts
    many = counts[inverse]
    i = np.repeat(np.arange(len(keys)), many)
    step = np.arange(len(i)) - np.repeat(np.cumsum(many) - many, many)
    return i, order[start[inverse[i]] + step]


@dataclass(frozen=True)
class Overlap(Rows):
    """The q quadrature points of the part of a slave surface that faces a master surface, ordered by slave facet.

    Cells are cut in the reference coordinates of the slave facet, and weights contain the Jacobian of the curved facet
    itself: on a facet that is covered as a whole, they add up to its area.
    """

    slave_facet: Ints  # (q,) row of slave.facets
    slave_local: Array  # (q, d-1) reference coordinates there
    master_facet: Ints  # (q,)
    master_local: Array  # (q, d-1)
    weights: Array  # (q,) [m^(d-1)]: integral over the slave surface (2 pi r included if axisymmetric)
    gap: Array  # (q,) [m] signed, along the slave normal, positive = open
    normals: Array  # (q, d) unit slave normals used there: nodal averaged normals, interpolated, normalised


def faced(slave: Surface, master: Surface, reach: float | Array) -> Cells:
    """The parts of a slave's facets that face the master's, ordered by slave facet.

    A master facet counts where it faces the slave (their normals are opposed) at a distance of at most `reach`; of
    several facets the nearest one counts. Both are decided for a cell as a whole, at its centre. A slave point is
    projected on the master along its own normal in 2D, along the averaged normal at the centre of its facet in 3D.

    Args:
        reach: of each master facet (g,), or of all [m].
    """
    normals, farthest = slave.node_normals(), float(np.max(reach))
    reach = np.broadcast_to(reach, len(master.facets))

    def gap(cells: Cells, local: Array) -> Array:
        return _project(slave, master, normals, cells, local, np.zeros(len(local))).gap

    if slave.dim == 2:
        cells = split_overlapping(Cells(*segments(slave, master, normals, farthest)), master)
    else:
        cells = Cells(*triangles(slave, master, normals, farthest))
    middle = _project(slave, master, normals, cells, cells.corners.mean(axis=1), np.zeros(len(cells.areas)))
    near = np.abs(middle.gap) <= reach[cells.master_facet]
    if slave.faces is not None or master.faces is not None:  # sides with edges may be all of a body's skin
        at = place(slave, cells.slave_facet, middle.slave_local).points
        near &= ~through_body(at, middle.normals, middle.gap, master)
    if slave.depth is not None:  # what lies deeper behind a facet is the far side of the same body
        near &= middle.gap >= -slave.depth[cells.slave_facet]
    cells = cells[near]
    cells = cells[nearest_cells(cells, master, gap)]
    return cells[np.argsort(cells.slave_facet, kind="stable")]


def overlap(slave: Surface, master: Surface, reach: float | Array, degree: int) -> Overlap:
    """The quadrature points of the parts that face each other, see `faced` and `over`."""
    return over(faced(slave, master, reach), slave, master, degree)


def over(cells: Cells, slave: Surface, master: Surface, degree: int) -> Overlap:
    """Quadrature points on cells of the slave, each with the master point that it faces.

    Args:
        degree: of the quadrature on a cell: the total degree of the integrand in reference coordinates, Jacobian
            included; 4 times the order for products of two basis functions on quadrilaterals, else 2 times.
    """
    points, weights = dx.reference_rule("interval" if slave.dim == 2 else "triangle", degree)
    each = cells[np.repeat(np.arange(len(cells.areas)), len(weights))]
    local = cells.at(points).reshape(-1, slave.dim - 1)
    found = _project(slave, master, slave.node_normals(), each, local, np.outer(cells.areas, weights).ravel())
    met = np.isfinite(found.gap).reshape(-1, len(weights)).all(axis=1)  # a line may miss a curved facet
    rows = np.repeat(met, len(weights))
    return found.at(rows)


def _project(slave: Surface, master: Surface, normals: Array, cells: Cells, local: Array, areas: Array) -> Overlap:
    """Project one point (q, d-1) of each of the cells (q,) on the master; `areas` (q,) in reference coordinates."""
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
