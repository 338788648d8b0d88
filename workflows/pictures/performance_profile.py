"""Performance profiles: the share of problems that each method solves within a factor of the fastest one.

Source: Dolan & Moré, Math. Program. 91 (2002).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.ticker import PercentFormatter

from stickslip.geometry.arrays import Array
from stickslip.workflows.pictures.sheet import CURVES, INK, Sheet, frame

CLOCK = 1e-3  # [s] smaller times count as this: they are those of the interpreter
FACTORS = (1.0, 2.0, 5.0, 10.0, 100.0)  # columns of the table
Seconds = Mapping[str, Sequence[float]]  # by method, of each problem; inf: not solved


def ratios(seconds: Seconds) -> dict[str, Array]:
    """Time of each method by that of the fastest (problems,); inf where it did not solve the problem.

    >>> ratios({"a": [1.0, 4.0], "b": [2.0, np.inf]})
    {'a': array([1., 1.]), 'b': array([ 2., inf])}
    """
    times = np.maximum(np.array(list(seconds.values()), np.float64), CLOCK)
    best = times.min(axis=0)
    found = np.full_like(times, np.inf)
    np.divide(times, best, out=found, where=np.isfinite(times))
    return dict(zip(seconds, found, strict=True))


def shares(seconds: Seconds) -> dict[str, list[float]]:
    """Share of all problems that each method solves within each of `FACTORS`, and at all.

    >>> shares({"a": [1.0, 4.0], "b": [2.0, np.inf]})["b"]
    [0.0, 0.5, 0.5, 0.5, 0.5, 0.5]
    """
    limits = (*FACTORS, np.finfo(float).max)
    return {name: [float((found <= limit).mean()) for limit in limits] for name, found in ratios(seconds).items()}


def draw_profile(path: Path, title: str, seconds: Seconds) -> Path:
    """Draw the share of problems against the factor, a step curve a method.

    Raises:
        MachineError: the disk is full.
    """
    found = ratios(seconds)
    known = np.concatenate([values[np.isfinite(values)] for values in found.values()])
    end = 1.2 * max(10.0, float(known.max(initial=1.0)))
    sheet = Sheet(7.0, 4.2)
    axes = sheet.axes(0.75, 0.6, 4.3, 2.85)
    for name, colour in zip(found, CURVES * len(found), strict=False):
        reached = np.sort(found[name][np.isfinite(found[name])])
        share = [k / len(found[name]) for k in range(1, len(reached) + 1)]
        x, y = (
            np.concatenate([[1.0], reached, [end]]),
            np.concatenate([[0.0], share, share[-1:] if len(share) else [0]]),
        )
        axes.step(x, y, where="post", color=colour, linewidth=1.3, label=name)
    frame(axes)
    axes.set_xscale("log")
    axes.set_xlim(1.0, end)
    axes.set_ylim(0.0, 1.03)
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    axes.set_xlabel("time, by that of the fastest method", fontsize=9, color=INK)
    axes.set_ylabel("problems solved", fontsize=9, color=INK)
    axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), fontsize=8, frameon=False)
    sheet.head(title, f"performance profile; times below {CLOCK:g} s count as {CLOCK:g} s", 0.75)
    return sheet.save(path)
