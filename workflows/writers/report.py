"""report.html: the run on one page, made at the end from the files of the results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from stickslip.geometry.keys import Key
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.writers.writer import Ended, Keys, Turn, Writer, keys_of


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
            from stickslip.workflows.pictures.report_page import NAME, write_report
            from stickslip.workflows.pictures.report_results import read_results

            write_report(read_results(self.job.folder), self.job.folder / NAME)
