"""A time series for a viewer: every n-th step and the last one, listed in an index that is written anew as it grows."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

from stickslip.solvers.results.step_result import StepResult
from stickslip.workflows.formats.steps import step_files
from stickslip.workflows.writers.writer import Ended, Job, Writer

GROWTH = 1.125  # the index is written again once so many times the steps are there


class SeriesWriter(Writer):
    """Base of the writers of series: which steps are shown, and when the index is written.

    The index is written again once an eighth more steps are there: all of a long history together cost then no more
    than nine times the last writing, whatever the number of steps.
    """

    reader = "ParaView"

    def __init__(self, job: Job) -> None:
        super().__init__(job)
        self._last: tuple[int, float] | None = None  # index and time [s] of the last step
        self.shown: list[tuple[int, float]] = []  # index and time [s] of the steps to show
        self._written = 0  # so many of them stand in the index

    @abstractmethod
    def write_index(self, steps: Sequence[tuple[int, float]]) -> None:
        """Write the index, or what can be written of it before a step is to be shown.

        Args:
            steps: index and time [s] of all steps to show.
        """

    def write_step(self, index: int) -> None:
        """Write the files that a step to be shown has of its own in this series, if any; its step's file is there."""
        return None

    def resume(self, steps: Sequence[StepResult]) -> None:
        """The index may list fewer steps, or one that has been taken away: the next step or the end writes it again.

        Where steps have files of their own, a subclass sees to these as well.
        """
        every = self.job.scene.output.every
        times = [(index, step.time) for index, step in enumerate(steps, start=1)]
        self._last = times[-1] if times else None
        there = step_files(self.job.folder)  # an earlier process may have stored the fields of fewer steps
        self.shown = [(index, time) for index, time in times if index % every == 0 and index in there]

    def step(self, index: int, result: StepResult) -> None:
        """Show it, at once or with those that follow; a viewer reads meanwhile."""
        self._last = index, result.time
        if index % self.job.scene.output.every == 0:
            self._show(self._last)
        if len(self.shown) >= max(1, GROWTH * self._written) or index == 1:
            self._write_index()

    def finish(self, ended: Ended) -> None:
        """Show every step that is to be shown, and the last one."""
        if self._last is not None and self._last not in self.shown[-1:]:
            self._show(self._last)
        self._write_index()

    def _show(self, step: tuple[int, float]) -> None:
        self.write_step(step[0])
        self.shown.append(step)

    def _write_index(self) -> None:
        self.write_index(self.shown)
        self._written = len(self.shown)
