"""Pictures for a report: of one step, of its contacts in a plane model, and of a history."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.geometry.arrays import AnyArray, Array
from stickslip.geometry.units import SI, Units
from stickslip.solvers.results.step_result import OPEN, ContactState, Errors, MeshData, Quantity, StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.formats.contact_line import Line, walk
from stickslip.workflows.formats.csv_tables import read_steps_table
from stickslip.workflows.formats.files import make_folder
from stickslip.workflows.formats.plus_minus import AT_LEAST, with_error
from stickslip.workflows.pictures.body_picture import BodyPictures
from stickslip.workflows.pictures.force_displacement import draw_loops
from stickslip.workflows.pictures.history import draw_history
from stickslip.workflows.pictures.rigid import Rigid
from stickslip.workflows.pictures.sheet import LINE, PALE, STATUS_COLOURS, Sheet, frame
from stickslip.workflows.pictures.view import focus

PRESSURE, TANGENTIAL, WORN = "#1b1b1b", "#b2182b", "#2166ac"


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
        if any(AT_LEAST in number for number in (*said.values(), peak)):
            resultants += f"; {AT_LEAST} a part of the error is not known"
        head = f"{title}\nt = {result.time:g} s, contact {name}{of}, largest pressure {peak}\n{resultants}"
        if mesh.points.shape[1] == 3:
            from stickslip.workflows.pictures.contact_maps import draw_surface  # with VTK

            drawn.append(draw_surface(folder, name, surface, contact, head, units, obstacles))
        else:
            drawn.append(draw_line(folder, name, mesh, contact, head, bodies, units))
    return drawn


def draw_course(folder: Path, scene: Scene) -> list[Path]:
    """Draw history.png and force_displacement.png from steps.csv, if there are at least three steps. Rank 0 only.

    Raises:
        MachineError: the disk is full, or steps.csv cannot be read.
    """
    columns, title = read_steps_table(folder), " ".join(scene.title.split())
    if len(columns["time"]) < 3:
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


def draw_line(
    folder: Path, name: str, mesh: MeshData, contact: ContactState, head: str, bodies: BodyPictures, units: Units = SI
) -> Path:
    """Draw the contact to scale; pressure, tangential traction with the friction bound; and the status.

    Args:
        bodies: the step's.
    """
    (points, facets, _), touching = mesh.surfaces[name], contact.status != OPEN
    line, near = walk(points, facets), touching.copy()
    near[facets[touching[facets].any(axis=1)]] = True  # of one node alone its facets are shown
    pressure = contact.pressure[line.nodes]
    tangential = np.einsum("ki,ki->k", contact.traction[line.nodes], line.tangents)
    magnitude = np.linalg.norm(contact.traction[line.nodes], axis=1)
    bound = np.where(np.isfinite(contact.bound), contact.bound, np.nan)[line.nodes]
    view = bodies.view_of_contact(name, near)
    width, high = (5.85, 5.85 / view.aspect) if view.aspect > 2 else (2.9 * view.aspect, 2.9)
    sheet = Sheet(7.0, 4.5 + high + LINE, units=units)
    bodies.show_contact(sheet.axes(0.85, 3.75, width, high), view, name, round(width * sheet.dpi))
    axes = sheet.axes(0.85, 0.87, 5.85, 2.1)
    axes.axhline(0.0, color=PALE, linewidth=0.6)
    style = {"markersize": 2.5, "marker": "o"} if len(line.nodes) <= 120 else {}
    lines = [axes.plot(*line_of(line, pressure), color=PRESSURE, linewidth=1.4, label="pressure $p_n$", **style)[0]]
    if np.any(contact.bound):
        lines += axes.plot(
            *line_of(line, tangential),
            color=TANGENTIAL,
            linewidth=1.4,
            label=r"tangential traction $\sigma_T$",
            **style,
        )
        for sign, label in ((1, r"friction bound $\pm s$"), (-1, "_")):
            drawn = axes.plot(*line_of(line, sign * bound), color=TANGENTIAL, linewidth=1.0, linestyle=(0, (4, 2)))[0]
            drawn.set_label(label)
            lines += [drawn] if sign == 1 else []
    if contact.wear is not None and contact.wear.any():
        depth = axes.twinx()
        lines += depth.plot(*line_of(line, contact.wear[line.nodes]), color=WORN, linewidth=1.0, label="worn depth [m]")
        frame(depth, "top")
        depth.tick_params(labelsize=8, direction="in", pad=-4, colors=WORN)
        for text in depth.get_yticklabels():
            text.set_horizontalalignment("right")
    axes.legend(
        handles=lines, loc="lower right", bbox_to_anchor=(1.01, 1.0), ncols=3, fontsize=8, frameon=False, borderpad=0.2
    )
    axes.set_ylabel("traction [Pa]", fontsize=9)
    low, high = axes.get_ylim()
    if not np.any(pressure) and not np.any(magnitude):
        axes.set_ylim(-1.0, 1.0)
    else:
        axes.set_ylim(low, high)
    frame(axes, "top", "right")
    axes.tick_params(labelbottom=False)
    band = sheet.axes(0.85, 0.65, 5.85, 0.14, sharex=axes)
    _status_band(band, line, contact.status[line.nodes])
    frame(band)
    band.set_yticks([])
    band.set_xlabel(line.label, fontsize=9)
    sheet.status_legend(band, loc="upper left", bbox_to_anchor=(-0.005, -1.6), borderpad=0)
    shown = line.place[focus(line.place[:, None], near[line.nodes])]
    margin = 0.01 * (float(np.ptp(shown)) or 1.0)
    axes.set_xlim(shown.min() - margin, shown.max() + margin)
    title, caption, numbers = head.split("\n")
    sheet.head(title, f"{caption}\n{numbers}", 0.85)
    return sheet.save(folder / f"contact_{name}.png")


def line_of(line: Line, values: AnyArray) -> tuple[Array, Array]:
    """Abscissa and ordinate of a curve, with NaN between the pieces of a line."""
    breaks = np.flatnonzero(line.starts)[1:]
    return np.insert(line.place, breaks, np.nan), np.insert(values, breaks, np.nan)


def _status_band(axes: Any, line: Line, status: NDArray[np.int8]) -> None:
    """Draw the status as a coloured band; each node colours the nearer halves of its facets."""
    for piece in np.split(np.arange(len(line.nodes)), np.flatnonzero(line.starts)[1:]):
        x = line.place[piece]
        borders = np.concatenate([x[:1], (x[1:] + x[:-1]) / 2, x[-1:]])
        bars = [(left, right - left) for left, right in pairwise(borders)]
        axes.broken_barh(bars, (0.0, 1.0), facecolors=[STATUS_COLOURS[int(s)] for s in status[piece]], linewidth=0)
    axes.set_ylim(0.0, 1.0)
