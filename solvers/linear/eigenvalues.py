"""The ends of the spectrum of a symmetric positive definite operator: the largest eigenvalue by power iteration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import LinearOperator, eigsh

from stickslip.geometry.arrays import Array

TOLERANCE = 1e-3  # relative change of the Rayleigh quotient, four iterations in a row, at which it stops
MOST = 60  # iterations
LANCZOS = 1e-4  # relative error of the smallest eigenvalue
VECTORS = 40  # that Lanczos' method keeps


@dataclass(frozen=True)
class Eigenvalue:
    """An eigenvalue and its direction."""

    quotient: float  # Rayleigh quotient: not above the largest eigenvalue
    error: float  # norm of its residual: some eigenvalue is not farther from it
    direction: Array  # (n,) unit

    @property
    def value(self) -> float:
        """The largest eigenvalue with its error added, so that a step size that divides by it is rather too small."""
        return self.quotient + self.error


def largest_eigenvalue(apply: Callable[[Array], Array], start: Array) -> Eigenvalue:
    """The largest eigenvalue of an operator on vectors (n,), from a start (n,) that is not normal to its direction.

    >>> found = largest_eigenvalue(lambda x: np.array([1.0, 3.0]) * x, np.ones(2))
    >>> round(found.quotient, 3)
    3.0
    """
    if not len(start):
        return Eigenvalue(1.0, 0.0, start)
    x, value, error, small = start / np.linalg.norm(start), 0.0, 0.0, 0
    for k in range(1, MOST + 1):
        y = apply(x)
        before, value = value, float(x @ y)
        small = small + 1 if abs(value - before) <= TOLERANCE * abs(value) else 0
        error = float(np.linalg.norm(y - value * x))
        if not value or small == 4 or k == MOST:
            break
        x = y / np.linalg.norm(y)
    return Eigenvalue(value, error, x)


def smallest_eigenvalue(apply: Callable[[Array], Array], start: Array) -> float:
    """The smallest eigenvalue of an operator on vectors (n,), by Lanczos' method: small ones are crowded here.

    >>> round(smallest_eigenvalue(lambda x: np.arange(1.0, 61.0) * x, np.ones(60)), 3)
    1.0
    """
    size = len(start)
    if size <= VECTORS:
        return float(np.linalg.eigvalsh(np.column_stack([apply(unit) for unit in np.eye(size)]))[0])
    operator = LinearOperator((size, size), matvec=apply, dtype=float)
    (found,) = eigsh(operator, k=1, which="SA", v0=start, tol=LANCZOS, ncv=VECTORS, return_eigenvectors=False)
    return float(found)
