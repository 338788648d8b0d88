"""Pictures of one step for a report."""

from __future__ import annotations

from pathlib import Path

from solvers.step_result import MeshData, StepResult
from workflows.writers.aside import make_folder
from workflows.writers.body_picture import draw_body
from workflows.writers.contact_curves import draw_line
from workflows.writers.contact_maps import draw_surface


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
