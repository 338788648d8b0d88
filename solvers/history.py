"""What is kept of an iteration."""

from __future__ import annotations

from dataclasses import dataclass

from solvers.methods.solution import Step


@dataclass(frozen=True)
class HistoryRow:
    """One iteration of one attempt at a step."""

    time: float
    step: Step
    seconds: float

    def as_tuple(self) -> tuple[float, int, float, int, float]:
        """Time, iteration, residual, volume solves, seconds."""
        return self.time, self.step.iteration, self.step.residual, self.step.volume_solves, self.seconds
