"""Pictures of the last step and the history, the animation, report.html: made at the end from files of the results."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated

from stickslip.geometry.builders.builder import modelled
from stickslip.geometry.keys import Key
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.writers.writer import Ended, Keys, Turn, Writer, keys_of

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


@dataclass(frozen=True, kw_only=True)
class ReportKeys(Keys):
    """Whether it is made."""

    report: Annotated[bool, Key("-", "make report.html, see also `stickslip report FOLDER`")] = False


class Report(Writer):
    """One page, with the pictures that stand there."""

    turn = Turn.LAST  # shows the pictures
    keys = ReportKeys
    reader, files = "a browser", ("report.html",)

    @classmethod
    def wanted(cls, scene: Scene) -> bool:
        return keys_of(ReportKeys, scene.output).report

    def resume(self, steps: Sequence[StepResult]) -> None:
        """Nothing: it is made of the whole history."""

    def finish(self, ended: Ended) -> None:
        if not ended.in_haste:
            from stickslip.workflows.formats.results import read_results
            from stickslip.workflows.pictures.report_page import write_report

            write_report(read_results(self.job.folder))
