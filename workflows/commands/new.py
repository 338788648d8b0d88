"""`stickslip new NAME`: a copy of a ready scene, or another scene, in a new file."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import typer

from stickslip.geometry.errors import SceneError, nearest
from stickslip.workflows.formats.aside import write_aside
from stickslip.workflows.scene_file.read import READY


def copy_ready(name: str, path: Path) -> None:
    """Copy a ready scene to a file of one's own.

    Raises:
        SceneError: there is no such scene; or see `refuse_name`, `write_new`.
    """
    ready = {p.stem: p for p in READY.glob("*.toml")}
    if name not in ready:
        raise SceneError(f"{name}: no such ready scene; {nearest(name, ready)}")
    refuse_name(path)
    write_new(path, ready[name].read_text(encoding="utf-8"))
    typer.echo(f"wrote {path}; solve it with: stickslip run {path}")


def refuse_name(path: Path) -> None:
    """Check the name of a scene file that is to be made: one such as `block` would hide a ready scene.

    Raises:
        SceneError: it does not end in .toml.
    """
    if path.suffix != ".toml":
        raise SceneError(f"{path}: expected a name that ends in .toml, for the scene that is written")


def write_new(path: Path, text: str) -> None:
    """Write a scene file that is not there yet.

    Raises:
        SceneError: it is there, or its folder is not.
        MachineError: disk full, no permission.
    """
    for wrong, error in ((os.path.lexists(path), errno.EEXIST), (not path.parent.exists(), errno.ENOENT)):
        if wrong:
            raise SceneError(f"{path}: cannot be written: {os.strerror(error)}")
    write_aside(path, text.encode())
