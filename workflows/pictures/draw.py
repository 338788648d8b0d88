"""Pictures for a report: of one step, and of a history."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from stickslip.geometry.units import SI, Units
from stickslip.solvers.results.step_result import ContactState, Errors, MeshData, Quantity, StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.formats.aside import make_folder
from stickslip.workflows.formats.csv_tables import read_steps_table
from stickslip.workflows.formats.plus_minus import MISSING, with_error
from stickslip.workflows.pictures.body_picture import BodyPictures
from stickslip.workflows.pictures.contact_curves import draw_line
from stickslip.workflows.pictures.history_picture import draw_history
from stickslip.workflows.pictures.loops import draw_loops
from stickslip.workflows.pictures.rigid import Rigid

HISTORY = 3  # smallest number of steps for pictures over time


def draw(
    folder: Path,
    mesh: MeshData,
    result: StepResult,
    title: str,
    *,
    errors: Errors | None = None,
    per_metre: bool = False,
    part: str = "",
    obstacles: Sequence[Rigid] = (),
    units: Units = SI,
) -> list[Path]:
    """Draw deformed.png, stress_error.png if the error was estimated, and one contact_NAME.png for each contact.

    Rank 0 only.

    Args:
        errors: of the numbers of the step; None: not estimated.
        per_metre: whether resultants are those of a metre of thickness.
        part: what of the bodies is modelled, half or quarter; empty: all of it.
        obstacles: at the time of the step.
        units: of the labels.

    Returns:
        The paths of the pictures.

    Raises:
        MachineError: the disk is full.
    """
    make_folder(folder)
    title, of = " ".join(title.split()), f" of the modelled {part}" if part else ""
    bodies = BodyPictures(mesh, result, title, obstacles, units)
    drawn = [bodies.draw_stress(folder)]
    if len(result.stress_error):
        drawn.append(bodies.draw_error(folder))
    for name, contact in result.contacts.items():
        surface = mesh.surfaces[name]
        said = _said(name, contact, errors or {}, per_metre, units)
        peak, resultants = said.pop("largest pressure"), ", ".join(f"{what} {number}" for what, number in said.items())
        if any(MISSING in number for number in said.values()) or MISSING in peak:
            resultants += f"; {MISSING} a part of the error is not known"
        head = f"{title}\nt = {result.time:g} s, contact {name}{of}, largest pressure {peak}\n{resultants}"
        if mesh.points.shape[1] == 3:
            from stickslip.workflows.pictures.contact_maps import draw_surface  # with VTK

            drawn.append(draw_surface(folder, name, surface, contact, head, units))
        else:
            drawn.append(draw_line(folder, name, surface[0], surface[1], contact, head, units))
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


def _said(name: str, contact: ContactState, errors: Errors, per_metre: bool, units: Units = SI) -> dict[str, str]:
    """Numbers of a contact with their errors, in words."""
    force, area = ("N/m", "m") if per_metre else ("N", "m²")
    rubs = bool(contact.bound.any())
    words = {"max_pressure": ("largest pressure", "Pa"), "normal_force": ("normal force", force)}
    words |= {"tangential_force": ("tangential force", force)} if rubs else {}
    words |= {"stick_area": ("sticks on", area)} if rubs else {"contact_area": ("touches on", area)}
    return {
        word: with_error(getattr(contact, key), errors.get(Quantity("contacts", name, key)), units(unit))
        for key, (word, unit) in words.items()
    }
