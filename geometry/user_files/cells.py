"""Cells of other programs' meshes, made usable: serendipity cells are completed; wedges, pyramids, mixtures are split.

Serendipity cells (Quad 8, Hexahedron 20) get nodes in their faces and middles where their own shape functions have
them: the shape stays. Wedges, pyramids and cells of several kinds become triangles or tetrahedra of the same order:
cones from the corner of the smallest number over the facets without that corner, which are split in the same way.
Neighbours split their common face alike, and no node hangs. The node on a diagonal is that of the face or the cell.

Source: Dompierre, Labbé, Vallet & Camarero, 8th International Meshing Roundtable (1999).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.errors import GeometryError
from stickslip.geometry.protocols import Gmsh


@dataclass(frozen=True)
class Shape:
    """A kind of cells or facets; its facets and edges are given by corners, in gmsh's order."""

    plural: str
    corners: int
    facets: tuple[tuple[int, ...], ...]  # their normals point outward
    edges: tuple[tuple[int, int], ...]
    types: tuple[int, int]  # gmsh's types of order 1, and of order 2 with nodes in faces and middles

    @property
    def quads(self) -> tuple[tuple[int, ...], ...]:
        """Faces of four corners; a quadrilateral is one itself."""
        own = tuple(range(self.corners)) if len(self.facets[0]) == 2 else ()
        return tuple(face for face in (own, *self.facets) if len(face) == 4)

    @property
    def few(self) -> int:
        """Number of nodes of order 2 on corners and edges."""
        return self.corners + len(self.edges)

    @property
    def all(self) -> int:
        """Number of nodes of order 2."""
        return self.few + len(self.quads) + (self.corners == 8)


RING = ((0, 1), (1, 2), (2, 0))
SQUARE = ((0, 1), (1, 2), (2, 3), (3, 0))
SHAPES = {
    "Line": Shape("lines", 2, ((0,), (1,)), ((0, 1),), (1, 8)),
    "Triangle": Shape("triangles", 3, RING, RING, (2, 9)),
    "Quadrilateral": Shape("quadrilaterals", 4, SQUARE, SQUARE, (3, 10)),
    "Tetrahedron": Shape(
        "tetrahedra", 4, ((0, 2, 1), (0, 1, 3), (0, 3, 2), (3, 1, 2)), (*RING, (3, 0), (3, 2), (3, 1)), (4, 11)
    ),
    "Hexahedron": Shape(
        "hexahedra",
        8,
        ((0, 3, 2, 1), (0, 1, 5, 4), (0, 4, 7, 3), (1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7)),
        ((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7)),
        (5, 12),
    ),
    "Prism": Shape(
        "wedges",
        6,
        ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (0, 3, 5, 2), (1, 2, 5, 4)),
        ((0, 1), (0, 2), (0, 3), (1, 2), (1, 4), (2, 5), (3, 4), (3, 5), (4, 5)),
        (6, 13),
    ),
    "Pyramid": Shape(
        "pyramids",
        5,
        ((0, 1, 4), (3, 0, 4), (1, 2, 4), (2, 3, 4), (0, 3, 2, 1)),
        ((0, 1), (0, 3), (0, 4), (1, 2), (1, 4), (2, 3), (2, 4), (3, 4)),
        (7, 14),
    ),
}
SIMPLEX = ("", "Line", "Triangle", "Tetrahedron")  # by dimension
DIAGONALS = ((0, 6), (1, 7), (2, 4), (3, 5))  # of a hexahedron


@dataclass(frozen=True)
class Block:
    """Elements of one kind of one entity."""

    dim: int
    tag: int  # of the entity
    kind: str  # a key of SHAPES
    order: int
    nodes: Ints  # (c, k) rows of the points

    @property
    def shape(self) -> Shape:
        return SHAPES[self.kind]

    def rows(self, pattern: tuple[tuple[int, ...], ...]) -> Ints:
        """Return nodes (c, p, k) of a pattern (p, k) of corners, as of edges or faces."""
        return np.asarray(self.nodes[:, np.array(pattern)])


