"""Segments of a slave curve (2D), each facing one master facet: between the projections of the facet's ends.

A master node is projected on the slave point whose interpolated normal points at it.
"""

from __future__ import annotations

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import LAST_DIGITS, Array, Ints
from stickslip.geometry.surfaces.bounding_balls import candidate_pairs
from stickslip.geometry.surfaces.facet_map import place
from stickslip.geometry.surfaces.surface import Surface

BULGE = 1.2  # a curved facet lies within this multiple of the ball around its nodes
MAX_IT = 60


def segments(slave: Surface, master: Surface, normals: Array, reach: float) -> tuple[Ints, Ints, Array]:
    """Find the segments of the slave surface that face master facets; 2D only.

    Args:
        normals: unit normals at the slave's nodes (n, 2).
        reach: largest distance of the two surfaces [m].

    Returns:
        Slave facets (c,), master facets (c,), and ends of the segments (c, 2, 1) in slave reference coordinates.
    """
    field = normals[slave.facets]  # (f, k, d)
    middle = field.mean(axis=1)
    spread = np.linalg.norm(field - middle[:, None], axis=2).max(axis=1)  # of the normals along a facet
    centres, radii = _balls(slave)
    blocks = list(candidate_pairs(centres, radii + reach * spread, middle, *_balls(master), reach))
    i, j = (np.concatenate(rows) for rows in zip(*blocks, strict=True))
    away = place(master, j, np.full((len(j), 1), 0.5)).area_normals
    facing = np.einsum("qd,qd->q", away, middle[i]) < 0
    i, j = i[facing], j[facing]
    feet = [_project_on_slave(slave, field, i, master.points[master.facets[j, end]]) for end in (0, 1)]
    ends = np.sort(np.stack(feet, axis=1), axis=1)
    kept = ends[:, 1] - ends[:, 0] > LAST_DIGITS  # in reference coordinates
    return i[kept], j[kept], ends[kept][:, :, None]


def _balls(surface: Surface) -> tuple[Array, Array]:
    """Centres (f, d) and radii (f,) of the bounding balls of the facets [m]."""
    nodes = surface.points[surface.facets]
    centres = nodes.mean(axis=1)
    return centres, BULGE * np.linalg.norm(nodes - centres[:, None], axis=2).max(axis=1)


def _project_on_slave(slave: Surface, field: Array, facets: Ints, points: Array) -> Array:
    """Reference coordinate (q,) at which the interpolated normal of a facet points at `points` (q, 2).

    Newton's method within bounds; the facet's nearer end if the solution lies beyond it, NaN if the normals of the
    facet intersect before they reach the point.
    """
    low, high = np.zeros(len(facets)), np.ones(len(facets))
    left = _offset_from_normal(slave, field, facets, low, points)[0] <= 0
    right = _offset_from_normal(slave, field, facets, high, points)[0] >= 0
    foot = np.where(left, low, np.where(right, high, 0.5))
    foot[left & right] = np.nan
    active = np.flatnonzero(~left & ~right)
    for _ in range(MAX_IT):
        value, slope = _offset_from_normal(slave, field, facets[active], foot[active], points[active])
        low[active] = np.where(value > 0, foot[active], low[active])
        high[active] = np.where(value < 0, foot[active], high[active])
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = foot[active] - value / slope
        inside = (moved >= low[active] - LAST_DIGITS) & (moved <= high[active] + LAST_DIGITS)
        moved = np.where(inside, moved, (low[active] + high[active]) / 2)
        still = np.abs(moved - foot[active]) <= LAST_DIGITS
        foot[active] = moved
        active = active[~still]
        if not len(active):
            break
    return np.clip(foot, 0, 1)


def _offset_from_normal(slave: Surface, field: Array, facets: Ints, local: Array, points: Array) -> tuple[Array, Array]:
    """Offset (q,) [m] of points (q, 2) from the normal line at `local` (q,), positive towards the facet's end.

    Returns:
        The offset and its derivative by `local`.
    """
    basis, (gradient,) = dx.reference_basis(slave.shape, slave.degree, local[:, None])
    nodes, sign = slave.points[slave.facets[facets]], slave.outward[facets]
    away = points - np.einsum("qk,qkd->qd", basis, nodes)
    tangent = np.einsum("qk,qkd->qd", gradient, nodes)
    normal, turn = (np.einsum("qk,qkd->qd", table, field[facets]) for table in (basis, gradient))
    value = sign * (away[:, 1] * normal[:, 0] - away[:, 0] * normal[:, 1])
    slope = sign * (away[:, 1] * turn[:, 0] - away[:, 0] * turn[:, 1])
    return value, slope - sign * (tangent[:, 1] * normal[:, 0] - tangent[:, 0] * normal[:, 1])
