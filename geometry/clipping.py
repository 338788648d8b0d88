"""The parts of a slave surface in space that each master facet faces: polygons, cut into triangles.

Seen along a slave facet's averaged normal a, a master corner y has the coordinates B (y - x_0) on the facet, where
B = [t_1 t_2 a]^-1 and t_1, t_2 are the facet's edges: its first two are the place, the third is the distance. The
slave facet is then the reference triangle, and clipping is the same three cuts for every pair. Quadrilaterals and
curved facets are cut into straight pieces first; the parts keep their place on the facet itself.

Source: Puso & Laursen, Comput. Methods Appl. Mech. Engrg. 193 (2004); Popp et al., Int. J. Numer. Meth. Engng 83
(2010).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geometry import dolfinx_versions as dx
from geometry.near import near
from geometry.surface import Surface

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
SLIVER = 1e-15  # determinant, 1 for the reference triangle
GENERIC = (1.0, 0.6180339887)  # direction in reference coordinates that no edge of a regular mesh is normal to
CUTS = (((1.0, 0.0), 0.0), ((0.0, 1.0), 0.0), ((-1.0, -1.0), 1.0))  # its inside: n . ξ + c >= 0
PIECES = {  # by nodes of a quadratic quadrilateral: corners 0 to 3, then (1/2, 0), (0, 1/2), (1, 1/2), (1/2, 1), centre
    ("triangle", 1): [[0, 1, 2]],
    ("triangle", 2): [[0, 4, 5], [4, 1, 8], [5, 8, 2], [8, 5, 4]],
    ("quadrilateral", 1): [[0, 1, 3, 2]],
    ("quadrilateral", 2): [[0, 4, 8, 5], [4, 1, 6, 8], [5, 8, 7, 2], [8, 6, 3, 7]],
}


def triangles(slave: Surface, master: Surface, normals: Array, reach: float) -> tuple[Ints, Ints, Array, Array]:
    """Slave facets (c,), master facets (c,), triangles (c, 3, 2) in slave coordinates, directions (c, 3) of projection.

    Args:
        normals: of the slave's nodes (n, 3).
        reach: how far the two may be apart [m].
    """
    pieces, targets = _split(_pieces(slave)), _pieces(master)  # (s, 3, 2), (t, 3 or 4, 2)
    straight, corners = _corners(slave, pieces), _corners(master, targets)  # (f s, 3, 3), (g t, 3 or 4, 3)
    origin, edges = straight[:, :1], straight[:, 1:] - straight[:, :1]
    directions = _directions(slave, pieces, normals)
    inverse = np.linalg.inv(np.concatenate([edges, directions[:, None]], axis=1))  # of rows: y - x_0 = ξ [t_1 t_2 a]
    away = _area_normals(corners) * np.repeat(master.outward, len(targets))[:, None]
    found = []
    for i, j in near(*_balls(straight), directions, *_balls(corners), reach):
        facing = np.einsum("qd,qd->q", away[j], directions[i]) < 0
        i, j = i[facing], j[facing]
        seen = (corners[j] - origin[i]) @ inverse[i]
        pair, polygons = _clip(seen[:, :, :2])
        owner, parts = _fan(polygons)
        found.append((i[pair[owner]], j[pair[owner]], parts))
    i, j, parts = (np.concatenate(rows) for rows in zip(*found, strict=True))
    piece = pieces[i % len(pieces)]
    local = piece[:, :1] + parts @ (piece[:, 1:] - piece[:, :1])
    return i // len(pieces), j // len(targets), local, directions[i]


def _pieces(surface: Surface) -> Array:
    """Straight pieces of a facet by their corners in reference coordinates (s, 3 or 4, 2)."""
    rows = PIECES[surface.shape, surface.degree]
    return dx.reference_nodes("quadrilateral", 2)[np.array(rows)]


def _split(pieces: Array) -> Array:
    """Quadrilaterals by two triangles each."""
    return pieces if pieces.shape[1] == 3 else np.concatenate([pieces[:, [0, 1, 2]], pieces[:, [0, 2, 3]]])


def _corners(surface: Surface, pieces: Array) -> Array:
    """Corners (f s, 3 or 4, 3) [m] of all pieces, those of one facet after each other."""
    basis = dx.reference_basis(surface.shape, surface.degree, pieces.reshape(-1, 2))[0]
    points = np.einsum("qk,fkd->fqd", basis, surface.points[surface.facets])
    return points.reshape(-1, pieces.shape[1], 3)


def _directions(surface: Surface, pieces: Array, normals: Array) -> Array:
    """Averaged normals (f s, 3) at the centres of the pieces."""
    basis = dx.reference_basis(surface.shape, surface.degree, pieces.mean(axis=1))[0]
    found = np.einsum("sk,fkd->fsd", basis, normals[surface.facets]).reshape(-1, 3)
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def _area_normals(corners: Array) -> Array:
    arms = corners - corners[:, :1]
    return np.asarray(np.cross(arms, np.roll(arms, -1, axis=1)).sum(axis=1))


def _balls(corners: Array) -> tuple[Array, Array]:
    centres = corners.mean(axis=1)
    return centres, np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)


def _clip(polygons: Array) -> tuple[Ints, Array]:
    """Convex polygons (p, v, 2) cut down to the reference triangle: rows left (l,) and polygons (l, v + 3, 2).

    Sutherland and Hodgman's way; a polygon with fewer corners repeats its last.
    """
    rows = np.arange(len(polygons))
    for normal, constant in CUTS:
        depth = polygons @ np.array(normal) + constant
        met = (depth > 0).any(axis=1)
        rows, polygons, depth = rows[met], polygons[met], depth[met]
        after, depth_after = np.roll(polygons, -1, axis=1), np.roll(depth, -1, axis=1)
        crosses = depth * depth_after < 0
        part = depth / np.where(crosses, depth - depth_after, 1.0)
        points = np.stack([polygons, polygons + part[:, :, None] * (after - polygons)], axis=2)
        kept = np.stack([depth >= 0, crosses], axis=2).reshape(len(rows), -1)
        order = np.argsort(~kept, axis=1, kind="stable")
        last = np.minimum(np.arange(polygons.shape[1] + 1), kept.sum(axis=1, keepdims=True) - 1)
        take = np.take_along_axis(order, last, axis=1)
        polygons = np.take_along_axis(points.reshape(len(rows), -1, 2), take[:, :, None], axis=1)
    return rows, polygons


def _fan(polygons: Array) -> tuple[Ints, Array]:
    """Triangles (c, 3, 2) that make up convex polygons (p, v, 2), and the polygon (c,) that each is part of.

    They spread from the corner that lies farthest along a direction: the first in line is a matter of rounding where
    corners of one surface lie on edges of the other, and what quadrature makes of curved normals depends on it.
    """
    v = polygons.shape[1]
    first = np.argmax(polygons @ np.array(GENERIC), axis=1)
    polygons = np.take_along_axis(polygons, ((first[:, None] + np.arange(v)) % v)[:, :, None], axis=1)
    corners = np.stack([np.zeros(v - 2, np.int64), np.arange(1, v - 1), np.arange(2, v)], axis=1)
    parts = polygons[:, corners].reshape(-1, 3, 2)
    arms = parts[:, 1:] - parts[:, :1]
    kept = np.abs(np.linalg.det(arms)) > SLIVER
    return np.repeat(np.arange(len(polygons)), v - 2)[kept], parts[kept]
