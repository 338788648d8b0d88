"""sensitivity.png: what numbers of the last step change by, with each number of the scene one deviation away."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from stickslip.geometry.units import SI, Units
from stickslip.solvers.results.step_result import StepResult, slopes_of, values
from stickslip.workflows.pictures.sheet import CURVES, INK, PALE, Sheet, frame

NAME = "sensitivity.png"
MOST = 12  # largest number of bars of a number
BAR = 0.2  # height of a bar [inch]
Swings = dict[str, tuple[float, float]]  # changes of a number by a smaller and by a larger number of the scene


def swings(step: StepResult, known: Mapping[str, float]) -> dict[str, Swings]:
    """Changes of the numbers of a step to first order, the largest first.

    Args:
        known: numbers of the scene: each goes one standard deviation to both sides, or one percent if none is said.
    """
    away = {by: abs(x) / 100 for by, x in known.items()} | {by: row[by] ** 0.5 for by, row in step.covariance.items()}
    found = dict[str, Swings]()
    for name, slopes in slopes_of(step).items():
        each = {by: (-low * away[by], high * away[by]) for by, (low, high) in slopes.items()}
        found[name] = dict(sorted(each.items(), key=lambda item: -max(map(abs, item[1]))))
    return found


def draw_tornado(
    path: Path, step: StepResult, known: Mapping[str, float], title: str, names: tuple[str, ...] = (), units: Units = SI
) -> Path | None:
    """Draw the swings of some numbers; None, without a file, if there are none.

    Args:
        known: see `swings`.
        names: of the numbers; empty: normal forces of contacts, and the elastic energy.

    Raises:
        MachineError: the disk is full.
    """
    every, now = swings(step, known), values(step)
    names = names or (*(f"{contact}.normal_force" for contact in step.contacts), "energy.stored")
    shown = {name: dict([*every[name].items()][:MOST]) for name in names if every.get(name)}
    if not shown:
        return None
    left, wide, room = 3.1, 3.6, 0.75  # [inch]
    heights = {name: BAR * len(bars) + 0.1 for name, bars in shown.items()}
    sheet = Sheet(left + wide + 0.4, sum(heights.values()) + room * len(shown) + 0.75, units=units)
    caption = "change to first order by one standard deviation of each number, or by 1 % where none is said:"
    sheet.head(title, f"{caption}\nblue where it is smaller, red where it is larger", 0.3)
    bottom = sheet.height - 0.75
    for name, bars in shown.items():
        bottom -= heights[name] + room
        axes, places = sheet.axes(left, bottom + 0.35, wide, heights[name]), range(len(bars))[::-1]
        axes.set_title(f"{name} = {now[name]:.5g}", fontsize=9, loc="left", color=INK)
        for side, colour in zip(zip(*bars.values(), strict=True), CURVES, strict=False):
            axes.barh(places, side, color=colour, height=0.7)
        frame(axes, "top", "right", "left")
        axes.set_yticks(places, [*bars])
        axes.axvline(0.0, color=PALE, linewidth=0.5)
    return sheet.save(path)
