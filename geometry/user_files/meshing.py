"""Mesh the geometry of a user's file, or cut the cells of the mesh that it has until they have given sizes.

Of a cut mesh marked edges are halved, the longest first, and all cells that have them with them: on a facet two cells
cut alike, for both see its edges in the same order. Together with a cell's marked edge its longest one is marked, which
keeps angles. New nodes lie in the middle of edges: curved sides stay the facets that the file has. No cells are merged.

Source: of the longest edge M.-C. Rivara, Int. J. Numer. Methods Eng. 20 (1984).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from stickslip.geometry.arrays import Array, Bools, Ints
from stickslip.geometry.errors import GeometryError
from stickslip.geometry.mesh.gmsh_session import generate
from stickslip.geometry.mesh_sizes import GROWTH, USUAL, SizeField, volumes
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import Turn, skins
from stickslip.geometry.user_files.open_file import raise_gmsh_error
from stickslip.geometry.user_files.parts import Parts
from stickslip.geometry.user_files.raw_mesh import RawMesh, read_raw_mesh

LEAST = 0.25  # of the size: as small as cells get on curved faces


@dataclass(frozen=True, kw_only=True)
class MeshOptions:
    """Mesh options of a scene; lengths are in the model's unit."""

    size: float | None  # edge length; None: the file's own sizes
    fine_size: float | None  # edge length at `fine_sides` and `fine_points`; None: `size`
    fine_sides: Sequence[str]
    periodic: Sequence[tuple[str, str]]  # the first side of each pair gets the mesh of the second
    turns: Mapping[str, Turn] = field(default_factory=dict)  # of cyclic ones, by the first side, in the file's unit
    order: int
    fine_points: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (p, 3)
    around: int = 0  # cells on a full circle, at least; 0: no rule
    sizes: SizeField | None = None  # instead of all other sizes
    with_skins: bool = False  # whether whole skins touch


def mesh_parts(gmsh: Gmsh, dim: int, parts: Parts, options: MeshOptions) -> RawMesh:
    """Mesh the current gmsh model and return the mesh as arrays.

    A mesh that the file has already stays, unless sizes are given and there is a geometry to mesh again.
    """
    if (options.size is not None or options.sizes is not None) and not _is_discrete(gmsh, dim):
        gmsh.model.mesh.clear()  # also of edges alone: they would keep their sizes
    if len(gmsh.model.mesh.getElementTypes(dim)) == 0:
        size = options.size
        if size is not None:
            _set_sizes(gmsh, dim, parts, size, options)
        if options.sizes is not None:
            options.sizes.impose(gmsh)
        for slave, master in options.periodic:
            _match(gmsh, dim, parts.sides[slave], parts.sides[master], options.turns.get(slave))
        gmsh.logger.start()
        generate(gmsh, dim)
        raise_gmsh_error(gmsh)
    elements = gmsh.model.mesh.getElementTypes(dim)
    if any(gmsh.model.mesh.getElementProperties(kind)[2] != options.order for kind in elements):
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 0)
        gmsh.model.mesh.setOrder(options.order)
        if options.order == 2:
            gmsh.model.mesh.optimize("HighOrder")  # curved facets may have flattened the cells behind them
    return read_raw_mesh(gmsh, dim, parts, options.with_skins)


def _is_discrete(gmsh: Gmsh, dim: int) -> bool:
    """Whether some edges, faces or volumes of the model are nothing but their mesh."""
    entities = [entity for d in range(1, dim + 1) for entity in gmsh.model.getEntities(d)]
    return any(gmsh.model.getType(*entity).startswith("Discrete") for entity in entities)


