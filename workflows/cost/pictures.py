"""cost_QUANTITY.png shows error against seconds and mesh size, cost_methods.png what methods side by side take."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from stickslip.geometry.units import SI, Units
from stickslip.workflows.cost.run_record import Run
from stickslip.workflows.cost.study import Study
from stickslip.workflows.cost.tables import Line, sentence
from stickslip.workflows.pictures.sheet import CURVES, INK, PALE, Sheet

MARKERS = {1: "^", 2: "s"}  # by order
BAND = "#ececec"
LINES: dict[int, Any] = {1: (0, (4, 2)), 2: "-"}
Number = Callable[[Run], float]
KINDS: tuple[tuple[str, Number], ...] = (
    ("seconds on one core, all phases", lambda run: run.seconds),
    ("volume solves", lambda run: run.volume_solves),
)


def draw(folder: Path, title: str, study: Study, units: Units = SI) -> Path:
    """Work-precision diagram on the left, convergence on the right; errors below the uncertainty are not shown.

    Raises:
        MachineError: the disk is full.
    """
    sheet = Sheet(10.0, 5.0, units=units)
    work, mesh = sheet.axes(0.85, 1.15, 4.9, 3.05), sheet.axes(6.85, 1.15, 2.95, 3.05)
    colours = _colours(run.rung.method for run in study.runs)
    shown = study.runs if study.truth.converges else ()
    for axes in (work, mesh):
        log_log(axes)
    for chain in dict.fromkeys(run.rung.chain for run in shown):
        mine = [run for run in shown if run.rung.chain == chain]
        _chain(work, [run for run in mine if not run.compiled], study, colours[chain[1]], lambda run: run.waited)
        tight = [run for run in mine if run.rung.tolerance == study.tolerance]
        _chain(mesh, tight, study, colours[chain[1]], lambda run: run.h)
    _front(work, study)
    _slopes(mesh, study)
    _limits(work, mesh, study, shown)
    work.set_xlabel(
        "seconds on one core that a user waits, start and estimate of errors included", fontsize=9, color=INK
    )
    work.set_ylabel(f"relative error of {study.truth.name}", fontsize=9, color=INK)
    mesh.set_xlabel("edge length of cells at the contact [m]", fontsize=9, color=INK)
    mesh.invert_xaxis()
    more = [Line2D([], [], color=INK, linewidth=3.5, alpha=0.25, label="Pareto front")]
    if any(run.rung.tolerance != study.tolerance for run in study.runs):
        look: dict[str, Any] = {"color": PALE, "marker": "o", "markerfacecolor": "white", "linestyle": "none"}
        more.insert(0, Line2D([], [], label="loose tolerance", **look))
    source = f"{study.truth.name} = {study.truth.value:.6g} ({study.truth.source})"
    sheet.head(title or study.truth.name, source, 0.85)
    _foot(sheet, colours, {run.rung.order for run in study.runs}, more, sentence(study))
    return sheet.save(folder / study.picture)


def _colours(methods: Iterable[str]) -> dict[str, str]:
    """A colour for each method."""
    names = dict.fromkeys(methods)
    return dict(zip(names, CURVES * len(names), strict=False))


def _foot(sheet: Sheet, colours: Mapping[str, str], orders: Collection[int], more: Sequence[Line2D], said: str) -> None:
    """Legend of methods and orders below the axes, and a sentence below that."""
    handles = [Line2D([], [], color=c, marker="o", markersize=5, linewidth=1.2, label=m) for m, c in colours.items()]
    for order in sorted(orders):
        look: dict[str, Any] = {"marker": MARKERS[order], "markersize": 5.5, "linestyle": LINES[order]}
        handles.append(Line2D([], [], color=PALE, label=f"order {order}", **look))
    handles += more
    sheet.figure.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(0.85 / sheet.width, 0.36 / sheet.height),
        ncols=len(handles), fontsize=8, frameon=False, borderpad=0, columnspacing=1.4,
    )  # fmt: skip
    if said:  # 118 bold letters of nine points fit into a line
        sheet.write(0.85, 0.16, said, fontsize=min(9.0, 9.0 * 118 / len(said)), fontweight="bold")


def log_log(axes: Any) -> None:
    """Both axes logarithmic, with a pale grid."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(True, which="major", color="#dddddd", linewidth=0.6, zorder=0)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_linewidth(0.6)
        spine.set_color(PALE)


def _chain(axes: Any, runs: Sequence[Run], study: Study, colour: str, place: Any) -> None:
    """Runs of one order and method: joined from mesh to mesh, pale where the tolerance is loose."""
    tight = sorted((run for run in runs if run.rung.tolerance == study.tolerance), key=lambda run: run.rung.level)
    order = runs[0].rung.order if runs else 1
    for k, (group, filled) in enumerate(((tight, True), ([r for r in runs if r not in tight], False))):
        axes.plot(
            [place(run) for run in group],
            [max(study.errors[run.rung], study.truth.uncertainty) for run in group],
            color=colour,
            linestyle=LINES[order] if filled else "none",
            linewidth=1.0,
            marker=MARKERS[order],
            markersize=5.5 if filled else 4.5,
            markerfacecolor=colour if filled else "white",
            markeredgewidth=0.9,
            zorder=4 - k,
        )


