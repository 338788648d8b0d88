"""Points of a surface from their place on a facet, and back along a direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry import dolfinx_versions as dx
from geometry.arrays import Array, Ints
from geometry.surfaces.surface import Surface

TOLERANCE = 1e-14  # by the facet's size, or where that is less by what rounding leaves of it
MAX_IT = 25


@dataclass(frozen=True)
class Placed:
    """Quadrature points, or any others, q of them, each on a facet of its own."""

    basis: Array  # (q, k)
    points: Array  # (q, d) [m]
    tangents: Array  # (q, d-1, d) [m]
    area_normals: Array  # (q, d) outward, as long as the area of the reference facet's image

    @property
    def stretch(self) -> Array:
        """Area of the facet by area of the reference facet (q,)."""
        return np.asarray(np.linalg.norm(self.area_normals, axis=1))


def place(surface: Surface, facets: Ints, local: Array) -> Placed:
    """Points at reference coordinates `local` (q, d-1) of `facets` (q,)."""
    basis, gradient = dx.reference_basis(surface.shape, surface.degree, local)
    nodes = surface.points[surface.facets[facets]]
    tangents = np.einsum("aqk,qkd->qad", gradient, nodes)
    if surface.dim == 2:
        normals = np.stack([tangents[:, 0, 1], -tangents[:, 0, 0]], axis=1)
    else:
        normals = np.cross(tangents[:, 0], tangents[:, 1])
    points = np.einsum("qk,qkd->qd", basis, nodes)
    return Placed(basis, points, tangents, normals * surface.outward[facets][:, None])


def locate(surface: Surface, facets: Ints, start: Array, points: Array, directions: Array) -> Array:
    """Reference coordinates (q, d-1) where the lines through `points` along `directions` (q, d) meet the facets.

    Newton from `start`; exact after one step on a straight facet, NaN where it finds nothing.
    """
    across = _across(directions)
    nodes = surface.points[surface.facets[facets]]
    rounding = np.abs(nodes).max(axis=(1, 2)) / np.ptp(nodes, axis=1).max(axis=1)
    local, size = start.copy(), np.full(len(start), np.inf)
    active = np.arange(len(start))
    for _ in range(MAX_IT):
        here = place(surface, facets[active], local[active])
        away = np.einsum("qad,qd->qa", across[active], points[active] - here.points)
        step = _solve(np.einsum("qad,qbd->qab", across[active], here.tangents), away)
        local[active] += step
        size[active] = np.abs(step).max(axis=1) / (1 + np.abs(local[active]).max(axis=1) + rounding[active])
        active = np.flatnonzero(size > TOLERANCE)  # NaN stays NaN
        if not len(active):
            break
    local[~(size <= 1e3 * TOLERANCE)] = np.nan
    return local


def _across(directions: Array) -> Array:
    """d-1 vectors (q, d-1, d) that a direction (q, d) is normal to."""
    if directions.shape[1] == 2:
        return np.asarray(np.stack([-directions[:, 1], directions[:, 0]], axis=1)[:, None])
    least = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, least)
    return np.stack([first, np.cross(directions, first)], axis=1)


def _solve(matrix: Array, right: Array) -> Array:
    """Solutions (q, a) of q small systems (q, a, a), infinite or NaN where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        if matrix.shape[1] == 1:
            return np.asarray(right / matrix[:, 0])
        (a, b), (c, d) = np.moveaxis(matrix, 0, 2)
        u, v = right.T
        return np.asarray(np.stack([d * u - b * v, a * v - c * u], axis=1) / (a * d - b * c)[:, None])
