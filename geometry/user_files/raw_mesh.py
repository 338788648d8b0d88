"""A mesh as plain arrays, read from gmsh and checked, or put into gmsh."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from stickslip.geometry.arrays import ROUNDING, Array, Ints
from stickslip.geometry.curved_facets import Bulging, find_bulging, find_edges
from stickslip.geometry.errors import GeometryError, GluedError
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import skins
from stickslip.geometry.user_files.cells import SHAPES, usable
from stickslip.geometry.user_files.parts import CELL_WORD, Parts

TYPES = {2: 1, 3: 1, 4: 2, 5: 3, 9: 8, 10: 8, 11: 9, 12: 10}  # gmsh's types of usable cells -> of their facets
FIRST_ORDER = {kind: shape.types[0] for shape in SHAPES.values() for kind in shape.types}
CORNERS = {kind: shape.corners for shape in SHAPES.values() for kind in shape.types}
LOCAL_FACETS = {shape.types[0]: shape.facets for shape in SHAPES.values()}  # corners of each facet of a cell


@dataclass(frozen=True)
class RawMesh:
    """Cells of one kind with their nodes, in the file's unit."""

    dim: int
    kind: int  # gmsh's element type
    points: Array  # (n, 3)
    cells: dict[str, Ints]  # body -> nodes (c, k) of its cells, rows of `points`
    facets: dict[str, Ints]  # body.side -> nodes (f, k) of its facets
    edges: dict[str, Ints] = field(default_factory=dict)  # body.side -> nodes, see `find_edges`
    bulging: Bulging | None = None  # nodes are rows of `points`; lengths in the file's unit; None: not known
    note: str = ""  # what was done to the file's cells, in a line

    def put(self, gmsh: Gmsh) -> None:
        """Put the mesh into the current gmsh model as discrete entities with physical groups."""
        tags = np.arange(1, len(self.points) + 1)
        for dim, kind, blocks in ((self.dim, self.kind, self.cells), (self.dim - 1, TYPES[self.kind], self.facets)):
            for number, (name, rows) in enumerate(blocks.items(), start=1):
                gmsh.model.addDiscreteEntity(dim, number)
                if dim == self.dim and number == 1:
                    gmsh.model.mesh.addNodes(dim, number, tags, self.points.ravel())
                gmsh.model.mesh.addElementsByType(number, kind, [], (rows + 1).ravel())
                gmsh.model.addPhysicalGroup(dim, [number], number)
                gmsh.model.setPhysicalName(dim, number, name)


def read_raw_mesh(gmsh: Gmsh, dim: int, parts: Parts, with_skins: bool = False) -> RawMesh:
    """Read cells and facets of the current gmsh model, which gets usable ones if it has others.

    Args:
        with_skins: whether edges of whole skins are looked for.

    Raises:
        GeometryError: cells of several orders, in no body, without volume or turned inside out; a node with a
            coordinate that is no number; a side without facets.
    """
    note = usable(gmsh, dim)
    kind = _only_kind(gmsh, dim)
    cells = {body: _rows(gmsh, dim, entities, kind) for body, entities in parts.bodies.items()}
    for body, rows in cells.items():
        if len(rows) == 0:
            raise GeometryError(f"body {body} has no cells")
    stray = sum(map(len, gmsh.model.mesh.getElements(dim)[1])) - sum(map(len, cells.values()))
    if stray:
        raise GeometryError(f"{stray} cells are in no body: every cell belongs to one physical {CELL_WORD[dim]}")
    facets = {side: _rows(gmsh, dim - 1, entities, TYPES[kind]) for side, entities in parts.sides.items()}
    numbers, x, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(numbers)
    numbers, x = np.asarray(numbers, np.int64)[order], np.reshape(x, (-1, 3))[order]
    used = np.unique(np.concatenate([rows.ravel() for rows in cells.values()]))
    if not np.isin(used, numbers).all():
        raise GeometryError("a cell refers to a node that does not exist")
    points = x[np.searchsorted(numbers, used)]
    if not np.isfinite(points).all():
        raise GeometryError("a node has a coordinate that is not a finite number")
    _check_volumes(gmsh, dim, kind, parts)
    check_neighbours(kind, cells)
    _check_facets(kind, cells, facets)
    sides = parts.sides | (skins(gmsh, dim, parts.bodies) if with_skins else {})
    edges = {side: rows[np.isin(rows, used - 1).all(axis=1)] for side, rows in find_edges(gmsh, dim, sides).items()}
    return RawMesh(
        dim, kind, points,
        {body: np.searchsorted(used, rows) for body, rows in cells.items()},
        {side: np.searchsorted(used, rows) for side, rows in facets.items()},
        {side: np.searchsorted(used - 1, rows) for side, rows in edges.items()},
        find_bulging(gmsh, dim, 1.0).among(used - 1), note,
    )  # fmt: skip


def _only_kind(gmsh: Gmsh, dim: int) -> int:
    """gmsh's type of the cells; raises GeometryError if there are none, several orders or an unknown kind."""
    kinds = [int(kind) for kind in gmsh.model.mesh.getElementTypes(dim)]
    names = [gmsh.model.mesh.getElementProperties(kind)[0] for kind in kinds]
    if not kinds:
        raise GeometryError("has no cells")
    if len(kinds) > 1:
        raise GeometryError(f"mixes cells that cannot be used together, {' and '.join(names)}")
    if kinds[0] not in TYPES:
        raise GeometryError(f"is made of cells that cannot be used, {names[0]}")
    return kinds[0]


