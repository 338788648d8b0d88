"""Mesh the geometry of a user's file: mesh sizes, matching periodic sides, polynomial degree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import GeometryError
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.size_field import SizeField
from stickslip.geometry.user_files.open_file import raise_gmsh_error
from stickslip.geometry.user_files.parts import Parts
from stickslip.geometry.user_files.raw_mesh import RawMesh, read_raw_mesh

LEAST = 0.25  # of the size: as small as cells get on curved faces
GROWTH = 0.3  # of the cell size per distance from a contact side


@dataclass(frozen=True, kw_only=True)
class MeshOptions:
    """What the scene says about the mesh; lengths in the model's unit."""

    size: float | None  # edge length; None: the file's own sizes
    fine_size: float | None  # edge length at `fine_sides` and `fine_points`; None: `size`
    fine_sides: Sequence[str]
    periodic: Sequence[tuple[str, str]]  # the first side of each pair gets the mesh of the second
    order: int
    fine_points: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (p, 3)
    around: int = 0  # cells on a full circle, at least; 0: no rule
    sizes: SizeField | None = None  # instead of all other sizes


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
            _match(gmsh, dim, parts.sides[slave], parts.sides[master])
        gmsh.logger.start()
        gmsh.model.mesh.generate(dim)
        raise_gmsh_error(gmsh)
    elements = gmsh.model.mesh.getElementTypes(dim)
    if any(gmsh.model.mesh.getElementProperties(kind)[2] != options.order for kind in elements):
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 0)
        gmsh.model.mesh.setOrder(options.order)
        if options.order == 2:
            gmsh.model.mesh.optimize("HighOrder")  # curved facets may have flattened the cells behind them
    return read_raw_mesh(gmsh, dim, parts)


def _is_discrete(gmsh: Gmsh, dim: int) -> bool:
    """Whether some edges, faces or volumes of the model are nothing but their mesh."""
    entities = [entity for d in range(1, dim + 1) for entity in gmsh.model.getEntities(d)]
    return any(gmsh.model.getType(*entity).startswith("Discrete") for entity in entities)


def _set_sizes(gmsh: Gmsh, dim: int, parts: Parts, size: float, options: MeshOptions) -> None:
    """Set the mesh size to min(size, fine_size + GROWTH * distance from the fine sides and points)."""
    field, fine_size = gmsh.model.mesh.field, options.fine_size or size
    fields = [field.add("MathEval")]
    field.setString(fields[0], "F", f"{size:.17g}")
    tags = [tag for side in options.fine_sides for tag in parts.sides[side]]
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


def _match(gmsh: Gmsh, dim: int, slave: list[int], master: list[int]) -> None:
    """Give the slave side the mesh of the master side, moved by the distance of their centres.

    Args:
        slave, master: gmsh tags of the entities of each side.
    """

    def middles(tags: list[int]) -> Array:
        return np.array([np.reshape(gmsh.model.getBoundingBox(dim - 1, tag), (2, 3)).mean(axis=0) for tag in tags])

    if len(slave) != len(master):
        raise GeometryError(f"periodic sides have {len(slave)} and {len(master)} entities; they must match")
    here, there = middles(slave), middles(master)
    extent = np.ptp(here, axis=0).max() or 1.0  # 0 of a single entity
    first, second = (np.lexsort(np.round((x - x.mean(axis=0)) / extent, 6).T) for x in (here, there))
    shift = np.eye(4)
    shift[:3, 3] = here.mean(axis=0) - there.mean(axis=0)
    gmsh.model.mesh.setPeriodic(dim - 1, [slave[i] for i in first], [master[i] for i in second], list(shift.ravel()))
