"""What is kept of an iteration."""

from __future__ import annotations

from dataclasses import dataclass

from solvers.newton.solution import Step

HistoryTuple = tuple[float, int, float, int, float, str]  # see `HistoryRow.as_tuple`


@dataclass(frozen=True)
class HistoryRow:
    """One iteration of one attempt at a step."""

    time: float
    step: Step
    seconds: float
    method: str

    def as_tuple(self) -> HistoryTuple:
        """Time, iteration, residual, volume solves, seconds, method."""
        return self.time, self.step.iteration, self.step.residual, self.step.volume_solves, self.seconds, self.method
