"""Pictures of the last step and the history, the animation, report.html: made at the end from files of the results."""

from __future__ import annotations

import logging
import sys
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from stickslip.geometry.builders.builder import modelled
from stickslip.geometry.keys import Key
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.writers.writer import Ended, Keys, Turn, Writer, keys_of

log = logging.getLogger(__name__)


class AtTheEnd(Writer):
    """Base of the writers that draw at the end, from files of the results and the whole history."""

    turn = Turn.LAST  # reads steps.csv, shows pictures
    reader = "viewers"

    @abstractmethod
    def draw(self, ended: Ended) -> None:
        """Draw what a run with steps has left."""

    def resume(self, steps: Sequence[StepResult]) -> None:
        """Nothing is there that goes on."""

    def finish(self, ended: Ended) -> None:
        """A machine that cannot draw is told so; its results stand."""
        if ended.in_haste or not ended.steps:
            return
        try:
            self.draw(ended)
        except (ImportError, RuntimeError) as error:
            what = type(self).__name__.lower()
            log.warning("no %s: %s", what, error)
            print(f"stickslip: no {what} could be drawn: {error}", file=sys.stderr)


class Pictures(AtTheEnd):
    """PNG: the deformed bodies, each contact, and what changes from step to step."""

    files = ("*.png",)

    @classmethod
    def wanted(cls, scene: Scene) -> bool:
        return scene.output.pictures

    def names(self) -> Sequence[str]:
        contacts = (f"{what}_{name}.png" for name in self.job.scene.pairs for what in ("contact", "slip"))
        return [
            "deformed.png",
            "stress_error.png",
            "history.png",
            "force_displacement.png",
            "sensitivity.png",
            *contacts,
        ]

    def draw(self, ended: Ended) -> None:
        from stickslip.workflows.pictures.draw import draw, draw_course
        from stickslip.workflows.pictures.rigid import rigids
        from stickslip.workflows.pictures.slip_course import draw_slip
        from stickslip.workflows.pictures.tornado import NAME, draw_tornado

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
        draw_course(self.job.folder, scene)
        title = " ".join(scene.title.split())
        draw_slip(self.job.folder, self.job.mesh, title, scene.labels)
        draw_tornado(self.job.folder / NAME, ended.steps[-1], scene.parameters(), title, units=scene.labels)


class Animation(AtTheEnd):
    """animation.gif: the bodies and contacts from step to step."""

    files = ("animation.gif",)

    @classmethod
    def wanted(cls, scene: Scene) -> bool:
        return scene.output.animation == "gif"

    def draw(self, ended: Ended) -> None:
        from stickslip.workflows.pictures.animation import animate

        animate(self.job.folder, self.job.scene, self.job.mesh, len(ended.steps))


@dataclass(frozen=True, kw_only=True)
class ReportKeys(Keys):
    """Whether it is made."""

    report: Annotated[bool, Key("-", "make report.html, see also `stickslip report FOLDER`")] = False


class Report(AtTheEnd):
    """One page, with the pictures that stand there; also of a run without steps."""

    keys = ReportKeys
    reader, files = "a browser", ("report.html",)

    @classmethod
    def wanted(cls, scene: Scene) -> bool:
        return keys_of(ReportKeys, scene.output).report

    def draw(self, ended: Ended) -> None:
        from stickslip.workflows.formats.results import read_results
        from stickslip.workflows.pictures.report_page import write_report

        write_report(read_results(self.job.folder))

    def finish(self, ended: Ended) -> None:
        if not ended.in_haste:
            self.draw(ended)
