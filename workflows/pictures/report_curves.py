"""Curves over time as SVG, each with a band for its error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from stickslip.geometry.arrays import ROUNDING, Array
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


def panel(label: str, times: Array, curves: Sequence[Curve]) -> str:
    """A figure with these curves, those that stay zero left out; empty if none is left, or there is one step alone."""
    size = max((_largest(curve) for curve in curves), default=0.0)
    shown = [curve for curve in curves if _largest(curve) > ROUNDING * size][:MOST]
    if len(times) < 2 or not shown:
        return ""
    reach = [c.values + sign * np.nan_to_num(c.error) for c in shown for sign in (-1, 1)]
    low, high = float(min(0.0, np.nanmin(reach))), float(max(0.0, np.nanmax(reach)))
    low, high = (0.0 if abs(end) < SLIGHT * (high - low) else end for end in (low, high))
    ticks, power = _ticks(low, high)
    low, high = ticks[0], ticks[-1]
    along, _ = _ticks(0.0, float(times[-1]))
    x = LEFT + (WIDTH - LEFT - RIGHT) * times / times[-1]

    def y(values: Array) -> Array:
        return TOP + (HEIGHT - TOP - BOTTOM) * (high - values) / (high - low)

    drawn = []
    for tick, height in zip(ticks, y(np.array(ticks)), strict=True):
        drawn.append(f'<path class="grid" d="M{LEFT} {height:.1f}H{WIDTH - RIGHT}"/>')
        drawn.append(f'<text x="{LEFT - 6}" y="{height + 4:.1f}" text-anchor="end">{tick / 10**power:.4g}</text>')
    for tick in (tick for tick in along if tick <= times[-1] * (1 + ROUNDING)):
        place = LEFT + (WIDTH - LEFT - RIGHT) * tick / times[-1]
        drawn.append(f'<text x="{place:.1f}" y="{HEIGHT - 6}" text-anchor="middle">{tick:.4g}</text>')
    for curve, colour in zip(shown, CURVES, strict=False):
        known = np.isfinite(curve.values)
        if (sure := known & np.isfinite(curve.error)).any():
            edges = [*zip(x[sure], y(curve.values + curve.error)[sure], strict=True)]
            edges += [*zip(x[sure], y(curve.values - curve.error)[sure], strict=True)][::-1]
            drawn.append(f'<path d="M{_path(edges)}Z" fill="{colour}" opacity=".22"/>')
        line = [*zip(x[known], y(curve.values)[known], strict=True)]
        drawn.append(f'<path d="M{_path(line)}" fill="none" stroke="{colour}" stroke-width="1.6"/>')
        if len(times) <= FEW:
            drawn += [f'<circle cx="{a:.1f}" cy="{b:.1f}" r="2.2" fill="{colour}"/>' for a, b in line]
    unit = label if not power else label.replace("[", f"[10{_raised(power)} ")
    keys = "".join(
        f'<li><i style="background:{colour}"></i>{escape(curve.name)}</li>'
        for curve, colour in zip(shown, CURVES, strict=False)
    )
    return (
        f'<figure class="curves"><figcaption>{escape(unit)}</figcaption>'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(label)} over time">{"".join(drawn)}</svg>'
        f"<ul>{keys}</ul></figure>"
    )


def _largest(curve: Curve) -> float:
    return float(np.nanmax(np.abs(np.append(curve.values, 0.0))))


def _path(points: Sequence[tuple[float, float]]) -> str:
    return "L".join(f"{a:.1f} {b:.1f}" for a, b in points)


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
