"""contact_NAME.png of a plane model: tractions and status along the contact line."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.geometry.arrays import AnyArray, Array, Ints
from stickslip.geometry.units import SI, Units
from stickslip.solvers.results.step_result import OPEN, ContactState
from stickslip.workflows.formats.contact_line import Line, walk
from stickslip.workflows.pictures.focus import focus
from stickslip.workflows.pictures.sheet import LINE, PALE, STATUS_COLOURS, Sheet, frame

PRESSURE, TANGENTIAL = "#1b1b1b", "#b2182b"


def draw_line(
    folder: Path, name: str, points: Array, facets: Ints, contact: ContactState, head: str, units: Units = SI
) -> Path:
    """Draw pressure, tangential traction with the friction bound, and the status: open, slip or stick."""
    line = walk(points, facets)
    pressure = contact.pressure[line.nodes]
    tangential = np.einsum("ki,ki->k", contact.traction[line.nodes], line.tangents)
    magnitude = np.linalg.norm(contact.traction[line.nodes], axis=1)
    bound = np.where(np.isfinite(contact.bound), contact.bound, np.nan)[line.nodes]
    sheet = Sheet(7.0, 4.0 + LINE, units=units)
    axes = sheet.axes(0.85, 0.87, 5.85, 2.23)
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
    shown = line.place[focus(line.place[:, None], contact.status[line.nodes] != OPEN)]
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
