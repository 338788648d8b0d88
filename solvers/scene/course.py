"""Values in time: where they stand in a scene, what they are at a time, and a scene with every one of them changed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from geometry.amplitude import Amplitude, value_at
from solvers.scene.scene import Scene
from solvers.scene.timeline import Place

Drive = Callable[[Scene], Amplitude]  # picks one of a scene's values in time


class Course:
    """The scene whose values in time count: the one thing of a system that may change."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    def value(self, drive: Drive, time: float) -> float:
        """What the scene wants at that time."""
        return value_at(drive(self.scene), time, self.scene.steps.end)

    @contextmanager
    def following(self, scene: Scene) -> Iterator[None]:
        """Take another scene's values in time for a while; all else of the two scenes is the same."""
        before, self.scene = self.scene, scene
        try:
            yield
        finally:
            self.scene = before


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