def _rows(gmsh: Gmsh, dim: int, entities: list[int], kind: int) -> Ints:
    """gmsh's node tags (elements, k) of the elements of the entities."""
    found = [gmsh.model.mesh.getElementsByType(kind, tag)[1] for tag in entities]
    count = gmsh.model.mesh.getElementProperties(kind)[3]
    return np.asarray(np.concatenate(found) if found else [], np.int64).reshape(-1, count)


def _check_volumes(gmsh: Gmsh, dim: int, kind: int, parts: Parts) -> None:
    """Check the Jacobian determinants at the nodes: not zero, in 3D positive, in 2D of one sign in an entity."""
    local = gmsh.model.mesh.getElementProperties(kind)[4]
    at = np.zeros((len(local) // dim, 3))
    at[:, :dim] = np.reshape(local, (-1, dim))
    for body, entities in parts.bodies.items():
        flat, inverted = list[bool](), list[bool]()
        for tag in entities:
            found = gmsh.model.mesh.getJacobians(kind, at.ravel(), tag)[0]
            jacobians = np.reshape(found, (-1, len(at), 3, 3))[:, :, :dim, :dim]
            volume = np.linalg.det(jacobians)
            size = np.prod(np.linalg.norm(jacobians, axis=3), axis=2)
            # a cell has no volume if it is less than this, relative to the product of its edges
            flat.extend(np.any(np.abs(volume) <= ROUNDING * size, axis=1))
            inverted.extend(np.any(np.sign(volume) != (1.0 if dim == 3 else np.sign(volume.sum())), axis=1))
        for wrong, words in ((flat, "have no volume"), (inverted, "are turned inside out")):
            if any(wrong):
                raise GeometryError(f"body {body}: {sum(wrong)} of {len(wrong)} cells {words}")


def check_neighbours(kind: int, cells: dict[str, Ints]) -> None:
    """Check that no cell is there twice, and that no facet bounds three: dolfinx crashes on such meshes."""
    pattern = np.array(LOCAL_FACETS[FIRST_ORDER[kind]])
    corners = np.concatenate(list(cells.values()))[:, : pattern.max() + 1]
    twice = len(corners) - different(corners)[0].size
    if twice:
        raise GeometryError(f"names {twice} of its cells twice")
    shared, times = different(corners[:, pattern].reshape(-1, pattern.shape[1]))
    if np.any(times > 2):
        nodes = sorted(corners[:, pattern].reshape(-1, pattern.shape[1])[shared[times > 2][0]].tolist())
        raise GeometryError(f"the facet of the nodes {nodes} bounds {int(times.max())} cells, and can bound two")


def different(rows: Ints) -> tuple[Ints, Ints]:
    """One of each set of nodes, rows of `rows` (n, k), and how often the set is there."""
    ordered = np.ascontiguousarray(np.sort(rows, axis=1), np.int64)
    as_one = ordered.view(np.dtype((np.void, ordered.dtype.itemsize * ordered.shape[1]))).ravel()
    _, first, times = np.unique(as_one, return_index=True, return_counts=True)
    return first, times


def _check_facets(kind: int, cells: dict[str, Ints], facets: dict[str, Ints]) -> None:
    """Check that every facet of a side bounds one cell of the side's body, and no other cell."""
    for side, rows in facets.items():
        body = side.split(".")[0]
        if len(rows) == 0:
            raise GeometryError(f"side {side} has no facets")
        wanted = np.unique(np.sort(rows[:, : CORNERS[TYPES[kind]]], axis=1), axis=0)
        if len(wanted) < len(rows):
            raise GeometryError(f"side {side}: names {len(rows) - len(wanted)} of its facets twice")
        touching = {
            name: np.bincount(facets_among(rows, kind, wanted)[0], minlength=len(wanted))
            for name, rows in cells.items()
        }
        if np.any(touching[body] == 0):
            raise GeometryError(
                f"side {side}: {int(np.sum(touching[body] == 0))} of its facets bound no cell of {body}"
            )
        if np.any(np.sum(list(touching.values()), axis=0) > 1):
            raise GluedError(f"side {side}: lies inside, its facets have cells on both sides")


def facets_among(cells: Ints, kind: int, wanted: Ints) -> tuple[Ints, Ints]:
    """Find wanted facets among those of cells.

    Args:
        wanted: (w, corners) sorted corners of each facet, rows unique and in order.

    Returns:
        Rows of `wanted` and rows of `cells`, one of each for every facet that is found.
    """
    pattern = np.array(LOCAL_FACETS[FIRST_ORDER[kind]])
    near = np.isin(cells[:, pattern], np.unique(wanted)).all(axis=2)
    cell, local = np.nonzero(near)
    candidates = np.sort(cells[cell[:, None], pattern[local]], axis=1)
    _, place = np.unique(np.concatenate([wanted, candidates]), axis=0, return_inverse=True)
    place = place.ravel()
    facet_at = np.full(place.max() + 1, -1)
    facet_at[place[: len(wanted)]] = np.arange(len(wanted))
    facet = facet_at[place[len(wanted) :]]
    return facet[facet >= 0], cell[facet >= 0]