class Between:
    """The node half way between two corners: on an edge, or on the diagonal of a face or a cell."""

    def __init__(self) -> None:
        self.keys, self.nodes = np.zeros(0, np.int64), np.zeros(0, np.int64)

    def add(self, pairs: Ints, nodes: Ints) -> None:
        """Add nodes (...) of pairs of corners (..., 2); those that are known stay."""
        self.keys, first = np.unique(np.concatenate([self.keys, _keys(pairs).ravel()]), return_index=True)
        self.nodes = np.concatenate([self.nodes, nodes.ravel()])[first]

    def learn(self, shape: Shape, nodes: Ints) -> None:
        """Add those of elements of order 2 (c, k) on edges, and in faces, through which both diagonals run."""
        self.add(nodes[:, np.array(shape.edges)], nodes[:, shape.corners : shape.few])
        if shape.quads and nodes.shape[1] > shape.few:
            faces = nodes[:, np.array(shape.quads)]
            for ends in (faces[..., ::2], faces[..., 1::2]):
                self.add(ends, nodes[:, shape.few : shape.few + len(shape.quads)])

    def of(self, pairs: Ints) -> Ints:
        """Return the nodes (...) of pairs (..., 2); -1 where there is none."""
        keys = _keys(pairs)
        place = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        return np.where(self.keys[place] == keys, self.nodes[place], -1)


def _keys(pairs: Ints) -> Ints:
    """Return a number (...) for each pair (..., 2), whichever comes first; gmsh has fewer than 2^31 nodes."""
    return np.asarray((pairs.min(axis=-1) << 32) + pairs.max(axis=-1), np.int64)


def usable(gmsh: Gmsh, dim: int) -> str:
    """Give the mesh of the current gmsh model cells that can be used, if it has others: in a model of the mesh alone.

    Returns:
        What was done, in a line; "" if nothing was.

    Raises:
        GeometryError: a cell refers to a node that does not exist.
    """
    blocks, every = (
        [block for d in (dim - 1, dim) for block in blocks_of(gmsh, d)],
        gmsh.model.mesh.getElementTypes(dim),
    )
    cells = [block for block in blocks if block.dim == dim]
    orders = {block.order for block in cells}
    mixed = len({block.kind for block in cells}) > 1 or any(block.kind in ("Prism", "Pyramid") for block in cells)
    lacking = [block for block in cells if block.order == 2 and block.nodes.shape[1] < block.shape.all]
    unknown = len({(block.kind, block.nodes.shape[1]) for block in cells}) < len(every)
    if unknown or len(orders) != 1 or not (mixed or lacking):
        return ""
    tags, x, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(tags)
    tags, points = np.asarray(tags, np.int64)[order], np.reshape(x, (-1, 3))[order]
    if not all(np.isin(block.nodes, tags).all() for block in cells):
        raise GeometryError("a cell refers to a node that does not exist")
    found = [replace(b, nodes=np.searchsorted(tags, b.nodes)) for b in blocks if b.order in orders]
    between = Between()
    if orders == {2}:
        points, found = _complete(points, found, between)
    counts = Counter[str]()
    for block in cells if mixed else lacking:
        counts[block.shape.plural] += len(block.nodes)
    done = " and ".join(f"{count} {plural}" for plural, count in counts.items())
    if not mixed:
        said = f"{done} of 8 or 20 nodes got nodes in their faces and middles"
    else:
        found = [_split(block, between) for block in found]
        said = f"{done} became {sum(len(b.nodes) for b in found if b.dim == dim)} {SHAPES[SIMPLEX[dim]].plural}"
    _replace(gmsh, dim, points, found)
    return said


def blocks_of(gmsh: Gmsh, dim: int) -> list[Block]:
    """Return the elements of a dimension, with gmsh's tags of nodes, but for those of unknown kinds or orders."""
    found = []
    for _, tag in gmsh.model.getEntities(dim):
        for kind, _, nodes in zip(*gmsh.model.mesh.getElements(dim, tag), strict=True):
            name, _, order, count, *_ = gmsh.model.mesh.getElementProperties(kind)
            word, rows = name.split()[0], np.reshape(np.asarray(nodes, np.int64), (-1, count))
            if word not in SHAPES or order > 2:
                continue
            found.append(Block(dim, int(tag), word, int(order), rows))
    return found


