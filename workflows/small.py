"""Whether displacements are small, as the linear theory takes them to be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from solvers.step_result import MeshData, StepResult

LARGE = 0.1  # of the bodies' size: strains or rotations of this order change the answer by as much


def too_large(mesh: MeshData, steps: Sequence[StepResult]) -> tuple[str, ...]:
    """A warning where displacements of a body differ by more than `LARGE` of its box; a shift does not count."""
    spread = 0.0
    for index in range(len(mesh.bodies)):
        nodes = np.unique(mesh.cells[mesh.body == index])
        size = float(np.linalg.norm(np.ptp(mesh.points[nodes], axis=0)))
        spread = max([spread, *(float(np.linalg.norm(np.ptp(s.displacement[nodes], axis=0))) / size for s in steps)])
    if spread <= LARGE:
        return ()
    return (
        f"displacements differ by up to {spread:.2g} of a body's size, and are taken to be small: the answer is that "
        "of the linear problem; check the units of E, loads and lengths",
    )
