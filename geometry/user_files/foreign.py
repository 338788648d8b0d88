"""Meshes of CalculiX and Abaqus (.inp), Salome (.med, .unv), ParaView (.vtu, .vtk) and Nastran (.bdf), put into gmsh.

Sets of cells are bodies: those of *SOLID SECTION where there are such; else the smallest ones if they fill the mesh, or
the largest ones; `part` is what is left. Pieces that share no node are bodies of their own. Surfaces, sets of facets
and sets of nodes are sides of the bodies that they bound; one that overlaps another that came first (in this order, the
smallest first) is left out. The skin that no set names is parted into smooth faces. Without sets, bodies and sides are
the values of the first array of whole numbers on the cells, such as Nastran's properties.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from stickslip.geometry.arrays import Array, Ints, connected
from stickslip.geometry.curved_facets import angles, normals_of, sharp
from stickslip.geometry.errors import GeometryError
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.user_files.cells import SHAPES, Between, blocks_of
from stickslip.geometry.user_files.foreign_formats import Content, in_order_of_gmsh, read_foreign
from stickslip.geometry.user_files.parts import SIDE, label, numbered
from stickslip.geometry.user_files.raw_mesh import different

DEFAULT = "part"  # a body that no set names
WORDS = {"line": "Line", "triangle": "Triangle", "quad": "Quadrilateral", "tetra": "Tetrahedron"}
WORDS |= {"hexahedron": "Hexahedron", "wedge": "Prism", "pyramid": "Pyramid"}  # meshio's -> keys of SHAPES
FACETS = {  # that Abaqus calls S1, S2 ..., as corners
    "Tetrahedron": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "Hexahedron": ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
    "Prism": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
}


def put_foreign(gmsh: Gmsh, path: Path) -> None:
    """Put the mesh of a file into the current gmsh model, with physical groups of its bodies and sides.

    Raises:
        GeometryError: it has no cells, or an element without its nodes.
    """
    content = read_foreign(path)
    cells = Cells(content)
    bodies = _bodies(cells, content)
    sides = _sides(cells, content, bodies)
    cells.put(gmsh, bodies, sides)


class Skin:
    """The facets that one cell of a mesh has alone."""

    def __init__(self, points: Array, dim: int, blocks: list[tuple[str, Ints]]) -> None:
        """
        Args:
            points: (n, 3).
            dim: of the cells.
            blocks: a key of SHAPES, and nodes (c, k) in gmsh's order, rows of the points.
        """
        self.points, self.dim, self.blocks = points, dim, blocks
        facets, owner, count = list[Ints](), list[Ints](), 0
        for word, rows in blocks:
            for facet in SHAPES[word].facets:
                facets.append(_padded(rows[:, facet]))
                owner.append(count + np.arange(len(rows)))
            count += len(rows)
        every = np.concatenate(facets)
        first, times = different(every)
        self.count, self.skin = count, every[first[times == 1]]  # (f, 4) corners, -1 after the last one
        self.owner = np.concatenate(owner)[first[times == 1]]  # (f,) cell

    def smooth(self, rows: Ints) -> list[Ints]:
        """Part facets of the skin into those that join smoothly."""
        corners = self.skin[rows]
        normals = normals_of(self.points[corners[:, : self.dim]])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        if self.dim == 2:
            ends, of = corners[:, :2].reshape(-1, 1), np.repeat(np.arange(len(rows)), 2)
        else:
            third = np.where(corners[:, 3] < 0, corners[:, 0], corners[:, 3])
            ring = np.column_stack([corners[:, :3], third, corners[:, 0]])
            ends = np.sort(np.stack([ring[:, :-1], ring[:, 1:]], axis=2).reshape(-1, 2), axis=1)
            of = np.repeat(np.arange(len(rows)), 4)
        order = np.lexsort(ends.T)
        same = np.all(ends[order][1:] == ends[order][:-1], axis=1)
        one, other = of[order][:-1][same], of[order][1:][same]
        ridges, known = self.points[ends[order[:-1][same]]].mean(axis=1), (corners >= 0)[:, :, None]
        centres = np.nanmean(np.where(known, self.points[corners], np.nan), axis=1)
        near = ~sharp(angles(normals[one], normals[other]), np.stack([one, other]), normals, ridges, centres, corners)
        part = connected(len(rows), one[near], other[near])
        return [rows[part == k] for k in range(part.max() + 1)]

    @cached_property
    def _between(self) -> Between:
        """The nodes of order 2 on edges and faces."""
        found = Between()
        for word, rows in self.blocks:
            if rows.shape[1] > SHAPES[word].corners:
                found.learn(SHAPES[word], rows)
        return found

    def elements(self, facets: Ints) -> Iterator[tuple[str, Ints]]:
        """Yield the kinds of facets of the skin and their nodes (f, k), in gmsh's order."""
        sizes = (self.skin[facets] >= 0).sum(axis=1)
        for word in ("Line", "Triangle", "Quadrilateral"):
            shape = SHAPES[word]
            rows = self.skin[facets[sizes == shape.corners], : shape.corners]
            if len(rows) and len(self._between.keys):
                rows = np.concatenate([rows, self._between.of(rows[:, np.array(shape.edges)])], axis=1)
                if shape.quads and np.all((middle := self._between.of(rows[:, None, [0, 2]])) >= 0):
                    rows = np.concatenate([rows, middle], axis=1)
            if len(rows):
                yield word, rows

    def type_of(self, gmsh: Gmsh, word: str, rows: Ints) -> int:
        """Return gmsh's type of elements with nodes (c, k)."""
        shape = SHAPES[word]
        family, second = word.replace("Quadrilateral", "Quadrangle"), rows.shape[1] > shape.corners
        return int(gmsh.model.mesh.getElementType(family, 1 + second, second and rows.shape[1] < shape.all))


