"""Whether displacements are small, as the linear theory takes them to be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from solvers.nouns.scene import Scene
from solvers.step_result import StepResult

LARGE = 0.1  # of the bodies' size: strains or rotations of this order change the answer by as much


def too_large(scene: Scene, steps: Sequence[StepResult]) -> tuple[str, ...]:
    """A warning where displacements differ by more than `LARGE` of the bodies' box; moving all alike does not count."""
    size = float(np.linalg.norm(np.ptp(scene.geometry.box(scene.dim), axis=0)))
    spread = max((float(np.linalg.norm(np.ptp(step.displacement, axis=0))) / size for step in steps), default=0.0)
    if spread <= LARGE:
        return ()
    return (
        f"displacements differ by up to {spread:.2g} of the bodies' size, and are taken to be small: the answer is "
        "that of the linear problem; check the units of E, loads and lengths",
    )
