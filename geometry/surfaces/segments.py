"""The parts of a plane slave surface that each master facet faces: segments between the feet of its ends."""

from __future__ import annotations

import numpy as np

from geometry import dolfinx_versions as dx
from geometry.arrays import Array, Ints
from geometry.surfaces.bounding_balls import near
from geometry.surfaces.facet_map import place
from geometry.surfaces.surface import Surface

BULGE = 1.2  # a curved facet leaves the ball around its nodes by less
MAX_IT = 60
TOLERANCE = 1e-14  # in reference coordinates


def segments(slave: Surface, master: Surface, normals: Array, reach: float) -> tuple[Ints, Ints, Array]:
    """Slave facets (c,), master facets (c,) and the ends of their segments (c, 2, 1) in slave coordinates.

    Args:
        normals: of the slave's nodes (n, 2); a point's foot is where the interpolated normal points at it.
        reach: how far the two may be apart [m].
    """
    field = normals[slave.facets]  # (f, k, d)
    middle = field.mean(axis=1)
    spread = np.linalg.norm(field - middle[:, None], axis=2).max(axis=1)  # the normals of a facet fan out
    centres, radii = _balls(slave)
    blocks = list(near(centres, radii + reach * spread, middle, *_balls(master), reach))
    i, j = (np.concatenate(rows) for rows in zip(*blocks, strict=True))
    away = place(master, j, np.full((len(j), 1), 0.5)).area_normals
    facing = np.einsum("qd,qd->q", away, middle[i]) < 0
    i, j = i[facing], j[facing]
    feet = [_foot(slave, field, i, master.points[master.facets[j, end]]) for end in (0, 1)]
    ends = np.sort(np.stack(feet, axis=1), axis=1)
    kept = ends[:, 1] - ends[:, 0] > TOLERANCE
    return i[kept], j[kept], ends[kept][:, :, None]


def _balls(surface: Surface) -> tuple[Array, Array]:
    nodes = surface.points[surface.facets]
    centres = nodes.mean(axis=1)
    return centres, BULGE * np.linalg.norm(nodes - centres[:, None], axis=2).max(axis=1)


def _foot(slave: Surface, field: Array, facets: Ints, points: Array) -> Array:
    """Reference coordinate (q,) whose normal points at `points` (q, 2); an end of the facet if that lies beyond it.

    Newton between bounds; NaN for a point where the normals of the facet have already crossed.
    """
    low, high = np.zeros(len(facets)), np.ones(len(facets))
    left = _beside(slave, field, facets, low, points)[0] <= 0
    right = _beside(slave, field, facets, high, points)[0] >= 0
    foot = np.where(left, low, np.where(right, high, 0.5))
    foot[left & right] = np.nan
    active = np.flatnonzero(~left & ~right)
    for _ in range(MAX_IT):
        value, slope = _beside(slave, field, facets[active], foot[active], points[active])
        low[active] = np.where(value > 0, foot[active], low[active])
        high[active] = np.where(value < 0, foot[active], high[active])
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = foot[active] - value / slope
        inside = (moved >= low[active] - TOLERANCE) & (moved <= high[active] + TOLERANCE)
        moved = np.where(inside, moved, (low[active] + high[active]) / 2)
        still = np.abs(moved - foot[active]) <= TOLERANCE
        foot[active] = moved
        active = active[~still]
        if not len(active):
            break
    return np.clip(foot, 0, 1)


def _beside(slave: Surface, field: Array, facets: Ints, local: Array, points: Array) -> tuple[Array, Array]:
    """How far points (q, 2) lie beside the normal at `local` (q,), towards the facet's end, and its derivative."""
    basis, (gradient,) = dx.reference_basis(slave.shape, slave.degree, local[:, None])
    nodes, sign = slave.points[slave.facets[facets]], slave.outward[facets]
    away = points - np.einsum("qk,qkd->qd", basis, nodes)
    tangent = np.einsum("qk,qkd->qd", gradient, nodes)
    normal, turn = (np.einsum("qk,qkd->qd", table, field[facets]) for table in (basis, gradient))
    value = sign * (away[:, 1] * normal[:, 0] - away[:, 0] * normal[:, 1])
    slope = sign * (away[:, 1] * turn[:, 0] - away[:, 0] * turn[:, 1])
    return value, slope - sign * (tangent[:, 1] * normal[:, 0] - tangent[:, 0] * normal[:, 1])
