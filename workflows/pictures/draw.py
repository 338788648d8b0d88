"""Pictures for a report: of one step, and of a history."""

from __future__ import annotations

import logging
import sys
from collections.abc import Sequence
from pathlib import Path

from solvers.results.step_result import MeshData, StepResult
from solvers.scene.scene import Scene
from workflows.pictures.body_picture import draw_body
from workflows.pictures.contact_curves import draw_line
from workflows.pictures.contact_maps import draw_surface
from workflows.pictures.history_picture import draw_history
from workflows.pictures.loops import draw_loops
from workflows.writers.aside import make_folder
from workflows.writers.by_time import read_by_time

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
            from workflows.pictures.draw import draw, draw_course

            draw(folder, mesh, steps[-1], scene.title)
            draw_course(folder, scene)
        if wanted.animation == "gif":
            from workflows.pictures.animation import animate

            animate(folder, scene, mesh, len(steps))
    except (ImportError, RuntimeError) as error:
        log.warning("no pictures: %s", error)
        print(f"stickslip: no pictures could be drawn: {error}", file=sys.stderr)


HISTORY = 3  # steps that are worth a picture over time


def draw(folder: Path, mesh: MeshData, result: StepResult, title: str) -> list[Path]:
    """Draw deformed.png and one contact_NAME.png for each contact; returns their paths. Rank 0 only.

    Raises:
        MachineError: the disk is full.
    """
    make_folder(folder)
    title = " ".join(title.split())
    head = f"{title}\nt = {result.time:g} s"
    drawn = [draw_body(folder, mesh, result, title)]
    for name, contact in result.contacts.items():
        surface = mesh.surfaces[name]
        if mesh.points.shape[1] == 3:
            drawn.append(draw_surface(folder, name, surface, contact, head))
        else:
            drawn.append(draw_line(folder, name, surface[0], surface[1], contact, head))
    return drawn


def draw_course(folder: Path, scene: Scene) -> list[Path]:
    """Draw history.png and force_displacement.png from steps.csv, if there are steps enough. Rank 0 only.

    Raises:
        MachineError: the disk is full, or steps.csv cannot be read.
    """
    columns, title = read_by_time(folder), " ".join(scene.title.split())
    if len(columns["time"]) < HISTORY:
        return []
    loops = draw_loops(folder, scene, columns, title)
    return [draw_history(folder, scene, columns, title), *([loops] if loops else [])]
