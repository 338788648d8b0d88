"""The map from a reference facet to the surface, and its inverse: projection on a facet along a given direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import LAST_DIGITS, Array, Ints
from stickslip.geometry.surfaces.surface import Surface

MAX_IT = 25


@dataclass(frozen=True)
class Placed:
    """q points of a surface, one on each of q facets (a facet may occur several times)."""

    basis: Array  # (q, k) values of the nodal basis
    points: Array  # (q, d) [m]
    tangents: Array  # (q, d-1, d) derivatives by the reference coordinates [m]
    area_normals: Array  # (q, d) outward normals, their length is the Jacobian `stretch`

    @property
    def stretch(self) -> Array:
        """Jacobian (q,) [m^(d-1)]: area of the facet per area of the reference facet."""
        return np.asarray(np.linalg.norm(self.area_normals, axis=1))


def place(surface: Surface, facets: Ints, local: Array) -> Placed:
    """Map reference coordinates `local` (q, d-1) of `facets` (q,) to points of the surface."""
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
    """Project points on facets along given directions.

    Newton's method; one step is exact on a straight facet. The result may lie outside the reference facet.

    Args:
        facets: (q,) one for each point.
        start: (q, d-1) first iterate.
        points: (q, d) [m].
        directions: (q, d).

    Returns:
        Reference coordinates (q, d-1) of the intersection of line and facet; NaN where the method does not converge.
    """
    across = _orthogonal(directions)
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
        active = np.flatnonzero(size > LAST_DIGITS)  # NaN stays NaN
        if not len(active):
            break
    local[~(size <= 1e3 * LAST_DIGITS)] = np.nan
    return local


def _orthogonal(directions: Array) -> Array:
    """d-1 independent vectors (q, d-1, d) orthogonal to each direction (q, d)."""
    if directions.shape[1] == 2:
        return np.asarray(np.stack([-directions[:, 1], directions[:, 0]], axis=1)[:, None])
    least = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, least)
    return np.stack([first, np.cross(directions, first)], axis=1)


def _solve(matrix: Array, right: Array) -> Array:
    """Solutions (q, a) of q linear systems (q, a, a), a = 1 or 2; infinite or NaN where the matrix is singular."""
    with np.errstate(divide="ignore", invalid="ignore"):
        if matrix.shape[1] == 1:
            return np.asarray(right / matrix[:, 0])
        (a, b), (c, d) = np.moveaxis(matrix, 0, 2)
        u, v = right.T
        return np.asarray(np.stack([d * u - b * v, a * v - c * u], axis=1) / (a * d - b * c)[:, None])
