"""force_displacement.png: force against motion, for supports and obstacles that move, and flat frictional contacts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize

from stickslip.geometry.arrays import ROUNDING, SLIGHT, Array
from stickslip.geometry.obstacles.obstacle import unit
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.pictures.sheet import COLOURS, INK, PALE, Sheet, frame

MOST = 3  # largest number of panels in a row
FEW = 80  # largest number of steps with a mark for each
Columns = Mapping[str, Array]


@dataclass(frozen=True)
class Panel:
    """A force (steps,) over a motion (steps,); the line has a gap where the motion is NaN (not defined)."""

    title: str
    x: Array
    y: Array
    x_label: str
    y_label: str

    @property
    def swing(self) -> float:
        """Largest minus smallest force."""
        return float(np.ptp(self.y))

    @property
    def travel(self) -> float:
        """Largest minus smallest motion."""
        return _travel(self.x)


def draw_loops(folder: Path, scene: Scene, columns: Columns, title: str) -> Path | None:
    """Draw force_displacement.png; returns None, without a file, if no force does work.

    Args:
        columns: see `read_steps_table`.

    Raises:
        MachineError: the disk is full.
    """
    steps = from_rest(columns)
    rows = [largest([p for p in of(scene, steps) if p.travel > 0]) for of in (driving, sliding)]
    rows = [row for row in rows if row]
    if not rows:
        return None
    across, time = max(map(len, rows)), steps["time"]
    left, pitch, high = 0.95, 3.45, 3.2 * len(rows) - 1.0  # [inch] of panels of 2.45 by 2.2
    sheet = Sheet(left + across * pitch + 0.45, high + 1.7, units=scene.labels)
    norm = Normalize(0.0, float(time[-1]))
    for i, row in enumerate(rows):
        for k, panel in enumerate(row):
            _draw(sheet.axes(left + k * pitch, sheet.height - 3.3 - 3.2 * i, 2.45, 2.2), panel, time, norm)
    bar = sheet.axes(left + across * pitch - 0.55, 0.6, 0.13, high)
    sheet.colour_bar(bar, norm, "time [s]", orientation="vertical")
    sheet.head(title, "force against motion; a loop's area is work", left)
    return sheet.save(folder / "force_displacement.png")


def from_rest(columns: Columns) -> dict[str, Array]:
    """The columns with a first row of zeros at t = 0, unless t = 0 is a step."""
    first = columns["time"][0] == 0
    return dict(columns) if first else {name: np.concatenate([[0.0], values]) for name, values in columns.items()}


def largest(panels: Sequence[Panel]) -> list[Panel]:
    """The panels whose force varies most, in their original order."""
    swings = sorted((panel.swing for panel in panels), reverse=True)
    # relative to the largest variation: forces that vary less are not drawn
    least = max(swings[min(MOST, len(swings)) - 1], SLIGHT * swings[0]) if swings else 0.0
    return [panel for panel in panels if panel.swing >= least > 0][:MOST]


def per_metre(scene: Scene, unit_of_it: str) -> str:
    """Unit of a resultant: plane models report resultants per metre of thickness.

    >>> import stickslip
    >>> [per_metre(stickslip.read(name), "N") for name in ("block", "cube")]
    ['N/m', 'N']
    """
    return f"{unit_of_it}/m" if scene.model.startswith("plane") else unit_of_it


def driving(scene: Scene, steps: Columns) -> Iterator[Panel]:
    """Force or moment of each support and obstacle over its motion."""
    force, moment = per_metre(scene, "N"), per_metre(scene, "N m")
    for table, name, axis in (
        *(("support", name, axis) for name, support in scene.supports.items() for axis in support.displacement),
        *(("obstacle", name, axis) for name in scene.obstacles for axis in "xyz"[: scene.dim]),
    ):
        # a normal is no component of the force, and what an expression prescribes has no column
        if axis != "normal" and f"{table}.{name}.displacement.{axis}" in steps:
            x, y = (steps[f"{table}.{name}.{key}.{axis}"] for key in ("displacement", "force"))
            yield Panel(f"{table} {name}", x, y, f"displacement, {axis} [m]", f"force, {axis} [{force}]")
    for name, obstacle in scene.obstacles.items():
        if obstacle.rotation is not None:
            axis_of_it = dict(zip("xyz", unit(obstacle.rotation.axis or (0.0, 0.0, 1.0)), strict=True))
            about = [a * steps[f"obstacle.{name}.moment.{k}"] for k, a in axis_of_it.items() if a]
            x, y = steps[f"obstacle.{name}.rotation.angle"], np.sum(about, axis=0)
            yield Panel(f"obstacle {name}", x, y, "rotation [rad]", f"moment about its axis [{moment}]")


def sliding(scene: Scene, steps: Columns) -> Iterator[Panel]:
    """Flat contacts with friction: the friction force of `surface` on the other side, over the mean slip."""
    for name, contact in scene.pairs.items():
        flat = contact.friction is not None and _is_flat(name, scene, steps)
        for axis in "xyz"[: scene.dim] if flat else "":
            # relative to the motion: smaller slips count as zero
            if _travel(steps[f"{name}.slip.{axis}"]) <= ROUNDING * _motion(name, steps):
                continue
            x, y = steps[f"{name}.slip.{axis}"], -steps[f"{name}.tangential_force.{axis}"]
            other = f"on {contact.against}, {axis}"
            yield Panel(
                f"contact {name}", x, y, f"mean slip, {axis} [m]", f"friction {other} [{per_metre(scene, 'N')}]"
            )


def _travel(x: Array) -> float:
    known = x[np.isfinite(x)]
    return float(np.ptp(known)) if len(known) else 0.0


def _motion(contact: str, steps: Columns) -> float:
    """Scale of motions [m]: largest work divided by the largest normal force."""
    return float(np.abs(steps["energy.external"]).max() / np.abs(steps[f"{contact}.normal_force"]).max())


def _is_flat(contact: str, scene: Scene, steps: Columns) -> bool:
    """Whether a contact is so flat that its resultant is 90 % and more of the sum of the forces at its points."""
    normal, tangential = (steps[f"{contact}.{key}_force"] for key in ("normal", "tangential"))
    resultant = np.linalg.norm([steps[f"{contact}.force.{axis}"] for axis in "xyz"[: scene.dim]], axis=0)
    k = int(np.argmax(normal))
    return bool(resultant[k] >= 0.9 * np.hypot(normal[k], tangential[k]) > 0)


def _draw(axes: Any, panel: Panel, time: Array, norm: Normalize) -> None:
    points = np.column_stack([panel.x, panel.y])
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    whole = np.isfinite(pieces).all(axis=(1, 2))
    lines = LineCollection(list(pieces[whole]), cmap=COLOURS, norm=norm, linewidth=1.4)
    lines.set_array(time[1:][whole])
    for zero in (axes.axhline, axes.axvline):
        zero(0.0, color=PALE, linewidth=0.5)
    axes.add_collection(lines)
    if len(time) <= FEW:
        axes.scatter(panel.x, panel.y, c=time, cmap=COLOURS, norm=norm, s=7, zorder=3, linewidth=0)
    axes.set_title(panel.title, fontsize=9, loc="left", color=INK)
    axes.set_xlabel(panel.x_label, fontsize=9, color=INK)
    axes.set_ylabel(panel.y_label, fontsize=9, color=INK)
    axes.margins(0.06)
    axes.autoscale_view()
    frame(axes, "top", "right")
