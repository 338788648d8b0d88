"""Assemblies of a few solids, drawn by gmsh, and what is found in them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from stickslip.geometry.mesh.gmsh_session import gmsh_session
from stickslip.geometry.user_files.outline import Outline, read_outline
from stickslip.geometry.user_files.parts import Selection, find_parts

Draw = Callable[[Any], None]


def outline_of(draw: Draw, dim: int = 3, names: Mapping[str, Selection] | None = None) -> Outline:
    """The outline of what `draw` makes with gmsh's `model.occ`, in metres."""
    with gmsh_session() as gmsh:
        draw(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        return read_outline(gmsh, dim, find_parts(gmsh, dim, True, names or {}, 1.0), 1.0)


def write_assembly(path: Path, draw: Draw) -> Path:
    """The same as a file."""
    with gmsh_session() as gmsh:
        draw(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    return path


def stacked(occ: Any, gap: float = 0.0) -> None:
    """A plate of 4 m by 4 m by 1 m, and a cube of 1 m on its middle."""
    occ.addBox(0, 0, 0, 4, 4, 1)
    occ.addBox(1.5, 1.5, 1 + gap, 1, 1, 1)


def pinned(occ: Any, clearance: float = 0.0) -> None:
    """Two plates with a hole of radius 0.2 m, and a pin in it that is as long as both are thick."""
    for z in (0.0, 0.4):
        plate, hole = occ.addBox(0, 0, z, 1, 1, 0.4), occ.addCylinder(0.5, 0.5, z, 0, 0, 0.4, 0.2)
        occ.cut([(3, plate)], [(3, hole)])
    occ.addCylinder(0.5, 0.5, 0, 0, 0, 0.8, 0.2 - clearance)


def bolted(occ: Any) -> None:
    """Two plates 40 x 40 x 8 with holes of radius 4.4, a bolt of radius 4 with a head and a nut, without names."""
    for z in (0.0, 8.0):
        plate, hole = occ.addBox(0, 0, z, 40, 40, 8), occ.addCylinder(20, 20, z, 0, 0, 8, 4.4)
        occ.cut([(3, plate)], [(3, hole)])
    shank, head = occ.addCylinder(20, 20, -8, 0, 0, 24, 4), occ.addCylinder(20, 20, 16, 0, 0, 5, 7)
    occ.fuse([(3, shank)], [(3, head)])
    nut, bore = occ.addCylinder(20, 20, -6, 0, 0, 6, 7), occ.addCylinder(20, 20, -6, 0, 0, 6, 4)
    occ.cut([(3, nut)], [(3, bore)])
