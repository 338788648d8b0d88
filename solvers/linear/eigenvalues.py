"""The largest or smallest eigenvalue of a symmetric operator that is known by its products alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from scipy.sparse.linalg import LinearOperator, eigsh

from stickslip.geometry.arrays import Array

LANCZOS = 1e-4  # relative error of an eigenvalue


def extreme_eigenvalue(apply: Callable[[Array], Array], start: Array, which: Literal["LA", "SA"] = "LA") -> float:
    """Return the largest (LA) or smallest (SA) eigenvalue of an operator on vectors (n,), by Lanczos' method (ARPACK).

    LANCZOS is added to the largest one, so that a step size that divides by it is rather too small. Small operators,
    whose products are as many, are made dense.

    Args:
        apply: the operator.
        start: (n,), the same on every rank, and not normal to the direction that is sought.

    >>> round(extreme_eigenvalue(lambda x: np.arange(1.0, 61.0) * x, np.ones(60), "SA"), 3)
    1.0
    """
    vectors = 20 if which == "LA" else 40  # small ones are crowded in all uses here
    if len(start) <= vectors:
        values = np.linalg.eigvalsh(np.array([apply(unit) for unit in np.eye(len(start))]).reshape(2 * (len(start),)))
        return float(values[-1 if which == "LA" else 0])
    operator = LinearOperator(2 * (len(start),), matvec=apply, dtype=float)
    (found,) = eigsh(operator, k=1, which=which, v0=start, tol=LANCZOS, ncv=vectors, return_eigenvectors=False)
    return float(found) * (1 + LANCZOS if which == "LA" else 1)


def without_symmetry(count: int) -> Array:
    """Return a start (count,) of Lanczos' method that is no eigenvector of bodies with a plane of symmetry."""
    return np.asarray(1 + np.sin(np.arange(count)))
