"""Pictures for a report: of one step, and of a history."""

from __future__ import annotations

from pathlib import Path

from solvers.results.step_result import MeshData, StepResult
from solvers.scene.scene import Scene
from workflows.formats.aside import make_folder
from workflows.formats.steps_csv import read_steps_table
from workflows.pictures.body_picture import draw_body
from workflows.pictures.contact_curves import draw_line
from workflows.pictures.contact_maps import draw_surface
from workflows.pictures.history_picture import draw_history
from workflows.pictures.loops import draw_loops

HISTORY = 3  # smallest number of steps for pictures over time


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
    """Draw history.png and force_displacement.png from steps.csv, if there are enough steps. Rank 0 only.

    Raises:
        MachineError: the disk is full, or steps.csv cannot be read.
    """
    columns, title = read_steps_table(folder), " ".join(scene.title.split())
    if len(columns["time"]) < HISTORY:
        return []
    loops = draw_loops(folder, scene, columns, title)
    return [draw_history(folder, scene, columns, title), *([loops] if loops else [])]