def _set_sizes(gmsh: Gmsh, dim: int, parts: Parts, size: float, options: MeshOptions) -> None:
    """Set the mesh size to min(size, fine_size + GROWTH * distance from the fine sides and points)."""
    field, fine_size = gmsh.model.mesh.field, options.fine_size or size
    fields = [field.add("MathEval")]
    field.setString(fields[0], "F", f"{size:.17g}")
    known = parts.sides | (skins(gmsh, dim, parts.bodies) if options.with_skins else {})
    tags = [tag for side in options.fine_sides for tag in known[side]]
    points = [
        gmsh.model.addDiscreteEntity(0) for _ in options.fine_points
    ]  # nodes of no cell: the mesh leaves them out
    for tag, x in zip(points, options.fine_points.tolist(), strict=True):
        gmsh.model.setCoordinates(tag, *x)
    for kind, near in (("FacesList" if dim == 3 else "EdgesList", tags), ("NodesList", points)):
        if near and fine_size < size:
            distance = field.add("Distance")
            field.setNumbers(distance, kind, near)
            field.setNumber(distance, "NumPointsPerCurve", 200)
            fields.append(field.add("MathEval"))
            field.setString(fields[-1], "F", f"{fine_size:.17g} + {GROWTH} * F{distance}")
    least = field.add("Min")
    field.setNumbers(least, "FieldsList", fields)
    field.setAsBackgroundMesh(least)
    for option in ("FromPoints", "ExtendFromBoundary"):
        gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", options.around)
    gmsh.option.setNumber("Mesh.MeshSizeFactor", 1)
    gmsh.option.setNumber("Mesh.MeshSizeMin", min(fine_size, LEAST * size) if options.around else 0)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 1e22)


def _match(gmsh: Gmsh, dim: int, slave: list[int], master: list[int], turn: Turn | None) -> None:
    """Give the slave side the mesh of the master side, turned, or moved by the distance of their centres.

    Args:
        slave, master: gmsh tags of the entities of each side.
    """

    def corners(tag: int) -> Array:
        ends = gmsh.model.getBoundary([(dim - 1, tag)], combined=False, oriented=False, recursive=True)
        return np.asarray(np.mean([gmsh.model.getValue(*end, []) for end in ends], axis=0))

    def middles(tags: list[int]) -> Array:
        return np.array([np.reshape(gmsh.model.getBoundingBox(dim - 1, tag), (2, 3)).mean(axis=0) for tag in tags])

    if len(slave) != len(master):
        raise GeometryError(f"periodic sides have {len(slave)} and {len(master)} entities; they must match")
    if turn is not None:
        here, there = (np.array([corners(tag) for tag in tags]) for tags in (slave, master))
        placed, affine, pivot = turn.moved(there), np.eye(4), np.array([*turn.point, 0.0][:3])
        affine[:3, :3] = turn.matrix(3)
        affine[:3, 3] = pivot - affine[:3, :3] @ pivot
        of = [int(np.argmin(np.linalg.norm(placed - x, axis=1))) for x in here]
        gmsh.model.mesh.setPeriodic(dim - 1, slave, [master[k] for k in of], list(affine.ravel()))
        return
    here, there = middles(slave), middles(master)
    extent = np.ptp(here, axis=0).max() or 1.0  # 0 of a single entity
    first, second = (np.lexsort(np.round((x - x.mean(axis=0)) / extent, 6).T) for x in (here, there))
    shift = np.eye(4)
    shift[:3, 3] = here.mean(axis=0) - there.mean(axis=0)
    gmsh.model.mesh.setPeriodic(dim - 1, [slave[i] for i in first], [master[i] for i in second], list(shift.ravel()))


SIMPLEX = {2: 2, 4: 3}  # gmsh's element types, and their dimension
NEAREST = 0.5  # of the power of 2 by which cutting a cell changes its size: within that it is as asked
PASSES = 60  # more than any size takes


