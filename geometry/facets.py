"""Facets as arrays of corners: normals, and quadratic ones that follow a curved face."""

from __future__ import annotations

import numpy as np

from stickslip.geometry.arrays import Array


def normals_of(c: Array) -> Array:
    """Normals (f, 3) of facets with corners (f, k, 3), as long as their area; of edges in the plane z = 0."""
    if c.shape[1] == 2:
        along = c[:, 1] - c[:, 0]
        return np.stack([along[:, 1], -along[:, 0], 0 * along[:, 2]], axis=1)
    if c.shape[1] == 3:
        return np.asarray(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]) / 2)
    return np.asarray(np.cross(c[:, 2] - c[:, 0], c[:, 3] - c[:, 1]) / 2)


def edge_middles(corners: Array) -> Array:
    """Middles (f, 3, 3) of the edges of triangles (f, 3, 3), opposite each corner; (f, 1, 3) of edges (f, 2, 3)."""
    if corners.shape[1] == 2:
        return np.asarray(corners.mean(axis=1, keepdims=True))
    return np.asarray((corners[:, [1, 2, 0]] + corners[:, [2, 0, 1]]) / 2)


def curved(corners: Array, bulge: Array, at: Array) -> tuple[Array, Array]:
    """Points (p, 3) and unit normals (p, 3) of quadratic facets, one each.

    Args:
        corners: (p, k, 3), of edges or triangles.
        bulge: (p, e, 3) from the middle of each edge, opposite corner i, to the facet; zero: it is straight.
        at: barycentric coordinates (p, k).
    """
    if corners.shape[1] == 2:
        points = np.einsum("pk,pkd->pd", at, corners) + 4 * (at[:, :1] * at[:, 1:]) * bulge[:, 0]
        along = corners[:, 1] - corners[:, 0] + 4 * (at[:, :1] - at[:, 1:]) * bulge[:, 0]
        normals = np.stack([along[:, 1], -along[:, 0], 0 * along[:, 2]], axis=1)
    else:
        following, last = np.roll(at, -1, axis=1), np.roll(at, -2, axis=1)
        points = np.einsum("pk,pkd->pd", at, corners) + 4 * np.einsum("pk,pkd->pd", following * last, bulge)
        by = [corners[:, i] + 4 * (at[:, [j]] * bulge[:, k] + at[:, [k]] * bulge[:, j])
              for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1))]  # fmt: skip
        normals = np.cross(by[1] - by[0], by[2] - by[0])
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)
