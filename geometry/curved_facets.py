"""Facets that stand for a curved surface: their normals, quadratic ones, how far the surface bulges out of them, and
where it has an edge.

Between two nodes at a distance L, with the unit tangents t_a and t_b of a curve, its middle lies L/8 (t_a - t_b) beside
that of the chord, and 2/3 of it is the mean along the chord. With the unit normals n_a and n_b of a surface an edge
e bulges by (n_b - n_a) . e / 8 along their mean; a facet with curved edges bulges by a third of their sum in the mean.

Tangents and normals are those of the CAD kernel; where it has none, those of the facets around a node.

Source: of curves Hermite's cubic; of surfaces Vlachos, Peters, Boyd & Mitchell, Proc. I3D (2001).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from stickslip.geometry.arrays import ROUNDING, Array, Bools, Ints
from stickslip.geometry.protocols import Gmsh


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


FLAT = ("Line", "Plane")  # entities as gmsh calls them
CORNERS = {1: 2, 2: 3, 3: 4}  # of gmsh's lines, triangles and quadrilaterals of order 1
AROUND = {2: ((0, 1), (1, 2), (2, 0)), 3: ((0, 1), (1, 2), (2, 3), (3, 0))}  # edges of facets in 3D
SMOOTH = 5.0  # [degrees] surfaces that meet at less go on smoothly, and those that lean by less lie flat on each other
BENDS = 3.0  # in between facets meet at an edge at an angle so many times as large as those beside it on both sides
SHARP = 50.0  # [degrees] facets of one face meet at less: two for a quarter of a circle still do


@dataclass(frozen=True)
class Bulging:
    """Facets on curved surfaces; in 3D also edges on curved lines. Nodes are those of the gmsh model, from 0."""

    facets: Ints  # (f, k) their corners, sorted; in 3D -1 before those of triangles, k = 4
    out: Array  # (f, d) [m] mean of where the surface lies, minus that of the facet
    edges: Ints  # (e, 2) their ends, sorted
    beside: Array  # (e, d) [m] mean of where the line lies, minus that of the edge

    @staticmethod
    def none(dim: int) -> Bulging:
        """Nothing is curved."""
        corners = 2 if dim == 2 else 4
        return Bulging(
            np.zeros((0, corners), np.int64), np.zeros((0, dim)), np.zeros((0, 2), np.int64), np.zeros((0, dim))
        )

    def among(self, nodes: Ints) -> Bulging:
        """Keep entities whose nodes are all among (n,), in increasing order, and number them by their places there."""
        facets, out = _renumbered(self.facets, self.out, nodes)
        return Bulging(facets, out, *_renumbered(self.edges, self.beside, nodes))

    def times(self, unit: float) -> Bulging:
        """Lengths in another unit."""
        return replace(self, out=unit * self.out, beside=unit * self.beside)

    def __bool__(self) -> bool:
        return len(self.facets) > 0


def find_bulging(gmsh: Gmsh, dim: int, unit: float) -> Bulging:
    """Bulging facets and edges of the mesh of the current gmsh model, of order 1; none of a higher order.

    Args:
        unit: length of the gmsh model's unit [m].
    """
    none, entities = Bulging.none(dim), [entity for d in range(1, dim) for entity in gmsh.model.getEntities(d)]
    curved = [(d, tag) for d, tag in entities if _may_bulge(gmsh, d, tag)]
    if not curved:
        return none
    points = _points(gmsh)
    curves = [_of_curve(gmsh, tag, points) for d, tag in curved if d == 1]
    surfaces = [_of_surface(gmsh, tag, points) for d, tag in curved if d == 2]
    edges, beside = (np.concatenate(x) for x in zip((none.edges, np.zeros((0, 3))), *curves, strict=True))
    if dim == 2:
        return Bulging(edges, unit * beside[:, :2], none.edges, none.beside)
    facets, out = (np.concatenate(x) for x in zip((none.facets, np.zeros((0, 3))), *surfaces, strict=True))
    return Bulging(facets, unit * out, edges, unit * beside)


def find_edges(gmsh: Gmsh, dim: int, sides: Mapping[str, Sequence[int]]) -> dict[str, Ints]:
    """Edges of sides as ends (2D) or edges (3D) of facets: their nodes (e, d-1) from 0, sorted.

    They are where curves (2D) or faces of the CAD model meet at an angle; of a mesh without a model the named points
    (2D) or curves. A side that is left out has neither: nothing but its facets tells where it has edges.

    Args:
        sides: gmsh's entities of each side.
    """
    found, marked = dict[str, Ints](), list[tuple[int, int]]()
    for _, group in gmsh.model.getPhysicalGroups(dim - 2):
        if gmsh.model.getPhysicalName(dim - 2, group):
            marked += [(dim - 2, int(tag)) for tag in gmsh.model.getEntitiesForPhysicalGroup(dim - 2, group)]
    named = [_ridges(gmsh, *entity) for entity in marked]
    for side, tags in sides.items():
        drawn = len(tags) > 0 and not any(gmsh.model.getType(dim - 1, tag).startswith("Discrete") for tag in tags)
        if not drawn and not named:
            continue
        rows = _between_entities(gmsh, dim, tags) if drawn else named
        found[side] = np.unique(np.concatenate([np.zeros((0, dim - 1), np.int64), *rows]), axis=0)
    return found


def sharp(at: Array, pairs: Ints, normals: Array, ridges: Array, centres: Array, facets: Ints) -> Bools:
    """Which pairs of facets meet at an edge: at an angle that is large, or large against those beside it.

    Args:
        at: angles (p,) [degrees] between the facets where they meet.
        pairs: (2, p) the facets that meet.
        normals: (f, d) unit normals of the facets.
        ridges, centres: middles (p, d) of what the facets of a pair share, and (f, d) of the facets [m].
        facets: (f, k) nodes; -1 for none.
    """
    found = at > SHARP
    middle = np.flatnonzero((at > SMOOTH) & ~found)
    if not len(middle):
        return found
    from scipy import sparse  # late: a file of a user is read without it

    facet, place = np.nonzero(facets >= 0)
    has = sparse.csr_matrix((np.ones(len(facet)), (facet, facets[facet, place])))
    bends = np.zeros(len(middle))
    for facet in pairs[:, middle]:
        row, beside = (has[facet] @ has.T).nonzero()
        away = centres[facet] - ridges[middle]
        turn = angles(normals[facet[row]], normals[beside])
        beyond = np.einsum("bd,bd->b", centres[beside] - centres[facet[row]], away[row]) > 0
        bend = np.full(len(middle), -np.inf)
        np.maximum.at(bend, row[beyond & (turn <= SHARP)], turn[beyond & (turn <= SHARP)])
        bends = np.maximum(bends, np.where(np.isfinite(bend), bend, np.inf))  # without a neighbour it may be a curve
    found[middle] = at[middle] > BENDS * bends
    return found


def angles(one: Array, other: Array) -> Array:
    """Angles (m,) [degrees] between unit vectors (m, d)."""
    return np.asarray(np.degrees(2 * np.arcsin(np.minimum(np.linalg.norm(one - other, axis=1) / 2, 1.0))))


def _between_entities(gmsh: Gmsh, dim: int, tags: Sequence[int]) -> Iterator[Ints]:
    """Edges between the entities of a side."""
    beside = defaultdict[int, list[int]](list)
    for tag in tags if len(tags) > 1 else ():
        for _, end in gmsh.model.getBoundary([(dim - 1, tag)], oriented=False):
            beside[int(end)].append(tag)
    points = _points(gmsh) if any(len(both) > 1 for both in beside.values()) else np.zeros((0, 3))
    for end, both in beside.items():
        rows = _ridges(gmsh, dim - 2, end) if len(both) > 1 else np.zeros((0, dim - 1), np.int64)
        for pair in combinations(both, 2):
            nodes, at = np.unique(rows, return_inverse=True)
            one, other = (_directions(gmsh, dim - 1, tag, nodes, points) for tag in pair)
            cosine = np.abs(np.einsum("ni,ni->n", one, other))[at.reshape(rows.shape)].min(axis=1)
            yield rows[cosine < np.cos(np.radians(SMOOTH))]


def _ridges(gmsh: Gmsh, dim: int, tag: int) -> Ints:
    """Nodes (m, dim + 1) of the mesh on a point or a curve, those between corners left out, from 0 and sorted."""
    kinds, _, flat = gmsh.model.mesh.getElements(dim, tag)
    counts = [int(gmsh.model.mesh.getElementProperties(kind)[3]) for kind in kinds]
    rows = [np.reshape(nodes, (-1, n))[:, : dim + 1] for nodes, n in zip(flat, counts, strict=True)]
    if not rows and dim == 0:
        rows = [np.reshape(gmsh.model.mesh.getNodes(0, tag)[0], (-1, 1))]
    return np.sort(np.concatenate([np.zeros((0, dim + 1)), *rows]).astype(np.int64) - 1, axis=1)


def _directions(gmsh: Gmsh, dim: int, tag: int, nodes: Ints, points: Array) -> Array:
    """Unit tangents of a curve or normals of a surface (n, 3) at nodes of it, by the CAD kernel or by the facets."""
    kinds, _, flat = gmsh.model.mesh.getElements(dim, tag)
    total = np.zeros((len(points), 3))
    for kind, numbers in zip(kinds, flat, strict=True):
        _, _, _, count, _, corners = gmsh.model.mesh.getElementProperties(kind)
        at = np.reshape(numbers, (-1, count))[:, :corners].astype(np.int64) - 1
        along = points[at[:, 1]] - points[at[:, 0]] if dim == 1 else normals_of(points[at])
        np.add.at(total, at, along[:, None])
    return _of_kernel(gmsh, dim, tag, nodes, unit(total[nodes]))


def _renumbered(rows: Ints, values: Array, nodes: Ints) -> tuple[Ints, Array]:
    """Rows (m, k) of node numbers as places among `nodes`, and their values, without those that have others."""
    place = np.searchsorted(nodes, rows).clip(0, len(nodes) - 1)
    kept = ((nodes[place] == rows) | (rows < 0)).all(axis=1)
    return np.where(rows < 0, -1, place)[kept], values[kept]


def _may_bulge(gmsh: Gmsh, dim: int, tag: int) -> bool:
    kinds = gmsh.model.mesh.getElements(dim, tag)[0]
    return len(kinds) > 0 and set(kinds) <= set(CORNERS) and gmsh.model.getType(dim, tag) not in FLAT


def _of_curve(gmsh: Gmsh, tag: int, points: Array) -> tuple[Ints, Array]:
    """Edges (e, 2) on a curve, and how far it is beside them in the mean (e, 3), in the gmsh model's unit."""
    ends = np.asarray(gmsh.model.mesh.getElements(1, tag)[2][0], np.int64).reshape(-1, 2) - 1
    nodes, at = np.unique(ends, return_inverse=True)
    at, x = at.reshape(ends.shape), points[nodes]
    along = x[at[:, 1]] - x[at[:, 0]]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    mean = unit(_sums(at, np.repeat((along / length)[:, None], 2, axis=1), len(nodes)))
    tangents = _of_kernel(gmsh, 1, tag, nodes, mean)[at]
    tangents *= np.sign(np.einsum("eki,ei->ek", tangents, along))[:, :, None]
    return _kept(np.sort(ends, axis=1), length / 12 * (tangents[:, 0] - tangents[:, 1]), length)