class Cells(Skin):
    """The cells of largest dimension of a file, and their skin."""

    def __init__(self, content: Content) -> None:
        ids = np.array(list(content.points), np.int64)
        points = np.array([(*x, 0.0)[:3] for x in content.points.values()], float).reshape(-1, 3)
        self.row = dict(zip(ids.tolist(), range(len(ids)), strict=True))
        by_kind = defaultdict[str, list[int]](list)
        for number, (kind, _) in content.elements.items():
            if _stem(kind) in WORDS:
                by_kind[kind].append(number)
        dim, blocks = max((_dimension(kind) for kind in by_kind), default=0), list[tuple[str, Ints]]()
        if dim < 2:
            raise GeometryError("has no cells")
        self.number = dict[int, int]()  # of the file -> from 0
        for kind, numbers in by_kind.items():
            if _dimension(kind) < dim:
                continue
            try:
                rows = np.array([self.rows(content.elements[number]) for number in numbers])
            except KeyError:
                raise GeometryError("a cell refers to a node that does not exist") from None
            self.number |= {number: len(self.number) + k for k, number in enumerate(numbers)}
            word = WORDS[_stem(kind)]
            blocks.append((word, _turned(word, in_order_of_gmsh(kind, rows), points)))
        if len({rows.shape[1] > SHAPES[word].corners for word, rows in blocks}) > 1:
            raise GeometryError("mixes cells of orders 1 and 2")
        super().__init__(points, dim, blocks)
        self.rim = set(np.unique(self.skin).tolist())  # corners of all its facets
        self.place = {_key(corners): k for k, corners in enumerate(self.skin.tolist())}

    def rows(self, element: tuple[str, Sequence[int]]) -> list[int]:
        """Return the rows of `points` of an element's nodes."""
        return [self.row[node] for node in element[1]]

    def at(self, nodes: Iterable[int]) -> list[int]:
        """Return the facet of the skin whose corners are among these rows of `points`, if there is one."""
        found = self.place.get(_key(node for node in nodes if node in self.rim))
        return [] if found is None else [found]

    def corners(self, number: int, kind: str, nodes: Sequence[int], facet: str) -> list[int]:
        """Return the corners of a facet of an element that Abaqus calls S1, S2 ...; none if it has no such facet."""
        word = WORDS.get(_stem(kind), "")
        known = FACETS.get(word) or (SHAPES[word].facets if word else ())
        k = int(facet[1:]) - 1 if re.fullmatch(r"S[1-9]", facet) else len(known)
        return [self.row[nodes[c]] for c in known[k]] if k < len(known) else []

    def pieces(self, body: Ints) -> Ints:
        """Return the number (c,) of the piece of its body that each cell belongs to: cells that share nodes."""
        at = [np.repeat(np.arange(len(rows)), rows.shape[1]) for _, rows in self.blocks]
        first = np.cumsum([0, *(len(rows) for _, rows in self.blocks)])
        cell = np.concatenate([start + own for start, own in zip(first, at, strict=False)])
        node = np.concatenate([rows.ravel() for _, rows in self.blocks]) + len(self.points) * (1 + body[cell])
        _, place = np.unique(node, return_inverse=True)
        return connected(self.count + place.max() + 1, cell, self.count + place)[: self.count]

    def put(self, gmsh: Gmsh, bodies: Mapping[str, Ints], sides: Mapping[str, Ints]) -> None:
        """Put bodies, each with its cells, and sides, each with facets of the skin, into the current gmsh model."""
        mesh, dim = gmsh.model.mesh, self.dim
        first = np.cumsum([0, *(len(rows) for _, rows in self.blocks)])
        for tag, (name, cells) in enumerate(bodies.items(), start=1):
            gmsh.model.addDiscreteEntity(dim, tag)
            if tag == 1:
                mesh.addNodes(dim, tag, np.arange(1, len(self.points) + 1), self.points.ravel())
            for (word, rows), start in zip(self.blocks, first, strict=False):
                own = rows[cells[(cells >= start) & (cells < start + len(rows))] - start]
                if len(own):
                    mesh.addElementsByType(tag, self.type_of(gmsh, word, own), [], (own + 1).ravel())
            gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [tag]), name)
        for tag, (name, facets) in enumerate(sides.items(), start=1):
            gmsh.model.addDiscreteEntity(dim - 1, tag)
            for word, own in self.elements(facets):
                mesh.addElementsByType(tag, self.type_of(gmsh, word, own), [], (own + 1).ravel())
            if "." in name:
                gmsh.model.setPhysicalName(dim - 1, gmsh.model.addPhysicalGroup(dim - 1, [tag]), name)


