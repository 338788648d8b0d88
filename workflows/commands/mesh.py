"""`stickslip mesh`: look at a scene's geometry and mesh, without solving."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stickslip.workflows.commands.options import SceneArgument, SetOption
from stickslip.workflows.commands.process import speaks


def mesh(
    scene: SceneArgument,
    override: SetOption = None,
    gui: Annotated[bool, typer.Option("--gui", help="open the geometry in gmsh's window")] = False,
    listed: Annotated[bool, typer.Option("--list", help="bodies, sides, and numbered faces in a picture")] = False,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE.msh", help="write the mesh")] = None,
) -> None:
    """Mesh a scene and judge its mesh, without solving."""
    from stickslip.workflows.commands._mesh import announce, edit, list_entities, report
    from stickslip.workflows.scene_file.read import find, named, read, read_geometry

    if listed or gui:
        model, geometry, units = read_geometry(scene, override or ())
        with named(scene, override or ()):
            if listed:
                list_entities(geometry, model, units, Path(f"{find(scene).stem}_faces.png"))
            if gui:
                edit(geometry, model)
    if output is not None or not (listed or gui):
        loaded = read(scene, override or ())
        if speaks():
            announce(loaded)
        with named(scene, override or ()):
            report(loaded, output)
