"""Time and memory that a run will need: a log-log fit of earlier runs of the same order and method."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from stickslip.workflows.cost.run_record import Run
from stickslip.workflows.cost.rung import RATIO, Rung

WINDOW = 3  # of the finest runs
UNTRIED = 1.0  # seconds of the first run of all
START = 2.0  # seconds in which a process starts and compiles nothing
ANOTHER = 1.5  # assumed factor on the time of the same mesh with another method or a lower order


def power_law(values: Mapping[int, float], at: float, least: float, most: float) -> float:
    """The value at a level, by a power of the cell size between `least` and `most` through the finest of all.

    A single value gives no power: the least one is taken, because the coarsest mesh is all overhead.

    >>> round(power_law({0: 1.0, 2: 4.0, 4: 16.0}, 6, 1.0, 9.0), 9)  # twice as fine every two levels: power 2
    64.0
    >>> round(power_law({0: 1.0}, 2, 3.0, 9.0), 9)
    8.0
    """
    levels = sorted(values)[-WINDOW:]
    x, y = np.array(levels) * np.log(RATIO), np.log([values[level] for level in levels])
    power = np.polyfit(x, y, 1)[0] if len(levels) > 1 else least
    return float(np.exp(y[-1] + np.clip(power, least, most) * (at * np.log(RATIO) - x[-1])))


def overhead(runs: Sequence[Run]) -> float:
    """Time of a process outside its phases [s]."""
    found = [run.spent - run.seconds for run in runs if run.converged and not run.compiled]
    return float(np.median(found)) if found else START


def seconds(rung: Rung, runs: Sequence[Run], dim: int) -> float:
    """Part of the budget that this rung will take [s]; coarse meshes are all overhead, so a small power may fit."""
    return overhead(runs) + _phases(rung, [run for run in runs if run.phases], dim)


def memory(rung: Rung, runs: Sequence[Run], dim: int) -> float:
    """Peak memory [bytes]; unknown for a chain without a run."""
    mine = [run for run in runs if run.rung.chain == rung.chain and run.memory]
    if not mine:
        return 0.0
    return power_law(_by_level(mine, lambda run: run.memory), rung.level, 0.0, 2.0 * dim)


def _phases(rung: Rung, runs: Sequence[Run], dim: int) -> float:
    mine = [run for run in runs if run.rung.chain == rung.chain]
    same = [run.seconds for run in mine if run.rung.level == rung.level]
    if same:  # of a tighter tolerance
        return max(same)
    tight = [run for run in mine if run.rung.tolerance <= rung.tolerance]
    if tight:
        return power_law(_by_level(tight, lambda run: run.seconds), rung.level, dim / 2, 3.0 * dim)
    near = [run for run in runs if run.rung.level == rung.level]
    return max((ANOTHER * run.seconds for run in near), default=UNTRIED)


def _by_level(runs: Sequence[Run], number: Callable[[Run], float]) -> dict[int, float]:
    """The largest of the runs on each level."""
    found: dict[int, float] = {}
    for run in runs:
        found[run.rung.level] = max(number(run), found.get(run.rung.level, 0.0))
    return found
