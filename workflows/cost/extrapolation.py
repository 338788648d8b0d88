"""Richardson extrapolation: the limit of a sequence for mesh size h -> 0, and its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from stickslip.geometry.arrays import EXACT, Array

WINDOW = 4  # finest meshes used: coarser ones do not follow the power yet; fewer cannot show divergence
SLOWEST, FASTEST = 0.25, 6.0  # powers
SAFETY = 1.5  # on the uncertainty, for the power may still change
TRUSTED = 0.2  # share of the step from the finest mesh to the limit that two powers at once can get wrong


@dataclass(frozen=True)
class Limit:
    """Limit of q(h) = value + C h^rate for h -> 0."""

    value: float
    uncertainty: float  # absolute
    rate: float | None  # None: too few meshes
    converges: bool = True


def limit(h: Sequence[float], q: Sequence[float], floor: float = 0.0) -> Limit:
    """The limit for h -> 0.

    With four meshes or more the uncertainty is how far apart the limits are that the finest three, the finest four and
    those before the finest one lead to, or the scatter about the power, or a fifth of the step from the finest mesh to
    the limit, whatever is largest; with three or less, that whole step.

    Args:
        h: mesh sizes (n,), any order, n >= 1.
        q: values (n,).
        floor: below which differences are noise, absolute.

    >>> h = [0.4, 0.2, 0.1, 0.05]
    >>> found = limit(h, [2 + 3 * size**1.5 for size in h])
    >>> round(found.value, 6), round(found.rate, 4), found.uncertainty < 0.02
    (2.0, 1.5, True)
    """
    x, y = _without_strays(np.asarray(h, float), np.asarray(q, float), floor)
    order = np.argsort(x)[::-1][-WINDOW:]
    x, y = x[order], y[order]
    if len(x) == 1:
        return Limit(float(y[0]), abs(float(y[0])), None)
    if float(np.ptp(y)) <= floor:  # exact on every mesh
        return Limit(float(y[-1]), max(floor, float(np.ptp(y))), None)
    if len(x) == 2:
        return Limit(float(y[-1]), max(floor, float(abs(y[-1] - y[0]))), None)
    value, rate, scatter = _fit(x, y)
    if not 1.01 * SLOWEST < rate < 0.99 * FASTEST:  # no power leads to a limit from here
        # three meshes cannot tell a slow power from growth without end
        grows = (
            rate < 1
            and len(x) >= WINDOW
            and len(set(np.sign(np.diff(y)))) == 1
            and float(np.ptp(y)) > 0.01 * abs(y[-1])  # else it is as good as constant
        )
        if grows:
            return Limit(float(y[-1]), float("inf"), rate, converges=False)
        return Limit(float(y[-1]), max(floor, SAFETY * float(np.ptp(y[-3:]))), None)
    step = abs(value - float(y[-1]))
    others = [] if len(x) == 3 else [_fit(x[:-1], y[:-1])[0], _fit(x[1:], y[1:])[0]]
    apart = max([TRUSTED * step if others else step, *(abs(value - other) for other in others)])
    return Limit(value, max(floor, SAFETY * max(apart, scatter)), rate)


def rate_of(h: Sequence[float], error: Sequence[float]) -> float | None:
    """Slope of log error over log h on the finest meshes; None for less than three."""
    if len(h) < 3:
        return None
    x, y = _without_strays(np.asarray(h, float), np.asarray(error, float), 0.0)
    order = np.argsort(x)[::-1][-WINDOW:]
    return float(np.polyfit(np.log(x[order]), np.log(y[order]), 1)[0])


def _without_strays(x: Array, y: Array, floor: float) -> tuple[Array, Array]:
    """Drop outliers: meshes whose value is a hundred median distances from the median: no power of h explains that.

    Never the finest mesh; and none where most values are equal, for then distances from the median have no scale.
    """
    off = np.abs(y - np.median(y))
    typical = float(np.median(off))
    if len(x) <= 3 or typical <= floor:
        return x, y
    keep = (off <= 100 * typical) | (x == x.min())
    return x[keep], y[keep]


def _fit(x: Array, y: Array) -> tuple[float, float, float]:
    """Limit, power and scatter of the best y = limit + C x^power; finer meshes weigh more."""
    weight = np.sqrt(x[-1] / x)

    def solve(power: float) -> tuple[Array, float]:
        columns = np.stack([np.ones_like(x), (x / x[-1]) ** power], axis=1)
        found = np.linalg.lstsq(weight[:, None] * columns, weight * y, rcond=None)[0]
        return found, float(np.sqrt(np.average((columns @ found - y) ** 2, weights=weight**2)))

    powers = np.linspace(SLOWEST, FASTEST, 116)
    near = powers[int(np.argmin([solve(power)[1] for power in powers]))]
    step = powers[1] - powers[0]
    bounds = (max(SLOWEST, near - step), min(FASTEST, near + step))
    best = minimize_scalar(lambda power: solve(power)[1], bounds=bounds, method="bounded", options={"xatol": EXACT})
    power = float(best.x) if best.fun < solve(near)[1] else float(near)
    found, scatter = solve(power)
    return float(found[0]), power, scatter
