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
    if abs(energy.time_remainder) <= LARGE * energy.dissipated:
        return ()
    return (
        f"friction dissipated {energy.dissipated:.4g} J by the end of each step, but a time remainder of "
        f"{energy.time_remainder:.2g} J is left of its work: for the dissipation take smaller steps",
    )
