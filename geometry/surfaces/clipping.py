"""The parts of a slave surface in space that each master facet faces: polygons, cut into triangles.

Seen along a slave facet's averaged normal a, a master corner y has the coordinates (y - x_0) [t_1 t_2 a]^-1 on the
facet, with the facet's edges t_1 and t_2: the first two are its place, the third is its distance. The slave facet is
then the reference triangle, and clipping is the same three cuts for every pair. Curved facets are cut into straight
pieces first, quadrilaterals into two triangles; the parts keep their place on the facet itself.

Source: Puso & Laursen, Comput. Methods Appl. Mech. Engrg. 193 (2004); Popp et al., Int. J. Numer. Meth. Engng 83
(2010).
"""

from __future__ import annotations

import numpy as np

from geometry import dolfinx_versions as dx
from geometry.arrays import Array, Ints
from geometry.surfaces.bounding_balls import near
from geometry.surfaces.facet_map import locate
from geometry.surfaces.surface import Surface

SLIVER = 1e-15  # determinant, 1 for the reference triangle
GENERIC = (1.0, 0.6180339887)  # direction in reference coordinates that no edge of a regular mesh is normal to
CUTS = (((1.0, 0.0), 0.0), ((0.0, 1.0), 0.0), ((-1.0, -1.0), 1.0))  # its inside: n . ξ + c >= 0
PIECES = {  # by nodes of a quadratic quadrilateral: corners 0 to 3, then (1/2, 0), (0, 1/2), (1, 1/2), (1/2, 1), centre
    ("triangle", 1): [[0, 1, 2]],
    ("triangle", 2): [[0, 4, 5], [4, 1, 8], [5, 8, 2], [8, 5, 4]],
    ("quadrilateral", 1): [[0, 1, 3, 2]],
    ("quadrilateral", 2): [[0, 4, 8, 5], [4, 1, 6, 8], [5, 8, 7, 2], [8, 6, 3, 7]],
}
HALVES = np.array([[0, 1, 2], [0, 2, 3]])  # of a quadrilateral; the first is all of a triangle
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def triangles(slave: Surface, master: Surface, normals: Array, reach: float) -> tuple[Ints, Ints, Array, Array]:
    """Slave facets (c,), master facets (c,), triangles (c, 3, 2) in slave coordinates, directions (c, 3) of projection.

    Args:
        normals: of the slave's nodes (n, 3).
        reach: how far the two may be apart [m].
    """
    pieces, targets = _pieces(slave), _pieces(master)  # (s, 3 or 4, 2), (t, 3 or 4, 2)
    corners, goals = _corners(slave, pieces), _corners(master, targets)  # (f s, 3 or 4, 3), (g t, 3 or 4, 3)
    directions = _directions(slave, pieces, normals)
    halves = HALVES[: pieces.shape[1] - 2]
    ends = corners[:, halves].reshape(-1, 3, 3)
    origin, edges = ends[:, :1], ends[:, 1:] - ends[:, :1]
    along = np.repeat(directions, len(halves), axis=0)
    inverse = np.linalg.inv(np.concatenate([edges, along[:, None]], axis=1))
    away = _area_normals(goals) * np.repeat(master.outward, len(targets))[:, None]
    found = []
    for i, j in near(*_balls(ends), along, *_balls(goals), reach):
        facing = np.einsum("qd,qd->q", away[j], along[i]) < 0
        i, j = i[facing], j[facing]
        row, polygons = _clip(((goals[j] - origin[i]) @ inverse[i])[:, :, :2])
        i, j = i[row], j[row]
        if len(halves) == 2:
            polygons = _on_quadrilateral(slave, corners, i, polygons, along[i])
        row, parts = _fan(polygons)
        found.append((i[row] // len(halves), j[row], parts))
    i, j, parts = (np.concatenate(rows) for rows in zip(*found, strict=True))
    piece = pieces[i % len(pieces)]
    local = piece[:, :1] + parts @ (piece[:, [1, -1]] - piece[:, :1])
    return i // len(pieces), j // len(targets), local, directions[i]


def _on_quadrilateral(slave: Surface, corners: Array, halves: Ints, polygons: Array, along: Array) -> Array:
    """Corners of polygons (p, v, 2) on half a quadrilateral: from coordinates on that triangle to the bilinear ones."""
    count = polygons.shape[1]
    numbers = np.arange(4 * len(corners))
    straight = Surface(
        shape="quadrilateral",
        degree=1,
        nodes=numbers,
        input=numbers,
        points=corners.reshape(-1, 3),
        facets=numbers.reshape(-1, 4)[:, [0, 1, 3, 2]],
        outward=np.ones(len(corners)),
        axisymmetric=False,
    )

    def spread(ends: Array) -> Array:
        return (ends[:, :1] + polygons @ (ends[:, 1:] - ends[:, :1])).reshape(-1, ends.shape[2])

    piece, half = halves // 2, HALVES[halves % 2]
    points = spread(corners[piece[:, None], half])
    local = locate(straight, np.repeat(piece, count), spread(SQUARE[half]), points, np.repeat(along, count, axis=0))
    return local.reshape(polygons.shape)


def _pieces(surface: Surface) -> Array:
    """Straight pieces of a facet by their corners in reference coordinates (s, 3 or 4, 2)."""
    rows = PIECES[surface.shape, surface.degree]
    return np.asarray(dx.reference_nodes("quadrilateral", 2)[np.array(rows)])


def _corners(surface: Surface, pieces: Array) -> Array:
    """Corners (f s, 3 or 4, 3) [m] of all pieces, those of one facet after each other."""
    basis = dx.reference_basis(surface.shape, surface.degree, pieces.reshape(-1, 2))[0]
    points = np.einsum("qk,fkd->fqd", basis, surface.points[surface.facets])
    return np.asarray(points.reshape(-1, pieces.shape[1], 3))


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
        met, corners = (depth > 0).any(axis=1), polygons.shape[1]
        rows, polygons, depth = rows[met], polygons[met], depth[met]
        after, depth_after = np.roll(polygons, -1, axis=1), np.roll(depth, -1, axis=1)
        crosses = depth * depth_after < 0
        part = depth / np.where(crosses, depth - depth_after, 1.0)
        points = np.stack([polygons, polygons + part[:, :, None] * (after - polygons)], axis=2)
        kept = np.stack([depth >= 0, crosses], axis=2).reshape(len(rows), 2 * corners)
        order = np.argsort(~kept, axis=1, kind="stable")
        last = np.minimum(np.arange(corners + 1), kept.sum(axis=1, keepdims=True) - 1)
        take = np.take_along_axis(order, last, axis=1)
        polygons = np.take_along_axis(points.reshape(len(rows), 2 * corners, 2), take[:, :, None], axis=1)
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
