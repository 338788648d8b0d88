"""Pictures of the last step and of the history, and the animation: drawn at the end, from the files of the results."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from stickslip.geometry.builders.builder import modelled
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.writers.writer import Ended, Turn, Writer

log = logging.getLogger(__name__)


class Pictures(Writer):
    """PNG: the deformed bodies, each contact, and what changes from step to step."""

    turn = Turn.LAST  # reads steps.csv
    reader, files = "viewers", ("*.png",)

    @classmethod
    def wanted(cls, scene: Scene) -> bool:
        return scene.output.pictures

    def names(self) -> Sequence[str]:
        contacts = (f"contact_{name}.png" for name in self.job.scene.contacts)
        return ["deformed.png", "stress_error.png", "history.png", "force_displacement.png", *contacts]

    def resume(self, steps: Sequence[StepResult]) -> None:
        """Nothing: they are drawn from the whole history."""

    def finish(self, ended: Ended) -> None:
        if not ended.in_haste and ended.steps:
            with _drawing("pictures"):
                from stickslip.workflows.pictures.draw import draw, draw_course
                from stickslip.workflows.pictures.rigid import rigids

                scene, errors = self.job.scene, ended.errors[-1] if ended.errors else None
                draw(
                    self.job.folder,
                    self.job.mesh,
                    ended.steps[-1],
                    scene.title,
                    errors=errors,
                    per_metre=scene.model.startswith("plane"),
                    part=modelled(vars(scene.geometry), scene.model),
                    obstacles=rigids(scene, ended.steps[-1]),
                    units=scene.labels,
                )
                draw_course(self.job.folder, self.job.scene)


class Animation(Writer):
    """animation.gif: the bodies and contacts from step to step."""

    turn = Turn.LAST
    reader, files = "viewers", ("animation.gif",)

    @classmethod
    def wanted(cls, scene: Scene) -> bool:
        return scene.output.animation == "gif"

    def resume(self, steps: Sequence[StepResult]) -> None:
        """Nothing: it is drawn from the whole history."""

    def finish(self, ended: Ended) -> None:
        if not ended.in_haste and ended.steps:
            with _drawing("animation"):
                from stickslip.workflows.pictures.animation import animate

                animate(self.job.folder, self.job.scene, self.job.mesh, len(ended.steps))


@contextmanager
def _drawing(what: str) -> Iterator[None]:
    """A machine that cannot draw is told so; its results stand."""
    try:
        yield
    except (ImportError, RuntimeError) as error:
        log.warning("no %s: %s", what, error)
        print(f"stickslip: no {what} could be drawn: {error}", file=sys.stderr)
