"""Arguments that several commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def _scenes(begun: str) -> list[str]:
    """Complete a scene's name for the shell: ready scenes, and files and folders here; it knows other paths itself."""
    ready, here = Path(__file__).parents[1] / "scenes", Path()
    files = [path.name for path in here.glob("*.toml")] + [f"{path.name}/" for path in here.iterdir() if path.is_dir()]
    return [
        name for name in sorted(path.stem for path in ready.glob("*.toml")) + sorted(files) if name.startswith(begun)
    ]


SceneArgument = Annotated[
    str, typer.Argument(metavar="SCENE", help="a scene file, or a ready scene's name", autocompletion=_scenes)
]
SetOption = Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="override a key of the scene")]
