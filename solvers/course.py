"""Where supports, loads and obstacles go in time: what the scene says, until a script says otherwise."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from geometry.amplitude import Amplitude, value_at
from solvers.nouns.scene import Scene

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