def cut_to_sizes(mesh: RawMesh, sizes: SizeField) -> RawMesh:
    """Cut the cells that are larger than the sizes; those that are smaller stay.

    Args:
        mesh: triangles or tetrahedra of order 1.
        sizes: in the mesh's unit.
    """
    from scipy.spatial import cKDTree  # late: it loads much else

    d = SIMPLEX[mesh.kind]
    points, cells = mesh.points, np.concatenate(list(mesh.cells.values()))
    body = np.repeat(np.arange(len(mesh.cells)), [len(rows) for rows in mesh.cells.values()])
    facets = np.concatenate([np.zeros((0, d), np.int64), *mesh.facets.values()])
    side = np.repeat(np.arange(len(mesh.facets)), [len(rows) for rows in mesh.facets.values()])
    ridges = np.concatenate([np.zeros((0, d - 1), np.int64), *mesh.edges.values()])
    of_side = np.repeat(np.arange(len(mesh.edges)), [len(rows) for rows in mesh.edges.values()])
    tree, wanted = cKDTree(sizes.points), np.log(sizes.sizes)
    for _ in range(PASSES):
        x = points[:, :d]
        size = (volumes(x, cells) / USUAL[d]) ** (1 / d)
        near = tree.query(x[cells].mean(axis=1), k=d + 1)[1]
        large = np.log2(size) - wanted[near].mean(axis=1) / np.log(2) > NEAREST / d
        if not large.any():
            break
        edges = _marked(points, cells, large)
        middles = len(points) + np.arange(len(edges))
        cells, body = _halved(cells, body, edges, middles)
        facets, side = _halved(facets, side, edges, middles)
        if d == 3 and len(ridges):
            ridges, of_side = _halved(ridges, of_side, edges, middles)
        points = np.concatenate([points, points[edges].mean(axis=1)])
    return replace(
        mesh,
        points=points,
        cells={name: cells[body == k] for k, name in enumerate(mesh.cells)},
        facets={name: facets[side == k] for k, name in enumerate(mesh.facets)},
        edges={name: ridges[of_side == k] for k, name in enumerate(mesh.edges)},
        bulging=None,
    )


def _marked(points: Array, cells: Ints, large: Bools) -> Ints:
    """Edges (e, 2) to halve, in the order in which that is done.

    They are the longest ones of large cells, and of the cells that have a marked edge.
    """
    pairs = np.array(list(combinations(range(cells.shape[1]), 2)))
    edges, number = np.unique(np.sort(cells[:, pairs], axis=2).reshape(-1, 2), axis=0, return_inverse=True)
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    order = np.argsort(-length, kind="stable")
    rank = np.empty(len(edges), np.int64)
    rank[order] = np.arange(len(edges))
    of_cells = rank[number.reshape(len(cells), -1)]
    longest, chosen = of_cells.min(axis=1), np.zeros(len(edges), bool)
    chosen[longest[large]] = True
    while not chosen[longest[more := chosen[of_cells].any(axis=1)]].all():
        chosen[longest[more]] = True
    return np.asarray(edges[order][chosen])


def _halved(simplices: Ints, owner: Ints, edges: Ints, middles: Ints) -> tuple[Ints, Ints]:
    """Simplices (s, k) with their owners (s,), cut at all edges (e, 2) that they have, the first of these first.

    Args:
        middles: (e,) new node of each edge.
    """
    span = int(middles.max()) + 1
    keys = edges[:, 0] * span + edges[:, 1]
    by_key = np.argsort(keys)
    pairs = np.array(list(combinations(range(simplices.shape[1]), 2)))
    done, owners = list[Ints](), list[Ints]()
    while len(simplices):
        ends = np.sort(simplices[:, pairs], axis=2)
        key = ends[..., 0] * span + ends[..., 1]
        place = by_key[np.minimum(np.searchsorted(keys[by_key], key), len(keys) - 1)]
        first = np.where(keys[place] == key, place, len(keys))
        local = first.argmin(axis=1)
        edge = first.min(axis=1)
        whole = edge == len(keys)
        done.append(simplices[whole])
        owners.append(owner[whole])
        cut, edge, local = simplices[~whole], edge[~whole], local[~whole]
        one, other, row = cut.copy(), cut.copy(), np.arange(len(cut))
        one[row, pairs[local, 1]] = middles[edge]
        other[row, pairs[local, 0]] = middles[edge]
        simplices, owner = np.concatenate([one, other]), np.tile(owner[~whole], 2)
    return np.concatenate(done), np.concatenate(owners)
