"""Whether a scene is the one that earlier results were begun with."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from geometry.errors import SceneError
from geometry.user_files.user_file import UserFile
from solvers.scene.scene import Scene
from workflows.scene_file.read import to_dict

# of a scene: how it is told, what it is compared with, and when a step is given up
DECIDES_NOTHING = ("title", "output", "exact", "solver.max_iterations")


def identity(scene: Scene, without: Collection[str]) -> dict[str, Any]:
    """What decides the answers, as JSON reads it back; a geometry file counts by its content.

    Args:
        without: tables of the scene that decide nothing, and keys of its tables, as "table.key".
    """
    plain = {key: value for key, value in to_dict(scene).items() if key not in without}
    for table, _, key in (name.partition(".") for name in without):
        if key and table in plain:
            plain[table].pop(key, None)
    if isinstance(scene.geometry, UserFile):
        plain["geometry"]["file"] = scene.geometry.digest()
    return json.loads(json.dumps(plain))  # type: ignore[no-any-return]


def refuse_changes(before: Mapping[str, Any], now: Mapping[str, Any], target: Path) -> None:
    """
    Raises:
        SceneError: the scene in `target` was another one; the first difference is named.
    """
    for key, old, new in _changes(before, now, ()):
        raise SceneError(
            f"--resume: {key} was {json.dumps(old)} in {target}, and is {json.dumps(new)}; leave out --resume, and "
            "choose another folder with -o"
        )


def _changes(before: Any, now: Any, at: tuple[str, ...]) -> Iterator[tuple[str, Any, Any]]:
    """Keys whose values differ, and both values; None where there is none."""
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        for key in dict.fromkeys([*before, *now]):
            yield from _changes(before.get(key), now.get(key), (*at, key))
    elif before != now:
        yield ".".join(at), before, now
