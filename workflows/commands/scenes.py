"""`stickslip scenes`: the ready scenes."""

from __future__ import annotations

import typer


def scenes() -> None:
    """List the ready scenes."""
    from stickslip.workflows.scene_file.read import READY, title_of

    for path in sorted(READY.glob("*.toml")):
        typer.echo(f"{path.stem:<12} {title_of(path)}")
