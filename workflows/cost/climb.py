"""Climb the ladder within the budget: the cheapest remaining run comes next, as long as it fits.

Of methods that are laid side by side all are on a mesh before any goes to a finer one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from stickslip.workflows.cost import predict
from stickslip.workflows.cost.ladder import Ladder
from stickslip.workflows.cost.run_record import Run
from stickslip.workflows.cost.rung import Rung
from stickslip.workflows.cost.sentence import seconds

MORE = 1.1  # factor on a time limit that was too short, for another try
Measure = Callable[[Rung, float], Run | None]


@dataclass(frozen=True)
class Budget:
    """What all runs together may use."""

    seconds: float  # [s]
    memory: float  # of one process [bytes]
    dim: int  # of the scene: it decides how fast work grows with the mesh

    def left(self, runs: Sequence[Run]) -> float:
        """Seconds [s]."""
        return self.seconds - sum(run.spent for run in runs)


def climb(
    ladder: Ladder, runs: list[Run], budget: Budget, measure: Measure, keep: Callable[[Run], None]
) -> tuple[bool, list[str]]:
    """Add runs until none fits any more.

    Args:
        runs: those done so far; new ones are appended.
        measure: solves a rung within so many seconds; None: the user wants to stop.
        keep: called with every run when it is done.

    Returns:
        False if the user stopped it; and the rungs that did not fit, in words.
    """
    while True:
        waiting = list(ladder.candidates(runs))
        costs = {rung: predict.seconds(rung, runs, budget.dim) for rung in waiting}
        small = [r for r in waiting if predict.memory(r, runs, budget.dim) <= budget.memory]
        left = budget.left(runs)
        fits = [rung for rung in small if costs[rung] <= left]
        if not fits:
            return True, [_left_out(rung, costs[rung], left, rung in small) for rung in waiting]
        run = measure(min(fits, key=lambda rung: (ladder.turn(rung), costs[rung], rung)), left)
        if run is None:
            return False, []
        runs.append(replace(run, number=1 + max((each.number for each in runs), default=0)))
        keep(runs[-1])


def retry(runs: Sequence[Run], budget: Budget) -> list[Run]:
    """The runs, without those that ran out of time and would get more time now."""
    others = [run for run in runs if run.status != "out_of_time"]
    late = [run for run in runs if run.status == "out_of_time"]
    return others + [run for run in late if budget.left(others) <= MORE * run.spent]


def _left_out(rung: Rung, cost: float, left: float, small: bool) -> str:
    where = f"order {rung.order}, {rung.method}, cells x {rung.factor:.3g}, tolerance {rung.tolerance:.0e}"
    if not small:
        return f"not run: {where}: would not fit into the memory"
    return f"not run: {where}: would take {seconds(cost)}, {seconds(max(left, 0.0))} are left"
