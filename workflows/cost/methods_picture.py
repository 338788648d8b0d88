"""cost_methods.png: seconds and volume solves of methods that are laid side by side, against the mesh size, log-log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from stickslip.geometry.units import SI, Units
from stickslip.workflows.cost.picture import DECADES, LETTERS, LINES, MARKERS, log_log
from stickslip.workflows.cost.run_record import Run
from stickslip.workflows.cost.side_by_side import Line
from stickslip.workflows.pictures.sheet import CURVES, INK, PALE, Sheet

ROOM = 1.6  # factor beyond the smallest and the largest value
Number = Callable[[Run], float]
KINDS: tuple[tuple[str, Number], ...] = (
    ("seconds on one core, all phases", lambda run: run.seconds),
    ("volume solves", lambda run: run.volume_solves),
)


def draw_methods(
    folder: Path, title: str, found: Sequence[Line], methods: Sequence[str], said: str, units: Units = SI
) -> Path:
    """Seconds on the left, volume solves on the right; a mesh that a method did not solve is left out.

    Args:
        said: the comparison in one sentence.

    Raises:
        MachineError: the disk is full.
    """
    sheet = Sheet(10.0, 5.0, units=units)
    colours = dict(zip(methods, CURVES * len(methods), strict=False))
    orders = sorted({line.order for line in found})
    for left, (name, number) in zip((0.85, 5.75), KINDS, strict=True):
        axes = sheet.axes(left, 1.15, 4.0, 3.05)
        log_log(axes)
        for k, method in enumerate(methods):
            for order in orders:
                runs = [run for line in found if line.order == order and (run := line.runs[k]) and run.converged]
                axes.plot(
                    [run.h for run in runs], [number(run) or None for run in runs], color=colours[method],
                    linestyle=LINES[order], linewidth=1.0, marker=MARKERS[order], markersize=5.5,
                )  # fmt: skip
        _y_axis(axes, [number(run) for line in found for run in line.runs if run and run.converged])
        axes.set_xlabel("edge length of cells at the contact [m]", fontsize=9, color=INK)
        axes.set_ylabel(name, fontsize=9, color=INK)
        axes.invert_xaxis()
    handles = [Line2D([], [], color=colours[m], marker="o", markersize=5, linewidth=1.2, label=m) for m in methods]
    handles += [Line2D([], [], color=PALE, marker=MARKERS[o], linestyle=LINES[o], label=f"order {o}") for o in orders]
    sheet.figure.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(0.85 / sheet.width, 0.36 / sheet.height),
        ncols=len(handles), fontsize=8, frameon=False, borderpad=0, columnspacing=1.4,
    )  # fmt: skip
    sheet.head(title or "Methods side by side", "methods side by side on the same meshes", 0.85)
    if said:
        sheet.write(0.85, 0.16, said, fontsize=min(9.0, 9.0 * LETTERS / len(said)), fontweight="bold")
    return sheet.save(folder / "cost_methods.png")


def _y_axis(axes: Any, values: Sequence[float]) -> None:
    """Limits around the values, and labels that are plain numbers where these span few decades."""
    known = [value for value in values if value > 0]
    if not known:
        return
    axes.set_ylim(min(known) / ROOM, max(known) * ROOM)
    axes.yaxis.set_minor_formatter(NullFormatter())
    if max(known) < DECADES * min(known):
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
