"""The members of a sweep: one scene for each combination of the values that keys take."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from stickslip.geometry.errors import SceneError
from stickslip.geometry.keys import plain
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.scene_file.read import to_dict, with_keys

MOST = 10_000  # members
LONGEST = 80  # letters of a folder's name
UNSAFE = re.compile(r"[^A-Za-z0-9.+=-]+")


@dataclass(frozen=True)
class Member:
    """One scene of a sweep."""

    name: str  # of its folder
    values: Mapping[str, Any]  # of the keys that are swept
    scene: Scene

    @property
    def bodies(self) -> str:
        """The same for members that may share mesh and factor."""
        whole = to_dict(self.scene)
        return json.dumps([whole["geometry"], whole["bodies"]], sort_keys=True)


def members(scene: Scene, over: Mapping[str, Sequence[Any]], files: Path | None = None) -> list[Member]:
    """All combinations; the last key changes fastest.

    Args:
        over: values by dotted key, as in a scene file.
        files: where a relative `geometry.file` begins, by default the working folder.

    Raises:
        SceneError: a key has no values, or a scene with one of them is wrong.
    """
    if not over:
        raise SceneError("sweep: needs a key and its values, for example contacts.base.friction.mu=[0.1, 0.2, 0.3]")
    for key, values in over.items():
        if isinstance(values, str) or not isinstance(values, Sequence) or not len(values):
            raise SceneError(f"sweep: {key}: expected a list of values, for example {key}=[0.1, 0.2, 0.3]")
    found, names, count = list[Member](), short(list(over)), 1
    for values in over.values():
        count *= len(values)
    if count > MOST:
        raise SceneError(f"sweep: {count} members; at most {MOST}")
    for combination in product(*over.values()):
        chosen = {key: plain(value) for key, value in zip(over, combination, strict=True)}
        name = _safe(",".join(f"{names[key]}={said(value)}" for key, value in chosen.items()))
        try:
            changed = with_keys(scene, chosen, files)
        except SceneError as error:
            raise SceneError(f"sweep: {name}: {error}") from None
        if name in (member.name for member in found):
            raise SceneError(f"sweep: {name}: stands there twice")
        found.append(Member(name, chosen, changed))
    return found


def short(keys: Sequence[str]) -> dict[str, str]:
    """The shortest ends of dotted keys that tell them apart."""
    found = {}
    for key in keys:
        parts = key.split(".")
        ends = [".".join(parts[k:]) for k in range(len(parts) - 1, -1, -1)]
        others = [other for other in keys if other != key]
        found[key] = next((end for end in ends if not any(f".{other}".endswith(f".{end}") for other in others)), key)
    return found


def said(value: Any) -> str:
    """A value in a word or two."""
    return value if isinstance(value, str) else json.dumps(value)


def _safe(name: str) -> str:
    """A name for a folder, and a short hash where letters are lost."""
    safe = UNSAFE.sub("_", name.replace(",", "+").replace(" ", ""))
    if safe == name.replace(",", "+") and len(safe) <= LONGEST:
        return safe
    return f"{safe[: LONGEST - 9]}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"
