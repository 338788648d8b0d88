"""Meshes made of another mesh: cells cut into smaller ones in the plane, and cells of order 1 in place of order 2.

Of a plane mesh of order 2 with cells cut, every displacement of the old mesh is one of the new mesh.

Edges are halved. A triangle with two halved edges is cut into four, the third edge is halved too; with one it is cut
into two. In a quadrilateral opposite edges are halved together, so that rows of cells are cut from end to end. Old
nodes keep their numbers. New nodes of a curved side lie on the circle through the three nodes of its facet: there alone
the new mesh is not exactly nested.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import ROUNDING, Array, Bools, Ints
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import SKIN, Request, Shape, Turn
from stickslip.geometry.user_files.raw_mesh import RawMesh

EDGES = {  # corners of each edge and the node between them, in dolfinx's order of a cell of order 2
    "triangle": ((1, 2, 3), (0, 2, 4), (0, 1, 5)),
    "quadrilateral": ((0, 1, 4), (0, 2, 5), (1, 3, 6), (2, 3, 7)),
}
OPPOSITE = {"triangle": (), "quadrilateral": ([0, 3], [1, 2])}  # edges that are halved together
GMSH = {  # type, and its order of the nodes of cells and of facets
    "triangle": (9, (0, 1, 2, 5, 3, 4), (0, 1, 2)),
    "quadrilateral": (10, (0, 1, 3, 2, 4, 6, 7, 5, 8), (0, 1, 2)),
    "tetrahedron": (4, (0, 1, 2, 3), (0, 1, 2)),
    "hexahedron": (5, (0, 1, 3, 2, 4, 5, 7, 6), (0, 1, 3, 2)),
}
DIGITS = 12  # of basis functions: there they are multiples of 1 / 64
Halved = tuple[bool, ...]  # of each edge of a cell


@dataclass(frozen=True, kw_only=True)
class ArrayMesh(Shape):
    """Cells of order 2; as a shape it is put into gmsh as it is, with those of its nodes that `GMSH` names."""

    kind: str  # triangle, quadrilateral, tetrahedron or hexahedron
    points: Array  # (n, d) [m]
    cells: Ints  # (c, k) nodes, in dolfinx's order
    body: Ints  # (c,) index in `names`
    names: tuple[str, ...]  # of the bodies
    sides: Mapping[str, Ints]  # body.side -> nodes of its facets (f, k), the corners first
    edges_of: Mapping[str, Ints] = field(default_factory=dict)  # body.side -> nodes, see `find_edges`

    def refuse_too_large(self, request: Request, free: float = np.inf) -> None:
        """The cells are there already."""

    def box(self, dim: int) -> Array:
        return np.array([self.points.min(axis=0), self.points.max(axis=0)])

    def put(self, gmsh: Gmsh, request: Request) -> float:
        kind, order, around = GMSH[self.kind]
        cells = self.cells[:, order]
        used = np.unique(cells)
        bodies = {name: np.searchsorted(used, cells[self.body == k]) for k, name in enumerate(self.names)}
        sides = {name: np.searchsorted(used, facets[:, around]) for name, facets in self.sides.items()}
        points = np.pad(self.points[used], ((0, 0), (0, 3 - request.dim)))
        RawMesh(request.dim, kind, points, bodies, sides).put(gmsh)
        return 1.0

    def edges(self, gmsh: Gmsh, sides: Mapping[str, Sequence[int]], dim: int) -> Mapping[str, Ints]:
        used = np.unique(self.cells[:, GMSH[self.kind][1]])
        return {name: np.searchsorted(used, rows) for name, rows in self.edges_of.items() if name in sides}


@dataclass(frozen=True, kw_only=True)
class FlatMesh(ArrayMesh):
    """Cells in the plane; facets are given by their ends, and the node between them."""

    periodic: tuple[tuple[str, str], ...] = ()  # pairs of sides that are cut alike
    turns: Mapping[str, Turn] = field(default_factory=dict)  # of cyclic ones, by the first side

    @property
    def degree(self) -> int:
        return 2

    def lines(self) -> tuple[Ints, Ints]:
        """All edges (e, 3), the ends in increasing order and the node between, and those of each cell (c, k)."""
        local = np.array(EDGES[self.kind])
        found = self.cells[:, local].reshape(-1, 3)
        middles, first, number = np.unique(found[:, 2], return_index=True, return_inverse=True)
        ends = np.sort(found[first, :2], axis=1)
        return np.column_stack([ends, middles]), number.reshape(-1, len(local))

    def boundary(self) -> Ints:
        """Edges (e, 3) of one cell alone."""
        edges, of_cells = self.lines()
        return np.asarray(edges[np.bincount(of_cells.ravel(), minlength=len(edges)) == 1])

    def facets(self, side: str) -> Ints:
        """Facets (f, 3) of a side, or of a body's skin without periodic sides."""
        body, name = side.split(".")
        if name != SKIN:
            return self.sides[side]
        edges, of_cells = self.lines()
        alone = np.bincount(of_cells.ravel(), minlength=len(edges)) == 1
        for each in (side for pair in self.periodic for side in pair):
            alone &= ~np.isin(edges[:, 2], self.sides[each][:, 2])
        return np.asarray(edges[np.intersect1d(np.flatnonzero(alone), of_cells[self.body == self.names.index(body)])])

    def cut(self, cells: Bools) -> FlatMesh:
        """The mesh with all edges of some cells (c,) halved, and those that have to be halved with them."""
        edges, of_cells = self.lines()
        twins, halved = self._twins(edges), np.isin(np.arange(len(edges)), of_cells[cells])
        while True:
            before = halved.copy()
            halved[twins[halved]] = True
            mine = halved[of_cells]
            if self.kind == "triangle":
                halved[of_cells[mine.sum(axis=1) >= 2]] = True
            for pair in OPPOSITE[self.kind]:
                halved[of_cells[mine[:, pair].any(axis=1)][:, pair]] = True
            if np.array_equal(before, halved):
                return _cut(self, edges, of_cells, halved)

    def _twins(self, edges: Ints) -> Ints:
        """The edge (e,) on the other one of two periodic sides that lies where each edge does; else itself."""
        found, number = np.arange(len(edges)), {m: k for k, m in enumerate(edges[:, 2].tolist())}
        for pair in self.periodic:
            middles = [self.sides[side][:, 2] for side in pair]
            one, other = (self.points[m] for m in middles)
            if turn := self.turns.get(pair[0]):
                match = cKDTree(turn.moved(other)).query(one)[1]
            else:
                match = cKDTree(other - other.mean(axis=0)).query(one - one.mean(axis=0))[1]
            here, there = ([number[m] for m in some.tolist()] for some in (middles[0], middles[1][match]))
            found[here], found[there] = there, here
        return found

    def touching(self, nodes: Ints) -> Bools:
        """Cells (c,) that have a corner among the nodes."""
        corners = len(EDGES[self.kind])  # as many as edges
        return np.asarray(np.isin(self.cells[:, :corners], nodes).any(axis=1))


