"""The record of the iterations of a step."""

from __future__ import annotations

import logging
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from stickslip.solvers.iteration import OnStep, Step

log = logging.getLogger(__name__)


class HistoryTuple(NamedTuple):
    """One iteration as step files and history.csv hold it, without the solver's own types."""

    time: float  # that the attempted substep leads to [s]
    iteration: int  # number within the attempt; 0 is the start
    residual: float  # relative natural residual before the iteration's update [-]
    volume_solves: int  # applications of K_B^-1 so far in the run
    seconds: float  # wall time since the attempt began [s]
    method: str  # name of the method, as `solver.method` spells it


@dataclass(frozen=True)
class HistoryRow:
    """One iteration of one attempt at a substep; `on_iteration` callbacks receive it.

    Several attempts may lead to the same time: by other methods, or for other pairs of a sliding contact.
    """

    time: float  # that the attempted substep leads to [s]
    step: Step  # the iteration: its number, residual [-] and count of volume solves
    seconds: float  # wall time since the attempt began [s]
    method: str  # name of the method, as `solver.method` spells it

    def as_tuple(self) -> HistoryTuple:
        """The same as plain values."""
        return HistoryTuple(
            time=self.time,
            iteration=self.step.iteration,
            residual=self.step.residual,
            volume_solves=self.step.volume_solves,
            seconds=self.seconds,
            method=self.method,
        )


OnIteration = Callable[[HistoryRow], None]  # called after each iteration of each attempt, on every rank


def count_iterations(history: Sequence[HistoryRow]) -> int:
    """Iterations of all attempts together; a row with number 0 is the start of one."""
    return sum(row.step.iteration > 0 for row in history)


class History:
    """Iterations of all attempts at one step, in the order in which they were made."""

    def __init__(self, on_iteration: OnIteration = lambda row: None) -> None:
        """Begin with none; `on_iteration` is called with each one."""
        self.rows: list[HistoryRow] = []
        self._on_iteration = on_iteration

    def attempt(self, end: float, method: Callable[[], str], own: list[Step]) -> OnStep:
        """Return what records an attempt by the method in use at a substep that ends at a time [s], in `own` too."""
        began = clock.perf_counter()

        def record(step: Step) -> None:
            own.append(step)
            row = HistoryRow(time=end, step=step, seconds=clock.perf_counter() - began, method=method())
            self.rows.append(row)
            log.info("t = %g  iteration %d  residual %.2e", row.time, step.iteration, step.residual)
            self._on_iteration(row)

        return record

    def tick(self, time: float, number: int, volume_solves: int) -> None:
        """Tell of a step of a clock that ends at a time [s]; there may be a million of them, so none is kept."""
        step = Step(iteration=number, residual=0.0, volume_solves=volume_solves)
        self._on_iteration(HistoryRow(time=time, step=step, seconds=0.0, method="clock"))