def _complete(points: Array, blocks: list[Block], between: Between) -> tuple[Array, list[Block]]:
    """Add the nodes in faces and middles that cells of order 2 lack; `between` gets all between two corners."""
    for block in blocks:
        between.learn(block.shape, block.nodes)
    faces = [block.rows(block.shape.quads).reshape(-1, 4) for block in blocks if block.shape.quads]
    quads = np.concatenate([np.zeros((0, 4), np.int64), *faces])
    quads = quads[between.of(quads[:, ::2]) < 0]
    quads = quads[np.unique(np.sort(quads, axis=1), axis=0, return_index=True)[1]]
    edges = between.of(np.stack([quads, np.roll(quads, -1, axis=1)], axis=2))
    for ends in (slice(0, 3, 2), slice(1, 4, 2)):
        between.add(quads[:, ends], len(points) + np.arange(len(quads)))
    points = np.concatenate([points, points[edges].sum(axis=1) / 2 - points[quads].sum(axis=1) / 4])
    found = []
    for block in blocks:
        shape, nodes = block.shape, block.nodes
        if shape.quads:
            nodes = np.concatenate([nodes[:, : shape.few], between.of(block.rows(shape.quads)[..., ::2])], axis=1)
        if block.kind == "Hexahedron":
            middle = block.nodes[:, 26:]
            if not middle.size:
                middle = len(points) + np.arange(len(nodes))[:, None]
                more = points[nodes[:, 8:20]].sum(axis=1) / 4 - points[nodes[:, :8]].sum(axis=1) / 4
                points = np.concatenate([points, more])
            nodes = np.concatenate([nodes, middle], axis=1)
            between.add(block.rows(DIAGONALS), np.repeat(middle, len(DIAGONALS), axis=1))
        found.append(replace(block, nodes=nodes))
    return points, found


def _split(block: Block, between: Between) -> Block:
    """Split elements into simplices of the same order."""
    kind = SIMPLEX[block.dim]
    rows, _ = _cones(block.nodes[:, : block.shape.corners], block.kind)
    if block.order == 2:
        rows = np.concatenate([rows, between.of(rows[:, np.array(SHAPES[kind].edges)])], axis=1)
    return replace(block, kind=kind, nodes=rows)


def _cones(corners: Ints, kind: str) -> tuple[Ints, Ints]:
    """Split elements with corners (c, k) into cones, each from its smallest corner; also the element of each cone."""
    if kind in SIMPLEX:
        return corners, np.arange(len(corners))
    rows, owners, least = list[Ints](), list[Ints](), corners.argmin(axis=1)
    for tip in range(corners.shape[1]):
        own = np.flatnonzero(least == tip)
        for facet in SHAPES[kind].facets:
            if tip not in facet:
                base, of = _cones(corners[own][:, facet], ("Line", "Triangle", "Quadrilateral")[len(facet) - 2])
                rows.append(np.column_stack([corners[own[of], tip], base]))
                owners.append(own[of])
    return np.concatenate(rows), np.concatenate(owners)


def _replace(gmsh: Gmsh, dim: int, points: Array, blocks: list[Block]) -> None:
    """Put a mesh in place of the current gmsh model, with its entities' numbers and names and its physical groups."""
    entities = [entity for d in (dim - 1, dim) for entity in gmsh.model.getEntities(d)]
    names = {entity: gmsh.model.getEntityName(*entity) for entity in entities}
    groups = [
        (d, tag, gmsh.model.getPhysicalName(d, tag), gmsh.model.getEntitiesForPhysicalGroup(d, tag))
        for d, tag in gmsh.model.getPhysicalGroups()
        if d >= dim - 1
    ]
    gmsh.model.remove()
    gmsh.model.add("cells")
    for entity in entities:
        gmsh.model.addDiscreteEntity(*entity)
        gmsh.model.setEntityName(*entity, names[entity])
    used = np.unique(np.concatenate([block.nodes.ravel() for block in blocks]))
    gmsh.model.mesh.addNodes(dim, blocks[-1].tag, used + 1, points[used].ravel())
    for block in blocks:
        kind = block.shape.types[block.order - 1]
        gmsh.model.mesh.addElementsByType(block.tag, kind, [], (block.nodes + 1).ravel())
    for d, tag, name, tags in groups:
        gmsh.model.addPhysicalGroup(d, tags, tag)
        gmsh.model.setPhysicalName(d, tag, name)
