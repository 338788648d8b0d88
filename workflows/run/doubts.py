"""What the answer itself gives reason to doubt: displacements that are not small, steps that are too coarse."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from solvers.contact.rows import ContactRows
from solvers.results.step_result import MeshData, StepResult

LARGE_DISPLACEMENT = 0.1  # of the bodies' size: strains or rotations of this order change the answer by as much


class Smallness:
    """Sees the steps one after the other, and remembers by how much a body's displacements differed."""

    def __init__(self, mesh: MeshData) -> None:
        self.spread = 0.0  # of the body's box
        self._bodies = []
        for index in range(len(mesh.bodies)):
            inside = np.zeros(len(mesh.points), bool)
            inside[mesh.cells[mesh.body == index]] = True
            self._bodies.append((inside, float(np.linalg.norm(np.ptp(mesh.points[inside], axis=0)))))

    def see(self, step: StepResult) -> None:
        """A shift of a body as a whole does not count."""
        for inside, size in self._bodies:
            differ = float(np.linalg.norm(np.ptp(step.displacement[inside], axis=0)))
            self.spread = max(self.spread, differ / size)

    def warnings(self) -> tuple[str, ...]:
        """One where displacements of a body differed by more than `LARGE_DISPLACEMENT` of its box."""
        if self.spread <= LARGE_DISPLACEMENT:
            return ()
        return (
            f"displacements differ by up to {self.spread:.2g} of a body's size, and are taken to be small: the answer "
            "is that of the linear problem; check the units of E, loads and lengths",
        )


LARGE_REMAINDER = 0.3  # of the dissipation; a load that grows in two steps leaves less


def coarse_steps(steps: Sequence[StepResult], contacts: Sequence[ContactRows]) -> tuple[str, ...]:
    """One where the time remainder of a history is more than that; closing an interference leaves one of its own."""
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
