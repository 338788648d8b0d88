"""`stickslip scenes`: the ready scenes."""

from __future__ import annotations

from stickslip.workflows.commands.process import say


def scenes() -> None:
    """List the ready scenes."""
    from stickslip.workflows.scene_file.read import READY, title_of

    for path in sorted(READY.glob("*.toml")):
        say(f"{path.stem:<12} {title_of(path)}")
