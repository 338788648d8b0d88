"""What a round was solved with, and what it found."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from stickslip.workflows.accuracy.level import Level
from stickslip.workflows.accuracy.standing import Standing


@dataclass
class Round:
    """A round: its level, and what it found."""

    level: Level
    goals: list[Standing] = field(default_factory=list)
    unknowns: int = 0
    steps: int = 0
    seconds: float = 0.0
    price: float | None = None  # [s] of the next one that is expected to reach the goals; None: not needed

    def __str__(self) -> str:
        goals = ", ".join(map(str, self.goals))
        order = "order 2, " if self.level.order == 2 else ""
        return f"{order}{self.unknowns} unknowns, {self.steps} steps, {self.seconds:.1f} s: {goals}"

    @property
    def met(self) -> bool:
        """Whether it has reached all goals."""
        return all(goal.met for goal in self.goals)

    @property
    def plain(self) -> dict[str, Any]:
        """For result.json."""
        goals = {goal.name: {"value": goal.value, "error": goal.reached, "asked": goal.asked} for goal in self.goals}
        told = {"order": self.level.order, "unknowns": self.unknowns, "steps": self.steps, "seconds": self.seconds}
        return told | {"goals": goals}
