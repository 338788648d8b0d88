"""Whether the steps are small enough for what friction dissipates: of that a step knows its end alone."""

from __future__ import annotations

from collections.abc import Sequence

from solvers.operators.rows import ContactRows
from solvers.step_result import StepResult

LARGE = 0.3  # of the dissipation; a load that grows in two steps leaves less


def warnings(steps: Sequence[StepResult], contacts: Sequence[ContactRows]) -> tuple[str, ...]:
    """One where the time remainder of a history is more than that; closing an interference leaves one of its own."""
    if len(steps) < 3 or any((c.gap < 0).any() for c in contacts):
        return ()
    energy = steps[-1].energy
    if energy.dissipated <= 0 or abs(energy.time_remainder) <= LARGE * energy.dissipated:
        return ()
    share = abs(energy.time_remainder) / energy.dissipated
    return (
        f"the time remainder is {share:.0%} of what friction dissipated, which is summed by the end of each step: "
        "for the dissipation take smaller steps",
    )