def _of_surface(gmsh: Gmsh, tag: int, points: Array) -> tuple[Ints, Array]:
    """Facets (f, 4) on a surface, and how far it is out of them in the mean (f, 3), in the gmsh model's unit."""
    kinds, _, flat = gmsh.model.mesh.getElements(2, tag)
    of_kind = [np.asarray(n, np.int64).reshape(-1, CORNERS[int(k)]) - 1 for k, n in zip(kinds, flat, strict=True)]
    nodes = np.unique(np.concatenate([corners.ravel() for corners in of_kind]))
    x = points[nodes]
    places = [np.searchsorted(nodes, corners) for corners in of_kind]
    around = np.zeros_like(x)
    for at in places:
        around += _sums(at, np.repeat(normals_of(x[at])[:, None], at.shape[1], axis=1), len(nodes))
    normals = _of_kernel(gmsh, 2, tag, nodes, unit(around))
    found = []
    for kind, corners, at in zip(kinds, of_kind, places, strict=True):
        out = np.zeros((len(at), 3))
        for i, j in AROUND[int(kind)]:
            a, b = at[:, i], at[:, j]
            turned = np.einsum("fi,fi->f", normals[b] - normals[a], x[b] - x[a])
            out += turned[:, None] / 16 * (normals[a] + normals[b]) / 3
        rows = np.pad(np.sort(corners, axis=1), ((0, 0), (4 - corners.shape[1], 0)), constant_values=-1)
        size = np.linalg.norm(x[at[:, 1]] - x[at[:, 0]], axis=1, keepdims=True)
        found.append(_kept(rows, out, size))
    rows, out = (np.concatenate(each) for each in zip(*found, strict=True))
    return rows, out