def _cut(mesh: FlatMesh, edges: Ints, of_cells: Ints, halved: Bools) -> FlatMesh:
    """The cells with halved edges (e,) cut."""
    mine = halved[of_cells]
    whole = ~mine.any(axis=1)
    cells, body, added = [mesh.cells[whole]], [mesh.body[whole]], list[Array]()
    count, between = len(mesh.points), dict[tuple[int, int], int]()
    for pattern in np.unique(mine[~whole], axis=0):
        parts = _parts(mesh.kind, tuple(map(bool, pattern)))
        for cell in np.flatnonzero((mine == pattern).all(axis=1)):
            nodes, places = mesh.cells[cell], parts.basis @ mesh.points[mesh.cells[cell]]
            for child, known, ends in zip(places, parts.known, parts.ends, strict=True):
                found = np.where(known >= 0, nodes[known], -1)
                for k in np.flatnonzero(known < 0):
                    pair = sorted(found[list(ends[k])].tolist()) if ends[k] else [-1, count]
                    key = (pair[0], pair[1])
                    if key not in between:
                        between[key] = count
                        added.append(child[k])
                        count += 1
                    found[k] = between[key]
                cells.append(found[None])
                body.append(mesh.body[cell : cell + 1])
    points = np.concatenate([mesh.points, np.reshape(added, (-1, 2))])
    alone = np.bincount(of_cells.ravel(), minlength=len(edges)) == 1
    for a, b, m in edges[halved & alone].tolist():
        for end in (a, b):
            new = between[min(end, m), max(end, m)]
            points[new] = _on_circle(points[[a, m, b]], points[new])
    cut = {(a, b) for a, b, _ in edges[halved].tolist()}
    return replace(
        mesh,
        points=points,
        cells=np.concatenate(cells),
        body=np.concatenate(body),
        sides={name: _cut_facets(facets, cut, between) for name, facets in mesh.sides.items()},
    )


