"""Power iteration: the largest eigenvalue of a symmetric positive definite operator, from below."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geometry.arrays import Array

TOLERANCE = 1e-3  # relative change of the Rayleigh quotient, four iterations in a row, at which it stops
MOST = 60  # iterations


@dataclass(frozen=True)
class Eigenvalue:
    """An eigenvalue and its direction."""

    value: float
    direction: Array  # (n,) unit
    iterations: int


def largest_eigenvalue(
    apply: Callable[[Array], Array],
    size: int,
    start: Array | None = None,
    tolerance: float = TOLERANCE,
    most: int = MOST,
) -> Eigenvalue:
    """The largest eigenvalue of an operator on vectors (size,), by its Rayleigh quotient: never above it.

    Where other eigenvalues lie close to it, the quotient changes little from one iteration to the next, although its
    error is still larger than `tolerance`.

    Args:
        apply: the operator.
        size: of the vectors.
        start: (size,) of an earlier call; None: a vector without symmetry, the same on every rank.
        tolerance: see TOLERANCE.
        most: largest number of iterations.

    >>> found = largest_eigenvalue(lambda x: np.array([1.0, 3.0]) * x, 2)
    >>> round(found.value, 3)
    3.0
    """
    if not size:
        return Eigenvalue(1.0, np.zeros(0), 0)
    x = 1 + np.sin(np.arange(size)) if start is None or len(start) != size else start
    x, value, small, taken = x / np.linalg.norm(x), 0.0, 0, 0
    for k in range(1, most + 1):
        taken = k
        y = apply(x)
        before, value = value, float(x @ y)
        small = small + 1 if abs(value - before) <= tolerance * abs(value) else 0
        if not value or small == 4:
            break
        x = y / np.linalg.norm(y)
    return Eigenvalue(value, x, taken)