def _points(gmsh: Gmsh) -> Array:
    """Coordinates of all nodes (n, 3), in the gmsh model's unit."""
    tags, flat, _ = gmsh.model.mesh.getNodes()
    numbers = np.asarray(tags, np.int64) - 1
    found = np.full((int(numbers.max()) + 1, 3), np.nan)
    found[numbers] = np.reshape(flat, (-1, 3))
    return found


def _of_kernel(gmsh: Gmsh, dim: int, tag: int, nodes: Ints, mean: Array) -> Array:
    """Unit tangents or normals (n, 3) of the CAD kernel at nodes, as the means (n, 3) point; or these."""
    if gmsh.model.getType(dim, tag).startswith("Discrete"):
        return mean
    tags, _, where = gmsh.model.mesh.getNodes(dim, tag, includeBoundary=True, returnParametricCoord=True)
    numbers = np.asarray(tags, np.int64) - 1
    if len(where) != dim * len(numbers) or not np.isin(nodes, numbers).all():
        return mean  # middles of extruded boxes, or a mesh that was put there by itself
    order = np.argsort(numbers, kind="stable")
    parameters = np.reshape(where, (len(numbers), dim))[order[np.searchsorted(numbers, nodes, sorter=order)]]
    flat = list(parameters.ravel())
    directions = gmsh.model.getNormal(tag, flat) if dim == 2 else gmsh.model.getDerivative(1, tag, flat)
    found = unit(np.reshape(directions, (-1, 3)))
    cosine = np.einsum("ni,ni->n", found, mean)
    sound = np.isfinite(cosine) & (np.abs(cosine) > 0.5)  # else the kernel's direction has no meaning
    return np.asarray(np.where(sound[:, None], np.sign(cosine)[:, None] * found, mean))


def unit(vectors: Array) -> Array:
    """The same vectors (n, 3) with length 1; NaN without one."""
    with np.errstate(all="ignore"):
        return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def _sums(at: Ints, values: Array, count: int) -> Array:
    """Sums (count, 3) of values (m, k, 3) at the places `at` (m, k)."""
    flat = values.reshape(-1, 3)
    return np.stack([np.bincount(at.ravel(), column, count) for column in flat.T], axis=1)


def _kept(rows: Ints, out: Array, size: Array) -> tuple[Ints, Array]:
    """Those that bulge; size: (m, 1) a length of each."""
    large = np.linalg.norm(out, axis=1) > ROUNDING * size[:, 0]  # of the length: less is rounding
    return rows[large], out[large]
