"""slip_NAME.png: slip and slip rate over place and time, of contacts whose friction knows its rate."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import LogNorm, Normalize

from stickslip.geometry.arrays import ROUNDING, TINY, Array, Ints
from stickslip.geometry.units import Units
from stickslip.solvers.results.step_result import MeshData
from stickslip.workflows.formats.contact_line import walk
from stickslip.workflows.formats.steps import read_step, step_files
from stickslip.workflows.pictures.history import LEFT
from stickslip.workflows.pictures.sheet import COLOURS, DPI, INK, Sheet, frame

BESIDE = 3  # largest number of nodes side by side of a strip one cell wide, which is drawn as a line
WIDE = 5.0  # of a panel [inch], half as high


def draw_slip(folder: Path, mesh: MeshData, title: str, units: Units) -> list[Path]:
    """Draw the course of slip and of its rate along each contact that has one, of at least three steps. Rank 0 only.

    A contact in space is drawn where it is a strip one cell wide. Steps follow each other in even distances: a clock's
    are longer by ten decades between events than in them.

    Raises:
        MachineError: the disk is full, or a step cannot be read.
    """
    files = list(step_files(folder).values())
    most = min(len(files), round(WIDE * DPI))  # a column of pixels for each
    kept = sorted(set(np.linspace(0, len(files) - 1, most, dtype=int)))
    if len(kept) < 3 or not any(c.rate is not None for c in read_step(files[0]).contacts.values()):
        return []
    steps, drawn = [read_step(files[k]) for k in kept], list[Path]()
    times = np.array([step.time for step in steps])
    for name, (points, facets, _) in mesh.surfaces.items():
        found, line = [step.contacts[name] for step in steps], _line(points, facets)
        rates = [each.rate for each in found if each.rate is not None]
        if line is None or not rates:
            continue
        place, mean, label = line
        slip = np.array([mean @ np.linalg.norm(each.slip, axis=1) for each in found])
        rate = np.array(rates) @ mean.T
        drawn.append(_draw(folder / f"slip_{name}.png", times, place, slip, rate, label, (title, name), units))
    return drawn


def _line(points: Array, facets: Ints) -> tuple[Array, Array, str] | None:
    """Abscissa (k,) [m], averages (k, n) of the nodes there, and the label; None: it is no line."""
    if points.shape[1] == 2:
        line = walk(points, facets)
        return line.place, np.eye(len(points))[line.nodes], line.label
    along = int(np.argmax(np.ptp(points, axis=0)))
    size = max(float(np.ptp(points[:, along])), TINY)
    place, at = np.unique(np.round(points[:, along] / size, 9), return_inverse=True)
    beside = np.bincount(at)
    if beside.max() > BESIDE:
        return None
    return place * size, (at == np.arange(len(place))[:, None]) / beside[:, None], f"{'xyz'[along]} [m]"


def _draw(
    path: Path, times: Array, place: Array, slip: Array, rate: Array, label: str, names: tuple[str, str], units: Units
) -> Path:
    """Draw both panels; slip [m] and rate [m/s] are (steps, k)."""
    beside, high, above = LEFT + WIDE + 0.15, WIDE / 2, WIDE / 2 + 1.2
    sheet, norm = Sheet(beside + 0.95, above + high + 0.8, units=units), Normalize(float(times[0]), float(times[-1]))
    upper, lower = (sheet.axes(LEFT, bottom, WIDE, high) for bottom in (above, 0.6))
    for time, values in zip(times, slip, strict=True):
        upper.plot(place, values, color=colormaps[COLOURS](norm(time)), linewidth=0.8)
    upper.set_xlabel(label, fontsize=9, color=INK)
    upper.set_ylabel("slip [m]", fontsize=9, color=INK)
    sheet.colour_bar(sheet.axes(beside, above, 0.13, high), norm, "time [s]", orientation="vertical")
    largest = max(float(rate.max()), TINY)
    least = float(rate.min(where=rate > ROUNDING * largest, initial=largest))
    fast, order = LogNorm(least, largest if largest > least else 10 * least), np.argsort(place, kind="stable")
    shown = np.maximum(rate[:, order].T, least)
    lower.pcolormesh(np.arange(1, len(times) + 1), place[order], shown, norm=fast, cmap=COLOURS, shading="nearest")
    lower.set_xlabel("step that is shown", fontsize=9, color=INK)
    lower.set_ylabel(label, fontsize=9, color=INK)
    bar = sheet.axes(beside, 0.6, 0.13, high)
    sheet.colour_bar(bar, fast, "slip rate [m/s]", orientation="vertical")
    for axes in (upper, lower):
        frame(axes, "top", "right")
    sheet.head(names[0], f"contact {names[1]}: slip since t = 0, and its rate, step by step", LEFT)
    return sheet.save(path)
