"""Overlay of the meshes of two surfaces: parts of slave facets that each face one master facet.

In 2D they are segments between the projections of a master facet's ends; a master node is projected on the slave point
whose interpolated normal points at it. In 3D the slave facet is clipped by the master facet and cut into triangles: a
master corner y is projected along the averaged normal a of the slave facet and has the coordinates
(y - x_0) [t_1 t_2 a]^-1, with the slave facet's corner x_0 and edges t_1 and t_2. The first two are its position on the
facet, the third is its distance. In these coordinates every slave facet is the reference triangle, so that the same
three cuts clip all pairs. Curved facets are cut into straight pieces before, quadrilaterals into two triangles; the
parts are given in the reference coordinates of the whole facet.

Source: Puso & Laursen, Comput. Methods Appl. Mech. Engrg. 193 (2004); Popp et al., Int. J. Numer. Meth. Engng 83
(2010).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import LAST_DIGITS, Array, Bools, Ints
from stickslip.geometry.curved_facets import SHARP
from stickslip.geometry.surfaces.facet_map import locate, place
from stickslip.geometry.surfaces.surface import Surface

BALLS_AT_A_TIME = 2000  # bounds the memory
SAMPLES = 64  # balls that cover the path of one ball to its reach, at most


def candidate_pairs(
    centres: Array, radii: Array, directions: Array, targets: Array, target_radii: Array, reach: float
) -> Iterator[tuple[Ints, Ints]]:
    """Pairs (ball, target) that may meet when the ball moves along its direction, by at most `reach` either way.

    The path of a ball is covered with larger balls, so that some of the pairs do not meet. Targets are sorted into
    trees by size, since one large target in a tree widens the search around all the small ones.

    Args:
        centres, radii: of the balls (m, d), (m,) [m].
        directions: unit vectors (m, d).
        targets, target_radii: balls to meet (t, d), (t,) [m].
        reach: [m].

    Yields:
        Numbers of balls and of targets (c,), block by block of balls.
    """
    level = np.floor(np.log2(target_radii / target_radii.min()))
    classes = [np.flatnonzero(level == value) for value in np.unique(level)]
    trees = [(cKDTree(targets[rows]), rows, target_radii[rows].max()) for rows in classes]
    for start in range(0, len(centres), BALLS_AT_A_TIME):
        rows = np.arange(start, min(start + BALLS_AT_A_TIME, len(centres)))
        keys = [
            _pairs_in_tree(tree, centres[rows], radii[rows] + size, directions[rows], reach) for tree, _, size in trees
        ]
        ball = np.concatenate([rows[i] for i, _ in keys])
        target = np.concatenate([members[j] for (_, j), (_, members, _) in zip(keys, trees, strict=True)])
        yield ball, target


def _pairs_in_tree(tree: cKDTree, centres: Array, thick: Array, directions: Array, reach: float) -> tuple[Ints, Ints]:
    """Pairs (ball, target) of one tree; `thick` (m,) are the sums of the radii [m]."""
    count = min(int(np.ceil(reach / np.median(thick))), SAMPLES)
    ball = np.hypot(thick, reach / (2 * max(count, 1)))
    keys = []
    for offset in np.linspace(-reach, reach, 2 * count + 1):
        found = tree.query_ball_point(centres + offset * directions, ball, return_sorted=False)
        rows = np.repeat(np.arange(len(centres)), [len(entry) for entry in found])
        keys.append(rows * tree.n + np.concatenate(found).astype(np.int64))
    key = np.unique(np.concatenate(keys))
    return key // tree.n, key % tree.n


CURVED = 1.2  # a curved facet lies within this multiple of the ball around its nodes
BISECTIONS = 60


def steepest(slave: Surface, master: Surface) -> tuple[Array, Array]:
    """Largest angles (f,) and (g,) [radians] whose sum two facets may make that face each other.

    Where sides have edges, faces that lean more than facets of one face touch by their edges alone. The facets of a
    curved face stand for all directions between the normals at their nodes.
    """
    if slave.faces is None and master.faces is None:
        return np.full(len(slave.facets), np.pi / 4), np.full(len(master.facets), np.pi / 4)
    return np.radians(SHARP) / 2 + _bends(slave), np.radians(SHARP) / 2 + _bends(master)


def _bends(side: Surface) -> Array:
    """Largest angles (f,) [radians] between the normals of facets and those at their nodes."""
    own, nodes = side.facet_normals().mean(axis=1), side.node_normals()[side.facets]
    away = np.linalg.norm(nodes - (own / np.linalg.norm(own, axis=1, keepdims=True))[:, None], axis=2)
    return np.asarray(2 * np.arcsin(np.minimum(away / 2, 1.0)).max(axis=1))


def upright(slope: Array, other: Array) -> Array:
    """Cosines of the sums of such angles, of facets that face each other."""
    return np.asarray(np.cos(np.minimum(slope + other, np.pi / 2)))


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
    centres, radii = _balls_around_edges(slave)
    blocks = list(candidate_pairs(centres, radii + reach * spread, middle, *_balls_around_edges(master), reach))
    i, j = (np.concatenate(rows) for rows in zip(*blocks, strict=True))
    away = place(master, j, np.full((len(j), 1), 0.5)).area_normals
    least = upright(*(slope[k] for slope, k in zip(steepest(slave, master), (i, j), strict=True)))
    facing = np.einsum("qd,qd->q", away, middle[i]) < -least * np.linalg.norm(away, axis=1)
    i, j = i[facing], j[facing]
    feet = [_project_on_slave(slave, field, i, master.points[master.facets[j, end]]) for end in (0, 1)]
    ends = np.sort(np.stack(feet, axis=1), axis=1)
    kept = ends[:, 1] - ends[:, 0] > LAST_DIGITS  # in reference coordinates
    return i[kept], j[kept], ends[kept][:, :, None]


def _balls_around_edges(surface: Surface) -> tuple[Array, Array]:
    """Centres (f, d) and radii (f,) of the bounding balls of the facets [m]."""
    nodes = surface.points[surface.facets]
    centres = nodes.mean(axis=1)
    return centres, CURVED * np.linalg.norm(nodes - centres[:, None], axis=2).max(axis=1)


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
    for _ in range(BISECTIONS):
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


GENERIC = (1.0, 0.6180339887)  # direction in reference coordinates to which no edge of a regular mesh is normal
# n and c of the half-planes n . ξ + c >= 0 whose intersection is the reference triangle
CUTS = (((1.0, 0.0), 0.0), ((0.0, 1.0), 0.0), ((-1.0, -1.0), 1.0))
PIECES = {  # by nodes of a quadratic quadrilateral: corners 0 to 3, then (1/2, 0), (0, 1/2), (1, 1/2), (1/2, 1), centre
    ("triangle", 1): [[0, 1, 2]],
    ("triangle", 2): [[0, 4, 5], [4, 1, 8], [5, 8, 2], [8, 5, 4]],
    ("quadrilateral", 1): [[0, 1, 3, 2]],
    ("quadrilateral", 2): [[0, 4, 8, 5], [4, 1, 6, 8], [5, 8, 7, 2], [8, 6, 3, 7]],
}
HALVES = np.array([[0, 1, 2], [0, 2, 3]])  # of a quadrilateral; the first is all of a triangle
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def triangles(slave: Surface, master: Surface, normals: Array, reach: float) -> tuple[Ints, Ints, Array, Array]:
    """Find the triangles of the slave surface that face master facets; 3D only.

    Args:
        normals: unit normals at the slave's nodes (n, 3).
        reach: largest distance of the two surfaces [m].

    Returns:
        Slave facets (c,), master facets (c,), corners of the triangles (c, 3, 2) in slave reference coordinates, and
        unit directions of projection (c, 3).
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
    long, (slope, other) = np.linalg.norm(away, axis=1), steepest(slave, master)
    slope, other = np.repeat(slope, len(directions) // len(slope) * len(halves)), np.repeat(other, len(targets))
    found = []
    for i, j in candidate_pairs(*_balls(ends), along, *_balls(goals), reach):
        facing = np.einsum("qd,qd->q", away[j], along[i]) < -upright(slope[i], other[j]) * long[j]
        i, j = i[facing], j[facing]
        row, polygons = _clip(((goals[j] - origin[i]) @ inverse[i])[:, :, :2])
        i, j = i[row], j[row]
        if len(halves) == 2:
            polygons = _on_quadrilateral(slave, corners, i, polygons, along[i])
        row, parts = fan(polygons)
        found.append((i[row] // len(halves), j[row], parts))
    i, j, parts = (np.concatenate(rows) for rows in zip(*found, strict=True))
    piece = pieces[i % len(pieces)]
    local = piece[:, :1] + parts @ (piece[:, [1, -1]] - piece[:, :1])
    return i // len(pieces), j // len(targets), local, directions[i]


def _on_quadrilateral(slave: Surface, corners: Array, halves: Ints, polygons: Array, along: Array) -> Array:
    """Map corners of polygons (p, v, 2) from one half of a quadrilateral, a triangle, to its bilinear coordinates."""
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
    """Corners (f s, 3 or 4, 3) [m] of the s pieces of each facet, facet by facet."""
    basis = dx.reference_basis(surface.shape, surface.degree, pieces.reshape(-1, 2))[0]
    points = np.einsum("qk,fkd->fqd", basis, surface.points[surface.facets])
    return np.asarray(points.reshape(-1, pieces.shape[1], 3))


def _directions(surface: Surface, pieces: Array, normals: Array) -> Array:
    """Unit interpolated normals (f s, 3) at the centres of the pieces."""
    basis = dx.reference_basis(surface.shape, surface.degree, pieces.mean(axis=1))[0]
    found = np.einsum("sk,fkd->fsd", basis, normals[surface.facets]).reshape(-1, 3)
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def _area_normals(corners: Array) -> Array:
    """Normals (p, 3) of polygons (p, v, 3), twice as long as their area."""
    arms = corners - corners[:, :1]
    return np.asarray(np.cross(arms, np.roll(arms, -1, axis=1)).sum(axis=1))


def _balls(corners: Array) -> tuple[Array, Array]:
    """Centres (p, 3) and radii (p,) of balls around polygons (p, v, 3) [m]."""
    centres = corners.mean(axis=1)
    return centres, np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)


def _clip(polygons: Array) -> tuple[Ints, Array]:
    """Intersect convex polygons (p, v, 2) with the reference triangle by Sutherland and Hodgman's algorithm.

    Returns:
        Rows of the polygons that intersect it (l,), and the intersections (l, v + 3, 2); one with fewer corners repeats
        its last corner.
    """
    rows = np.arange(len(polygons))
    for normal, constant in CUTS:
        met, polygons = half_of(polygons, polygons @ np.array(normal) + constant)
        rows = rows[met]
    return rows, polygons


def half_of(polygons: Array, depth: Array) -> tuple[Bools, Array]:
    """Cut convex polygons (p, v, 2) where a linear function, given at their corners (p, v), is zero.

    Returns:
        Which of them have a part where it is positive (p,), and these parts (l, v + 1, 2), see `_clip`.
    """
    met, corners = (depth > 0).any(axis=1), polygons.shape[1]
    polygons, depth = polygons[met], depth[met]
    after, depth_after = np.roll(polygons, -1, axis=1), np.roll(depth, -1, axis=1)
    crosses = depth * depth_after < 0
    part = depth / np.where(crosses, depth - depth_after, 1.0)
    points = np.stack([polygons, polygons + part[:, :, None] * (after - polygons)], axis=2)
    kept = np.stack([depth >= 0, crosses], axis=2).reshape(len(polygons), 2 * corners)
    order = np.argsort(~kept, axis=1, kind="stable")
    last = np.minimum(np.arange(corners + 1), kept.sum(axis=1, keepdims=True) - 1)
    take = np.take_along_axis(order, last, axis=1)
    return met, np.take_along_axis(points.reshape(len(polygons), 2 * corners, 2), take[:, :, None], axis=1)


def fan(polygons: Array) -> tuple[Ints, Array]:
    """Cut convex polygons (p, v, 2) into triangles that share one corner.

    That corner is the farthest one along the direction GENERIC, not the first: which corner comes first depends on
    rounding where corners of one surface lie on edges of the other, and quadrature on curved facets depends on the cut.

    Returns:
        The polygon (c,) of each triangle, and the triangles (c, 3, 2).
    """
    v = polygons.shape[1]
    first = np.argmax(polygons @ np.array(GENERIC), axis=1)
    polygons = np.take_along_axis(polygons, ((first[:, None] + np.arange(v)) % v)[:, :, None], axis=1)
    corners = np.stack([np.zeros(v - 2, np.int64), np.arange(1, v - 1), np.arange(2, v)], axis=1)
    parts = polygons[:, corners].reshape(-1, 3, 2)
    arms = parts[:, 1:] - parts[:, :1]
    # triangles with a smaller determinant are dropped; 1 for the reference triangle
    kept = np.abs(np.linalg.det(arms)) > LAST_DIGITS
    return np.repeat(np.arange(len(polygons)), v - 2)[kept], parts[kept]
