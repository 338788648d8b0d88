"""How far curved sides bulge out of their straight facets, found from the facets alone.

In 2D a facet of length L bulges by k L²/8 in its middle, k the curvature of the side: the angle between two facets by
the distance of their middles. Of the curvatures at its two ends the smaller one counts, none if their signs differ: an
arc has the same everywhere, a kink between straight facets has one on neither of them. In 3D an edge with the outward
normals n_a, n_b at its ends bulges by L/8 (n_b - n_a) . t, t its direction.

Source: of the edges in 3D Vlachos, Peters, Boyd & Mitchell, Proc. I3D (2001).
"""

from __future__ import annotations

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import ROUNDING, Array
from stickslip.geometry.surfaces.surface import CREASE, Surface


def bulges(straight: Surface, middles: Surface) -> Array:
    """Displacement (n, d) [m] of the nodes of a side of order 2 from its straight facets, zero at their corners.

    Args:
        straight: the side at order 1; of order 2 it is curved already, and nothing bulges.
        middles: the same facets at the next order, their nodes between the corners on those facets.
    """
    found = np.zeros_like(middles.points)
    if straight.degree > 1:
        return found
    if straight.dim == 2:
        found[middles.facets[:, 2]] = _of_facets(straight)
        return found
    normals = straight.node_normals(straight.smooth_part(CREASE))
    corners = dx.reference_basis(straight.shape, 1, dx.reference_nodes(straight.shape, 2))[0]
    # of a basis function: less is rounding
    edges = {k: np.flatnonzero(row > ROUNDING) for k, row in enumerate(corners)}
    for k, ends in edges.items():
        if len(ends) == 2:
            a, b = straight.facets[:, ends].T
            turned = np.einsum("fd,fd->f", normals[b] - normals[a], straight.points[b] - straight.points[a])
            found[middles.facets[:, k]] = turned[:, None] / 16 * (normals[a] + normals[b])
    for k, ends in edges.items():
        if len(ends) == 4:  # the middle of a quadrilateral bulges in both directions
            around = [j for j, pair in edges.items() if len(pair) == 2]
            found[middles.facets[:, k]] = found[middles.facets[:, around]].sum(axis=1) / 2
    return found


def _of_facets(side: Surface) -> Array:
    """Bulge (f, 2) [m] of each facet in 2D."""
    ends = side.points[side.facets]
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    normals = side.outward[:, None] * np.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
    curvature = np.full(side.facets.shape, np.nan)  # nan: the side ends there, or has a crease
    count, total = (
        np.bincount(side.facets.ravel()),
        np.bincount(side.facets.ravel(), np.repeat(np.arange(len(ends)), 2)),
    )
    for k, sign in enumerate((-1.0, 1.0)):
        node, each = side.facets[:, k], np.arange(len(ends))
        other = np.where(count[node] == 2, total[node] - each, each).astype(int)
        smooth = np.einsum("fd,fd->f", normals, normals[other]) > np.cos(np.radians(CREASE))
        turned = sign * np.einsum("fd,fd->f", normals[other] - normals, along) / length
        curvature[:, k] = np.where((other != each) & smooth, 2 * turned / (length + length[other]), np.nan)
    first, last = (np.where(np.isnan(a), b, a) for a, b in (curvature.T, curvature.T[::-1]))
    both = np.where(first * last > 0, np.sign(first) * np.minimum(np.abs(first), np.abs(last)), 0.0)
    return np.asarray((both * length**2 / 8)[:, None] * normals)
