"""`stickslip new`: a copy of a ready scene, or a scene for the contacts of an assembly, in a new file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stickslip.geometry.errors import SceneError, nearest
from stickslip.workflows.commands.contacts import UnitOption, UnitsOption, WithinOption
from stickslip.workflows.commands.process import say, speaks


def new(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="a ready scene to start from")] = None,
    file: Annotated[Path | None, typer.Argument(metavar="[FILE]", help="where to put it [NAME.toml]")] = None,
    source: Annotated[
        Path | None, typer.Option("--from", metavar="GEOMETRY", help="write a scene for a geometry file instead")
    ] = None,
    unit: UnitOption = None,
    units: UnitsOption = None,
    within: WithinOption = None,
) -> None:
    """Copy a ready scene to a file of one's own, or write one for the contacts of an assembly."""
    if source is not None:
        from stickslip.workflows.commands._contacts import stem, write_scene

        if file is not None:
            raise SceneError(f"--from {source}: takes one name, that of the scene to write; found {name} and {file}")
        write_scene(source, unit, units, within, Path(name or f"{stem(source)}.toml"))
        return
    if name is None:
        raise SceneError("new: name a ready scene (stickslip scenes lists them), or a geometry file with --from")
    if (unit, units, within) != (None, None, None):
        raise SceneError("new: --unit, --units and --within belong to --from")
    if speaks():
        _copy(name, file or Path(f"{name}.toml"))


def _copy(name: str, path: Path) -> None:
    """Copy a ready scene to a file of one's own.

    Raises:
        SceneError: there is no such scene; or see `refuse_name`, `write_new`.
    """
    from stickslip.workflows.commands._contacts import refuse_name, write_new
    from stickslip.workflows.scene_file.read import READY

    ready = {p.stem: p for p in READY.glob("*.toml")}
    if name not in ready:
        raise SceneError(f"{name}: no such ready scene; {nearest(name, ready)}")
    refuse_name(path)
    text = ready[name].read_text(encoding="utf-8")
    for beside in (p for p in READY.iterdir() if f'"{p.name}"' in text):  # its geometry, and its tables
        write_new(path.with_name(beside.name), beside.read_text(encoding="utf-8"))
    write_new(path, text)
    say(f"wrote {path}; solve it with: stickslip run {path}")
