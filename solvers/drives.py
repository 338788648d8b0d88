"""A scene with every value in time changed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from geometry.amplitude import Amplitude
from solvers.nouns.place import Place
from solvers.nouns.scene import Scene

Change = Callable[[Place, Amplitude], Amplitude]


def over(scene: Scene, change: Change) -> Scene:
    """The scene with every value in time changed."""
    tables: dict[str, Any] = {}
    for place, amplitude in scene.drives().items():
        root = "sections" if place.table in scene.sections else place.table
        path = [word for word in (place if root == "sections" else place[1:]) if word]
        tables[root] = _with(tables.get(root, getattr(scene, root)), path, change(place, amplitude))
    return replace(scene, **tables)


def _with(noun: Any, path: list[str], amplitude: Amplitude) -> Any:
    """A noun, a table of them or a vector, with the value at the end of the path replaced."""
    if not path:
        return amplitude
    first, *rest = path
    if isinstance(noun, Mapping):
        return {**noun, first: _with(noun[first], rest, amplitude)}
    if isinstance(noun, tuple):
        axis = "xyz".index(first)
        return (*noun[:axis], amplitude, *noun[axis + 1 :])
    return replace(noun, **{first: _with(getattr(noun, first), rest, amplitude)})
