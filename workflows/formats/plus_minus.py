"""A number with its error, as people read it."""

from __future__ import annotations

import math

import numpy as np

from solvers.results.error_parts import ErrorParts

DIGITS = 1e-6  # of a number: a smaller error is not shown
MOST_PLACES = 6  # behind the point


def plus_minus(value: float, error: float | None, converges: bool | None = None) -> str:
    """A number and its error, with as many digits as that leaves.

    Args:
        error: total, in the unit of the number; None: not known.
        converges: whether the number has a limit on ever finer meshes; None: not known.

    >>> plus_minus(0.242957, 0.0002), plus_minus(0.242957, None, False), plus_minus(0.242957, None)
    ('0.2430 ± 0.0002', '0.24 (grows)', '0.24296')
    """
    if converges is False:
        return f"{value:.2g} (grows)"
    if error is None or not error > DIGITS * abs(value):
        return f"{value:.5g}"
    last = math.floor(math.log10(float(f"{error:.0e}")))  # place of its only digit
    if 0 < -last <= MOST_PLACES:
        return f"{value:.{-last}f} ± {error:.{-last}f}"
    places = max(math.floor(math.log10(abs(value))) - last, 0) if value else 0
    return f"{value:.{places}e} ± {error:.0e}" if value else f"0 ± {error:.0e}"


def with_error(value: float, parts: ErrorParts | None, unit: str) -> str:
    """The same with its unit, and the error as the estimates give it; None: not estimated.

    >>> with_error(0.242957, ErrorParts(converges=False), "Pa")
    '0.24 Pa (grows)'
    """
    parts = parts or ErrorParts()
    said = plus_minus(value, None if parts.total is None else float(np.asarray(parts.total)), parts.converges)
    number, grows, rest = said.partition(" (")
    return f"{number} {unit}{grows}{rest}"
