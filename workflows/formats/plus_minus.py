"""A number with its error, as people read it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from stickslip.geometry.arrays import CLOSE
from stickslip.solvers.results.step_result import PARTS, ErrorParts

MOST_PLACES = 6  # behind the point
PLAIN = 1e5  # smaller numbers have no exponent
AT_LEAST = "≥"  # before a stated error that lacks a part
UNKNOWN = "?"  # in place of an error that is not estimated, or only in parts beside which it is exact


def plus_minus(value: float, error: float | None, converges: bool | None = None, incomplete: bool = False) -> str:
    """A number and its error, with as many digits as that leaves; alone it is exact in the digits shown.

    Args:
        error: in the unit of the number; None: not known.
        converges: whether the number has a limit on ever finer meshes; None: not known.
        incomplete: whether the error lacks a part.

    >>> plus_minus(0.242957, 0.0002), plus_minus(0.242957, None, False), plus_minus(0.242957, None)
    ('0.2430 ± 0.0002', '0.24 (grows)', '0.24296 ± ?')
    >>> plus_minus(4.0, 0.0), plus_minus(4.0, 0.0, incomplete=True)
    ('4', '4 ± ?')
    >>> plus_minus(1324.0, 87.0), plus_minus(0.0, 3.0), plus_minus(2.1e7, 3e5)
    ('1320 ± 90', '0 ± 3', '(2.10 ± 0.03)e+07')
    """
    if converges is False:
        return f"{value:.2g} (grows)"
    if error is None or not error > CLOSE * abs(value):  # of a number: a smaller error is not shown
        return f"{value:.5g}" + f" ± {UNKNOWN}" * (error is None or incomplete)
    least = AT_LEAST if incomplete else ""
    error = float(f"{error:.0e}")
    last = math.floor(math.log10(error))  # place of its only digit
    if 0 < -last <= MOST_PLACES:
        return f"{value:.{-last}f} ± {least}{error:.{-last}f}"
    if last >= 0 and max(abs(value), error) < PLAIN:
        return f"{round(value / 10**last) * 10**last} ± {least}{round(error / 10**last) * 10**last}"
    power = math.floor(math.log10(max(abs(value), error)))
    places = max(power - last, 0)
    return f"({value / 10**power:.{places}f} ± {least}{error / 10**power:.{places}f}){f'{10**power:.0e}'[1:]}"


def missing(parts: ErrorParts) -> list[str]:
    """Parts that a stated error lacks."""
    return [] if parts.total is None else [*parts.lacking]


def parts_of(told: Mapping[str, Any] | None, component: int | None = None) -> ErrorParts:
    """The error of a number, or of a component of a vector, as result.json has it; None: not estimated.

    >>> parts_of({"mesh": [1.0, 2.0], "law": None, "converges": True}, 1).mesh
    2.0
    """

    def part(found: Any) -> Any:
        return found[component] if isinstance(found, list) and component is not None else found

    told = told or {}
    dear = {name: cost for name, cost in (told.get("lacking") or {}).items() if cost is not None}
    return ErrorParts(**{name: part(told.get(name)) for name in (*PARTS, "converges", "by", "unsure")}, dear=dear)


def error_of(numbers: Mapping[str, Any], key: str, component: int | None = None) -> ErrorParts:
    """The same of a number of a record."""
    return parts_of((numbers.get("error") or {}).get(key), component)


def stated(parts: ErrorParts) -> float | None:
    """Sum of the parts that are there, of a number; None: there is none to state."""
    return None if parts.total is None else float(np.asarray(parts.total))


def of_parts(value: float, parts: ErrorParts) -> str:
    """Return a number with the sum of the known parts of its error.

    >>> of_parts(0.242957, ErrorParts(mesh=1e-4, time_step=1e-4)), of_parts(0.242957, ErrorParts(converges=False))
    ('0.2430 ± ≥0.0002', '0.24 (grows)')
    """
    return plus_minus(value, stated(parts), parts.converges, bool(missing(parts)))


def with_error(value: float, parts: ErrorParts | None, unit: str) -> str:
    """Return a number with its error and its unit.

    >>> with_error(0.242957, ErrorParts(converges=False), "Pa"), with_error(0.242957, ErrorParts(mesh=1e-4), "Pa")
    ('0.24 Pa (grows)', '0.2430 ± ≥0.0001 Pa')
    """
    number, grows, rest = of_parts(value, parts or ErrorParts()).partition(" (")
    return f"{number} {unit}{grows}{rest}"
