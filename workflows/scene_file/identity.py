"""Whether a scene is the same as that of earlier results."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from itertools import zip_longest
from pathlib import Path
from typing import Any

from stickslip.geometry.errors import SceneError
from stickslip.geometry.user_files.user_file import UserFile
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.scene_file.read import to_dict

# keys of a scene that do not change the answer of a mesh: title, labels, output, references, the limit of iterations
DECIDES_NOTHING = ("title", "units", "output", "exact", "accuracy", "solver.max_iterations")

WRITTEN_OUT = 6  # rows of a list that a refusal has room for


def identity(scene: Scene, without: Collection[str]) -> dict[str, Any]:
    """The part of a scene that decides the answers, as plain JSON data; a geometry file counts by its content.

    Args:
        without: tables to leave out, and keys of tables, as "table.key"; they do not change the answers.
    """
    plain = {key: value for key, value in to_dict(scene).items() if key not in without}
    for table, _, key in (name.partition(".") for name in without):
        if key and table in plain:
            plain[table].pop(key, None)
    if isinstance(scene.geometry, UserFile):
        plain["geometry"] |= {"file": scene.geometry.digest(), "length_unit": scene.geometry.unit}
    return json.loads(json.dumps(plain))  # type: ignore[no-any-return]


def refuse_changes(before: Mapping[str, Any], now: Mapping[str, Any], target: Path) -> None:
    """Refuse to go on in a folder that was begun with another scene.

    Args:
        before: identity of the scene that the results in `target` were begun with.
        now: identity of the scene to go on with.
        target: folder of results, for the message.

    Raises:
        SceneError: the scenes differ; the first difference is named.
    """
    for key, old, new in _changes(before, now, ()):
        raise SceneError(
            f"--resume: {key} was {json.dumps(old)} in {target}, and is {json.dumps(new)}; leave out --resume, and "
            "choose another folder with -o"
        )


def _changes(before: Any, now: Any, at: tuple[str, ...]) -> Iterator[tuple[str, Any, Any]]:
    """Keys whose values differ, and both values, None where a key is absent; of long lists the rows that differ."""
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        for key in dict.fromkeys([*before, *now]):
            yield from _changes(before.get(key), now.get(key), (*at, key))
    elif isinstance(before, list) and isinstance(now, list) and max(len(before), len(now)) > WRITTEN_OUT:
        rows = enumerate(zip_longest(before, now))
        yield from ((f"{'.'.join(at)}, row {row}", *pair) for row, pair in rows if pair[0] != pair[1])
    elif before != now:
        yield ".".join(at), before, now