def _front(axes: Any, study: Study) -> None:
    """The smallest error for a given time, as a staircase."""
    if study.front:
        x = [run.waited for run in study.front]
        y = [study.sturdy[run.rung] for run in study.front]
        axes.step([*x, 3 * x[-1]], [*y, y[-1]], where="post", color=INK, linewidth=3.5, alpha=0.25, zorder=2)


def _slopes(axes: Any, study: Study) -> None:
    """A triangle with the observed power of h beside the finest runs of each order, clear of the others.

    As factors it is 1.8 wide, and 1.7 from the points.
    """
    finest: dict[int, tuple[Run, float]] = {}
    for chain, rate in study.rates.items():
        known = [r for r in study.runs if study.known(r.rung)]
        tight = [r for r in known if r.rung.chain == chain and r.rung.tolerance == study.tolerance]
        run = min(tight, key=lambda r: r.h)
        if chain[0] not in finest or run.h < finest[chain[0]][0].h:
            finest[chain[0]] = run, rate
    for order, (run, rate) in finest.items():
        other = [study.errors[r.rung] / r.h for o, (r, _) in finest.items() if o != order]
        above = any(study.errors[run.rung] / run.h > each for each in other)
        h, wide, rise = run.h, 1.8 * run.h, 1.8**rate
        level = study.errors[run.rung] * (rise * 1.7 if above else 1 / 1.7)
        x, y = ([h, wide, h, h], [level, level, level / rise, level]) if above else (
            [h, wide, wide, h], [level, level, level * rise, level])  # fmt: skip
        axes.plot(x, y, color=PALE, linewidth=0.8, zorder=1)
        text, place = f"order {order}: h$^{{{rate:.1f}}}$", (np.sqrt(h * wide), level)
        axes.annotate(text, place, (0, 3 if above else -3), textcoords="offset points", ha="center",
                      va="bottom" if above else "top", fontsize=8, color=INK)  # fmt: skip


def _limits(work: Any, mesh: Any, study: Study, shown: Sequence[Run]) -> None:
    """Axis limits around the points, and the band of errors below the uncertainty."""
    errors = [max(study.errors[run.rung], study.truth.uncertainty) for run in shown]
    if not errors:
        work.text(0.5, 0.5, "does not settle", transform=work.transAxes, ha="center", fontsize=9, color=PALE)
        return
    sure = study.truth.uncertainty
    for axes in (work, mesh):
        low = _y_axis(axes, errors, 8, 2.5)
        if sure > low:
            axes.axhspan(low, sure, color=BAND, zorder=0)
    if sure > low:
        text = "grey and its edge: uncertainty of the reference"
        work.text(0.99, 0.015, text, transform=work.transAxes, ha="right", va="bottom", fontsize=8, color=PALE)
    for level, name in ((0.01, "1 %"), (0.001, ".1 %"), (study.time_step or 0.0, "time steps")):
        if low < level < max(errors) * 2.5:
            work.axhline(level, color=PALE, linewidth=0.8, linestyle=":" if name == "time steps" else "-", zorder=1)
            place = (0.01, level)
            work.annotate(name, place, (0, 2), xycoords=("axes fraction", "data"), textcoords="offset points",
                          fontsize=8, color=PALE)  # fmt: skip
    x = [run.waited for run in shown]
    work.set_xlim(min(x) / 1.5, max(x) * 1.8)


def _y_axis(axes: Any, values: Sequence[float], below: float, above: float) -> float:
    """Limits around the values, by factors; labels are plain numbers where these span two decades at most."""
    low, high = min(values), max(values)
    axes.set_ylim(low / below, high * above)
    axes.yaxis.set_minor_formatter(NullFormatter())
    if high < 100 * low:
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    return low / below


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
    colours, orders = _colours(methods), {line.order for line in found}
    for left, (name, number) in zip((0.85, 5.75), KINDS, strict=True):
        axes = sheet.axes(left, 1.15, 4.0, 3.05)
        log_log(axes)
        for k, method in enumerate(methods):
            for order in sorted(orders):
                runs = [run for line in found if line.order == order and (run := line.runs[k]) and run.converged]
                axes.plot(
                    [run.h for run in runs], [number(run) or None for run in runs], color=colours[method],
                    linestyle=LINES[order], linewidth=1.0, marker=MARKERS[order], markersize=5.5,
                )  # fmt: skip
        known = [x for line in found for run in line.runs if run and run.converged and (x := number(run)) > 0]
        if known:
            _y_axis(axes, known, 1.6, 1.6)
        axes.set_xlabel("edge length of cells at the contact [m]", fontsize=9, color=INK)
        axes.set_ylabel(name, fontsize=9, color=INK)
        axes.invert_xaxis()
    sheet.head(title or "Methods side by side", "methods side by side on the same meshes", 0.85)
    _foot(sheet, colours, orders, (), said)
    return sheet.save(folder / "cost_methods.png")
