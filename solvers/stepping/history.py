"""The record of one iteration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from stickslip.solvers.iteration import Step


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


def count_iterations(history: list[HistoryRow]) -> int:
    """Iterations of all attempts together; the first row of an attempt, and of a smoothing level, is its start."""
    rows = [(row.time, row.method, row.step.iteration) for row in history]
    return sum(row[2] > 0 and row != before for before, row in zip([None, *rows], rows, strict=False))