def close_skin(gmsh: Gmsh, dim: int) -> None:
    """Put what no entity of a mesh has of its skin into entities of their own, one for each smooth face."""
    cells, known = blocks_of(gmsh, dim), blocks_of(gmsh, dim - 1)
    tags, x, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(tags)
    tags, points = np.asarray(tags, np.int64)[order], np.reshape(x, (-1, 3))[order]
    if len({block.order for block in cells}) != 1 or not all(np.isin(block.nodes, tags).all() for block in cells):
        return  # no mesh, or one that is refused
    skin = Skin(points, dim, [(block.kind, np.searchsorted(tags, block.nodes)) for block in cells])
    there = [_padded(np.searchsorted(tags, block.nodes[:, : block.shape.corners])) for block in known] * 2
    first, times = different(np.concatenate([skin.skin, *there]))
    rest = np.sort(first[(times == 1) & (first < len(skin.skin))])
    entity = np.repeat([block.tag for block in cells], [len(block.nodes) for block in cells])[skin.owner[rest]]
    for rows in (rest[entity == tag] for tag in np.unique(entity)):
        for face in skin.smooth(rows):
            new = gmsh.model.addDiscreteEntity(dim - 1)
            for word, own in skin.elements(face):
                gmsh.model.mesh.addElementsByType(new, skin.type_of(gmsh, word, own), [], tags[own].ravel())


def _padded(corners: Ints) -> Ints:
    """Corners (f, 4) of facets, -1 after the last one."""
    return np.pad(corners, ((0, 0), (0, 4 - corners.shape[1])), constant_values=-1)


def _stem(kind: str) -> str:
    """Return meshio's name without a number of nodes."""
    return kind.rstrip("0123456789")


def _dimension(kind: str) -> int:
    return {"vertex": 0, "line": 1, "triangle": 2, "quad": 2}.get(_stem(kind), 3)


def _key(nodes: Iterable[int]) -> tuple[int, ...]:
    return tuple(sorted(node for node in nodes if node >= 0))


TURNED = {  # corners of solids turned inside out, and three of them that span it from the first one
    "Tetrahedron": ((0, 2, 1, 3), (1, 2, 3)),
    "Hexahedron": ((0, 3, 2, 1, 4, 7, 6, 5), (1, 3, 4)),
    "Prism": ((0, 2, 1, 3, 5, 4), (1, 2, 3)),
    "Pyramid": ((0, 3, 2, 1, 4), (1, 3, 4)),
}


