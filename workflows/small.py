"""Whether displacements are small, as the linear theory takes them to be."""

from __future__ import annotations

import numpy as np

from solvers.step_result import MeshData, StepResult

LARGE = 0.1  # of the bodies' size: strains or rotations of this order change the answer by as much


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
        """One where displacements of a body differed by more than `LARGE` of its box."""
        if self.spread <= LARGE:
            return ()
        return (
            f"displacements differ by up to {self.spread:.2g} of a body's size, and are taken to be small: the answer "
            "is that of the linear problem; check the units of E, loads and lengths",
        )
