"""`stickslip new NAME`: a copy of a ready scene."""

from __future__ import annotations

from pathlib import Path

import typer

from stickslip.geometry.errors import SceneError, nearest
from stickslip.workflows.scene_file.read import READY


def copy_ready(name: str, path: Path) -> None:
    """Copy a ready scene to a file of one's own.

    Raises:
        SceneError: there is no such scene, or the file exists or cannot be written.
    """
    ready = {p.stem: p for p in READY.glob("*.toml")}
    if name not in ready:
        raise SceneError(f"{name}: no such ready scene; {nearest(name, ready)}")
    try:
        with path.open("x", encoding="utf-8") as target:
            target.write(ready[name].read_text(encoding="utf-8"))
    except OSError as error:
        raise SceneError(f"{path}: cannot be written: {error.strerror}") from None
    typer.echo(f"wrote {path}; solve it with: stickslip run {path}")