def _turned(word: str, rows: Ints, points: Array) -> Ints:
    """Turn solids inside out if all of them are so: Salome counts their corners the other way round."""
    if word not in TURNED:
        return rows
    shape, (swap, span) = SHAPES[word], TURNED[word]
    if np.any(np.linalg.det(points[rows[:, span]] - points[rows[:, :1]]) > 0):
        return rows
    pairs = {frozenset(edge): k for k, edge in enumerate(shape.edges, start=shape.corners)}
    edges = [pairs[frozenset((swap[a], swap[b]))] for a, b in shape.edges]
    return rows[:, [*swap, *edges][: rows.shape[1]]]


def _bodies(cells: Cells, content: Content) -> dict[str, Ints]:
    """Return the cells of each body, see above."""
    members = ((name, [cells.number[n] for n in of if n in cells.number]) for name, of in content.groups.items())
    sets = {name: np.unique(of) for name, of in members if name and of}
    if content.sections:
        sets = {name: sets[name] for name in dict.fromkeys(content.sections) if name in sets}
    for sign in (1, -1):
        body, chosen = np.full(cells.count, -1), list[str]()
        for name in sorted(reversed(sets), key=lambda name: sign * len(sets[name])):  # of equal ones the last
            if np.all(body[sets[name]] < 0):
                body[sets[name]] = len(chosen)
                chosen.append(name)
        if np.all(body >= 0):
            break
    whole = [(name, np.flatnonzero(body == k)) for k, name in enumerate(chosen)]
    whole.append((DEFAULT, np.flatnonzero(body < 0)))
    pieces = cells.pieces(body)
    parts = [(name, of[pieces[of] == k]) for name, of in whole for k in dict.fromkeys(pieces[of].tolist())]
    names = numbered(label(name, DEFAULT) for name, _ in parts)
    return {name: of for name, (_, of) in zip(names, parts, strict=True)}


def _facets(cells: Cells, content: Content) -> list[tuple[str, Ints]]:
    """Return the facets of the skin of each set that has some, in the order in which sets become sides."""
    elements, row = content.elements, cells.row
    own = {number for number, (kind, _) in elements.items() if _dimension(kind) == cells.dim - 1}
    found = list[list[tuple[str, Ints]]]()
    for sets in (
        {name: [f for n, facet in of if n in elements for f in cells.at(cells.corners(n, *elements[n], facet))]
         for name, of in content.surfaces.items()},
        {name: [f for n in of if n in own for f in cells.at(cells.rows(elements[n]))]
         for name, of in content.groups.items()},
        {name: np.flatnonzero(np.all(np.isin(cells.skin, [-1, *(row[n] for n in of if n in row)]), axis=1))
         for name, of in content.nodes.items()},
    ):  # fmt: skip
        unique = ((name, np.unique(np.asarray(facets, np.int64))) for name, facets in reversed(sets.items()) if name)
        found.append(sorted(((name, of) for name, of in unique if len(of)), key=lambda item: len(item[1])))
    return [item for items in found for item in items]


def _sides(cells: Cells, content: Content, bodies: Mapping[str, Ints]) -> dict[str, Ints]:
    """Return the facets of each side, and under numbers those of all other faces, see above."""
    body, taken = np.empty(cells.count, np.int64), np.zeros(len(cells.skin), bool)
    for k, own in enumerate(bodies.values()):
        body[own] = k
    sides, whole, left_out = list[tuple[str, Ints]](), list[Ints](), list[str]()
    for name, facets in _facets(cells, content):
        if taken[facets].any():
            left_out += [name] * (not any(np.array_equal(facets, known) for known in whole))
            continue
        whole.append(facets)
        taken[facets] = True
        for k, word in enumerate(bodies):
            own = facets[body[cells.owner[facets]] == k]
            known = SIDE.fullmatch(name.lower())
            side = name.lower() if known and known[1] == word else f"{word}.{label(name, 'side')}"
            sides += [(side, own)] * (len(own) > 0)
    if left_out:
        print(f"sets that overlap others are no sides: {', '.join(left_out)}")
    found = dict(zip(numbered(name for name, _ in sides), (own for _, own in sides), strict=True))
    for k in range(len(bodies)):
        rest = np.flatnonzero(~taken & (body[cells.owner] == k))
        found |= {str(len(found) + k): own for k, own in enumerate(cells.smooth(rest) if len(rest) else [])}
    return found
