"""Meshing what a user's file describes: sizes, periodic sides, cells of the wanted order."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from geometry.errors import GeometryError
from geometry.protocols import Gmsh
from geometry.user_files.opening import complain
from geometry.user_files.parts import Parts
from geometry.user_files.raw_mesh import RawMesh, read_raw_mesh

GROWTH = 0.3  # growth of the cell size per unit of distance from a contact side


def mesh_parts(
    gmsh: Gmsh,
    dim: int,
    parts: Parts,
    size: float | None,
    fine_size: float | None,
    fine_sides: Sequence[str],
    periodic: Sequence[tuple[str, str]],
    order: int,
) -> RawMesh:
    """Mesh the current model unless it has a mesh, and read it off.

    Args:
        size: edge length, in the model's unit; None: the file's own sizes.
        fine_size: edge length at `fine_sides`.
    """
    if len(gmsh.model.mesh.getElementTypes(dim)) == 0:
        if size is not None:
            _set_sizes(gmsh, dim, parts, size, fine_size or size, fine_sides)
        for slave, master in periodic:
            _match(gmsh, dim, parts.sides[slave], parts.sides[master])
        gmsh.logger.start()
        gmsh.model.mesh.generate(dim)
        complain(gmsh)
    elements = gmsh.model.mesh.getElementTypes(dim)
    if any(gmsh.model.mesh.getElementProperties(kind)[2] != order for kind in elements):
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 0)
        gmsh.model.mesh.setOrder(order)
        if order == 2:
            gmsh.model.mesh.optimize("HighOrder")  # curved facets may have nearly flattened the cells behind them
    return read_raw_mesh(gmsh, dim, parts)


def _set_sizes(gmsh: Gmsh, dim: int, parts: Parts, size: float, fine_size: float, fine_sides: Sequence[str]) -> None:
    """`size` everywhere, growing from `fine_size` with the distance from the contact sides."""
    field = gmsh.model.mesh.field
    fields = [field.add("MathEval")]
    field.setString(fields[0], "F", f"{size:.17g}")
    tags = [tag for side in fine_sides for tag in parts.sides[side]]
    if tags and fine_size < size:
        distance = field.add("Distance")
        field.setNumbers(distance, "FacesList" if dim == 3 else "EdgesList", tags)
        field.setNumber(distance, "NumPointsPerCurve", 200)
        fields.append(field.add("MathEval"))
        field.setString(fields[-1], "F", f"{fine_size:.17g} + {GROWTH} * F{distance}")
    least = field.add("Min")
    field.setNumbers(least, "FieldsList", fields)
    field.setAsBackgroundMesh(least)
    for option in ("FromPoints", "FromCurvature", "ExtendFromBoundary"):
        gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)
    gmsh.option.setNumber("Mesh.MeshSizeFactor", 1)
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 1e22)


def _match(gmsh: Gmsh, dim: int, slave: list[int], master: list[int]) -> None:
    """Make the slave side's mesh the master side's, moved across."""

    def middles(tags: list[int]) -> Any:
        return np.array([np.reshape(gmsh.model.getBoundingBox(dim - 1, tag), (2, 3)).mean(axis=0) for tag in tags])

    if len(slave) != len(master):
        raise GeometryError(f"periodic sides have {len(slave)} and {len(master)} entities; they must match")
    here, there = middles(slave), middles(master)
    first, second = (np.lexsort(np.round(x - x.mean(axis=0), 6).T) for x in (here, there))
    shift = np.eye(4)
    shift[:3, 3] = here.mean(axis=0) - there.mean(axis=0)
    gmsh.model.mesh.setPeriodic(dim - 1, [slave[i] for i in first], [master[i] for i in second], list(shift.ravel()))
