"""The pictures that a scene asks for, when its run has ended; nothing that draws is imported without need."""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence
from pathlib import Path

from solvers.nouns.scene import Scene
from solvers.step_result import MeshData, StepResult

log = logging.getLogger(__name__)


def draw_wanted(folder: Path, scene: Scene, mesh: MeshData, steps: Sequence[StepResult]) -> None:
    """Draw; a machine that cannot is told so, its results stand. Rank 0 only.

    Args:
        steps: all of them, the last one with its fields.

    Raises:
        MachineError: the disk is full, or a file of the results cannot be read.
    """
    wanted = scene.output
    try:
        if wanted.pictures:
            from workflows.pictures import draw, draw_course

            draw(folder, mesh, steps[-1], scene.title)
            draw_course(folder, scene)
        if wanted.animation == "gif":
            from workflows.writers.animation import animate

            animate(folder, scene, mesh, len(steps))
    except (ImportError, RuntimeError) as error:
        log.warning("no pictures: %s", error)
        print(f"stickslip: no pictures could be drawn: {error}", file=sys.stderr)