def _cut_facets(facets: Ints, cut: set[tuple[int, int]], between: Mapping[tuple[int, int], int]) -> Ints:
    """Facets (f, 3) of a side, those on halved edges cut in two."""
    found = list[Sequence[int]]()
    for a, b, m in facets.tolist():
        if (min(a, b), max(a, b)) in cut:
            found += [(a, m, between[min(a, m), max(a, m)]), (m, b, between[min(m, b), max(m, b)])]
        else:
            found.append((a, b, m))
    return np.array(found, np.int64).reshape(-1, 3)


def _on_circle(three: Array, point: Array) -> Array:
    """The point (2,) moved onto the circle through three others (3, 2), if they lie on no line."""
    a, b = three[1] - three[0], three[2] - three[0]
    twice = a[0] * b[1] - a[1] * b[0]
    if abs(twice) <= ROUNDING * (b @ b):  # sagitta over length of a straight facet
        return point
    middle = three[0] + np.array([b[1] * (a @ a) - a[1] * (b @ b), a[0] * (b @ b) - b[0] * (a @ a)]) / (2 * twice)
    away = point - middle
    return np.asarray(middle + away * (np.linalg.norm(three[0] - middle) / np.linalg.norm(away)))


@dataclass(frozen=True)
class _Parts:
    """The p parts that a cell is cut into, each with k nodes."""

    basis: Array  # (p, k, k) the old cell's basis at the nodes of each part
    known: Ints  # (p, k) the old cell's node that a node is; -1: a new one
    ends: tuple[tuple[tuple[int, int] | None, ...], ...]  # of each node of a part its two corners; None: not on an edge


@cache
def _parts(kind: str, halved: Halved) -> _Parts:
    """Parts of a cell whose given edges are halved."""
    old = dx.reference_nodes(kind, 2)
    corners = np.array(_corners(kind, halved))
    at = np.einsum("nc,pcd->pnd", dx.reference_basis(kind, 1, old)[0], old[corners])
    near = np.linalg.norm(at[:, :, None] - old, axis=3) < ROUNDING  # distance of reference nodes; rounding
    known = np.where(near.any(axis=2), near.argmax(axis=2), -1)
    basis = dx.reference_basis(kind, 2, at.reshape(-1, 2))[0].round(DIGITS).reshape(*at.shape[:2], -1)
    on = {m: (a, b) for a, b, m in EDGES[kind]}
    return _Parts(basis, known, tuple(tuple(on.get(k) for k in range(len(old))) for _ in corners))


def _corners(kind: str, halved: Halved) -> list[tuple[int, ...]]:
    """Corners of each part, as nodes of the old cell."""
    if kind == "triangle":
        if all(halved):
            return [(0, 5, 4), (5, 1, 3), (4, 3, 2), (3, 4, 5)]
        (opposite,) = np.flatnonzero(halved)  # edge i lies opposite corner i
        j, k, m = EDGES[kind][opposite]
        return [(int(opposite), j, m), (int(opposite), m, k)]
    lattice = ((0, 5, 2), (4, 8, 7), (1, 6, 3))  # by column and row
    columns, rows = ((0, 1, 2) if halved[k] else (0, 2) for k in (0, 1))
    return [
        (lattice[a][c], lattice[b][c], lattice[a][d], lattice[b][d])
        for a, b in pairwise(columns)
        for c, d in pairwise(rows)
    ]
