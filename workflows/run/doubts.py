"""What the answer itself gives reason to doubt: displacements that are not small, steps that are too coarse."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from solvers.contact.rows import ContactRows
from solvers.results.step_result import MeshData, StepResult

LARGE_SPREAD = 0.1  # of the bodies' size: strains or rotations of this order change the answer by as much
LARGE_REMAINDER = 0.3  # of the dissipation; a load that grows in two steps leaves less


class DisplacementSpread:
    """By how much the displacements within a body have differed at most, relative to the body's box."""

    def __init__(self, mesh: MeshData, before: float = 0.0) -> None:
        """
        Args:
            before: the spread of the steps before those that `see` is given.
        """
        self.largest = before
        self._bodies = []
        for index in range(len(mesh.bodies)):
            inside = np.zeros(len(mesh.points), bool)
            inside[mesh.cells[mesh.body == index]] = True
            self._bodies.append((inside, float(np.linalg.norm(np.ptp(mesh.points[inside], axis=0)))))

    def see(self, step: StepResult) -> None:
        """A shift of a body as a whole does not count."""
        for inside, size in self._bodies:
            differ = float(np.linalg.norm(np.ptp(step.displacement[inside], axis=0)))
            self.largest = max(self.largest, differ / size)

    def warnings(self) -> tuple[str, ...]:
        """One where the spread is larger than `LARGE_SPREAD`."""
        if self.largest <= LARGE_SPREAD:
            return ()
        return (
            f"displacements differ by up to {self.largest:.2g} of a body's size, and are taken to be small: the answer "
            "is that of the linear problem; check the units of E, loads and lengths",
        )


def coarse_steps(steps: Sequence[StepResult], contacts: Sequence[ContactRows]) -> tuple[str, ...]:
    """A warning where the time remainder of a history is more than `LARGE_REMAINDER` of the dissipation.

    Closing an initial interference leaves a remainder of its own: then there is none.
    """
    if len(steps) < 3 or any((c.gap < 0).any() for c in contacts):
        return ()
    energy = steps[-1].energy
    if energy.dissipated <= 0 or abs(energy.time_remainder) <= LARGE_REMAINDER * energy.dissipated:
        return ()
    share = abs(energy.time_remainder) / energy.dissipated
    return (
        f"the time remainder is {share:.0%} of what friction dissipated, which is summed by the end of each step: "
        "for the dissipation take smaller steps",
    )
