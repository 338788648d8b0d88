"""Curves over time, each with a band for its error, as points of a drawing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import ROUNDING, Array, Bools
from stickslip.workflows.pictures.sheet import CURVES

WIDTH, HEIGHT = 460, 190  # of the drawing
LEFT, RIGHT, TOP, BOTTOM = 58, 12, 8, 24  # margins
FEW = 30  # points: so many are marked
SLIGHT = 0.02  # of the height: so little on the other side of zero needs no axis there
MOST = len(CURVES)  # curves in a panel


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Values over time; NaN: not known."""

    name: str
    values: Array  # (t,)
    error: Array  # (t,)


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A curve as points of the drawing."""

    name: str
    colour: str
    band: list[tuple[float, float]]  # around what its error leaves; empty: not known
    line: list[tuple[float, float]]
    marks: list[tuple[float, float]]


@dataclass(frozen=True, kw_only=True)
class Panel:
    """A drawing of curves: its labels with their places, and the curves."""

    name: str  # of the numbers, with their unit
    label: str  # the same with the power of ten that the numbers of the axis leave out
    levels: list[tuple[float, str]]
    times: list[tuple[float, str]]
    curves: list[Drawn]
    width: int = WIDTH
    height: int = HEIGHT
    left: int = LEFT
    right: int = WIDTH - RIGHT


def panel(name: str, times: Array, curves: Sequence[Curve]) -> Panel | None:
    """Draw these curves, those that stay zero left out; None if none is left, or there is one step alone."""
    size = max((_largest(curve) for curve in curves), default=0.0)
    shown = [curve for curve in curves if _largest(curve) > ROUNDING * size][:MOST]
    if len(times) < 2 or not shown:
        return None
    reach = [c.values + sign * np.nan_to_num(c.error) for c in shown for sign in (-1, 1)]
    low, high = float(min(0.0, np.nanmin(reach))), float(max(0.0, np.nanmax(reach)))
    low, high = (0.0 if abs(end) < SLIGHT * (high - low) else end for end in (low, high))
    ticks, power = _ticks(low, high)
    low, high = ticks[0], ticks[-1]
    end = float(times[-1])
    along = [tick for tick in _ticks(0.0, end)[0] if tick <= end * (1 + ROUNDING)]

    def x(time: Array) -> Array:
        return LEFT + (WIDTH - LEFT - RIGHT) * time / end

    def y(values: Array) -> Array:
        return TOP + (HEIGHT - TOP - BOTTOM) * (high - values) / (high - low)

    def points(values: Array, known: Bools) -> list[tuple[float, float]]:
        return [*zip(x(times)[known].tolist(), y(values)[known].tolist(), strict=True)]

    drawn = []
    for curve, colour in zip(shown, CURVES, strict=False):
        known = np.isfinite(curve.values)
        sure = known & np.isfinite(curve.error)
        line = points(curve.values, known)
        band = points(curve.values + curve.error, sure) + points(curve.values - curve.error, sure)[::-1]
        marks = line if len(times) <= FEW else []
        drawn.append(Drawn(name=curve.name, colour=colour, band=band, line=line, marks=marks))
    return Panel(
        name=name,
        label=name.replace("[", f"[10{_raised(power)} ") if power else name,
        levels=[(float(y(np.array(tick))), f"{tick / 10**power:.4g}") for tick in ticks],
        times=[(float(x(np.array(tick))), f"{tick:.4g}") for tick in along],
        curves=drawn,
    )


def _largest(curve: Curve) -> float:
    return float(np.nanmax(np.abs(np.append(curve.values, 0.0))))


def _ticks(low: float, high: float) -> tuple[list[float], int]:
    """About five round numbers that span the range, and the power of ten to write them with.

    >>> _ticks(0.0, 0.0243)
    ([0.0, 0.005, 0.01, 0.015, 0.02, 0.025], -3)
    """
    width = high - low or 1.0
    decade = 10.0 ** math.floor(math.log10(width / 5))
    step = next(factor * decade for factor in (1, 2, 2.5, 5, 10) if factor * decade >= width / 6)
    first, last = math.floor(low / step + ROUNDING), math.ceil(high / step - ROUNDING)
    ticks = [float(f"{k * step:.12g}") for k in range(first, last + 1)]
    exponent = math.floor(math.log10(max(abs(low), abs(high)) or 1.0))
    power = 0 if -2 < exponent < 4 else 3 * math.floor(exponent / 3)
    return ticks, power


def _raised(power: int) -> str:
    """
    >>> _raised(-3)
    '⁻³'
    """
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
