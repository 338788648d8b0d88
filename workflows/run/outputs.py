"""The writers of a run, each called when its turn comes and on the ranks that it asks for; all ranks fail or none."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial

from stickslip.solvers.parallel.counters import Clock
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.stepping.history import HistoryTuple
from stickslip.workflows.run.collective import all_act, raise_together
from stickslip.workflows.writers.writer import Ended, Job, Turn, Writer, wanted

BEFORE = (Turn.BEFORE,)  # the run's own file is safe
AFTER = (Turn.AFTER, Turn.LAST)


class Outputs:
    """What a scene wants written; every method is collective.

    Raises:
        MachineError: on every rank, from any method: one writer cannot write.
    """

    def __init__(self, job: Job) -> None:
        self._comm, self._writers = job.comm, [kind(job) for kind in wanted(job.scene)]
        self._clock = job.simulation.clock if job.simulation else Clock()

    @property
    def names(self) -> list[str]:
        """Names of the files that the writers will make, see `Writer.names`."""
        return [name for writer in self._writers for name in writer.names()]

    def begin(self) -> None:
        """The run begins in an empty folder."""
        self._each(lambda writer: writer.begin())

    def resume(self, steps: Sequence[StepResult]) -> None:
        """The run goes on after these steps."""
        self._each(lambda writer: writer.resume(steps))

    def step(self, index: int, result: StepResult, turns: Sequence[Turn]) -> None:
        """A step was solved: those whose turn it is write it."""
        self._each(lambda writer: writer.step(index, result), turns)

    def failed(self, index: int, history: Sequence[HistoryTuple]) -> None:
        """A step could not be solved; these iterations belong to no step that was written."""
        self._each(lambda writer: writer.failed(index, history))

    def finish(self, ended: Ended, turns: Sequence[Turn]) -> None:
        """The run ends: those whose turn it is finish their files."""
        self._each(lambda writer: writer.finish(ended), turns)

    def _each(self, act: Callable[[Writer], None], turns: Sequence[Turn] = tuple(Turn)) -> None:
        for writer in self._writers:
            if writer.turn in turns:
                with self._clock.phase("output", part_of(writer)):
                    (all_act if writer.collective else raise_together)(self._comm, partial(act, writer))


def part_of(writer: Writer) -> str:
    """Its name in the profile: that of its class in words.

    >>> from stickslip.workflows.writers.tables import StepsTable
    >>> part_of(StepsTable.__new__(StepsTable))
    'steps table'
    """
    return re.sub(r"\B([A-Z])", r" \1", type(writer).__name__).lower()
