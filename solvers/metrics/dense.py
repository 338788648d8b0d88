"""A metric of Uzawa's method given as a dense matrix on the rows of contact."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import eigh

from geometry.arrays import Array, Bools
from solvers.interface.flexibility import DelassusOperator

RANK = 1e-13  # of the largest eigenvalue; a smaller one is zero


@dataclass(frozen=True, eq=False)
class DenseMetric:
    """Q / alpha on the rows: what tractions cause if that were the bodies; see `methods.surface_system.Metric`."""

    surface: DelassusOperator
    Q: Array  # (rows, rows), as a metric of tractions
    carrying: Bools  # (rows,) that may carry a traction
    root: Array  # of the inverse of Q on these, see `inverse_root`
    alpha: float

    @cached_property
    def matrix(self) -> Array:
        """W^-1 Q / alpha (rows, rows) [m/Pa]."""
        return np.asarray(self.Q / (self.alpha * self.surface.W[:, None]))

    @cached_property
    def diagonal(self) -> Array:
        return np.diag(self.matrix)

    def __call__(self, p: Array) -> Array:
        return np.asarray(self.matrix @ p)

    def inverse(self, w: Array) -> Array:
        """alpha Q^-1 W w."""
        found = np.zeros_like(w)
        found[self.carrying] = self.alpha * self.root @ (self.root.T @ (self.surface.W * w)[self.carrying])
        return found


def inverse_root(Q: Array) -> Array:
    """T (rows, r) with T T^T = Q^-1; of the rank r that Q has.

    It is not full where a compliant face has more points than nodes: tractions that push no node have no norm either.
    """
    values, vectors = eigh(Q)
    kept = values > RANK * values.max(initial=0.0)
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]))
