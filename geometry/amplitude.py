"""A value in time: a number ramped from zero, or a table that is piecewise linear."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from stickslip.geometry.arrays import ROUNDING
from stickslip.geometry.errors import require

Amplitude = float | tuple[tuple[float, float], ...]


def value_at(amplitude: Amplitude, time: float, end: float) -> float:
    """Value at `time`: a bare number is reached at `end`; a table starts from 0 at t = 0 unless it lists t = 0.

    >>> value_at(4.0, 0.5, end=2.0)
    1.0
    >>> [value_at(((1.0, -0.1), (3.0, 0.3)), t, end=4.0) for t in (0.5, 2.0, 9.0)]
    [-0.05, 0.1, 0.3]
    """
    if isinstance(amplitude, float | int):
        return float(amplitude) * min(time / end, 1.0)
    table = amplitude if amplitude[0][0] == 0.0 else ((0.0, 0.0), *amplitude)
    times, values = np.array(table).T
    return float(np.interp(time, times, values))


def listed_times(amplitude: Amplitude) -> tuple[float, ...]:
    """Times that a table lists; a bare number lists none."""
    return () if isinstance(amplitude, float | int) else tuple(t for t, _ in amplitude)


def turns(amplitude: Amplitude, end: float) -> tuple[float, ...]:
    """Times at which the rate of change changes; a straight line may be listed in many pieces.

    >>> turns(((1.0, 0.1), (2.0, 0.2), (3.0, -0.1)), end=4.0), turns(0.5, end=4.0)
    ((0.0, 2.0, 3.0), (0.0, 4.0))
    """
    table = ((0.0, 0.0), (end, float(amplitude))) if isinstance(amplitude, float | int) else amplitude
    times, values = np.array(table if table[0][0] == 0.0 else ((0.0, 0.0), *table)).T
    rates = np.concatenate([[0.0], np.diff(values) / np.diff(times), [0.0]])
    # of the largest rate: by so much the pieces of a straight line differ
    found = times[np.abs(np.diff(rates)) > ROUNDING * np.abs(rates).max()]
    return tuple(found.tolist())


def check(amplitude: Amplitude, key: str) -> None:
    """Refuse a table that is empty or whose times do not increase from 0 on."""
    if isinstance(amplitude, float | int):
        return
    times = listed_times(amplitude)
    require(len(times) > 0, key, "[]", "a table needs at least one [time, value]")
    increasing = all(a < b for a, b in pairwise(times))
    require(times[0] >= 0 and increasing, key, list(times), "times must increase, from 0 or later")
