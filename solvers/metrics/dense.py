"""A metric Q of Uzawa's method, given as a dense matrix on the contact rows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import eigh

from stickslip.geometry.arrays import EXACT, Array, Bools
from stickslip.solvers.interface.flexibility import DelassusOperator


@dataclass(frozen=True, eq=False, kw_only=True)
class DenseMetric:
    """Q / alpha in place of the Delassus operator; implements `newton.surface_system.Metric`."""

    surface: DelassusOperator
    Q: Array  # (rows, rows), p^T Q p for tractions p
    carrying: Bools  # (rows,) rows that may carry a traction
    root: Array  # T with T T^T = Q^-1 on these rows, see `inverse_root`
    alpha: float  # step of Uzawa's method

    @cached_property
    def matrix(self) -> Array:
        """W^-1 Q / alpha (rows, rows) [m/Pa]."""
        return np.asarray(self.Q / (self.alpha * self.surface.W[:, None]))

    @cached_property
    def diagonal(self) -> Array:
        """That of `matrix` (rows,) [m/Pa]."""
        return np.diag(self.matrix)

    def __call__(self, p: Array) -> Array:
        """Relative displacement (rows,) [m] by this metric from tractions (rows,) [Pa]."""
        return np.asarray(self.matrix @ p)

    def inverse(self, w: Array) -> Array:
        """Tractions alpha Q^-1 W w (rows,) [Pa] from relative displacement w (rows,) [m]."""
        found = np.zeros_like(w)
        found[self.carrying] = self.alpha * self.root @ (self.root.T @ (self.surface.W * w)[self.carrying])
        return found


def inverse_root(Q: Array) -> Array:
    """T (rows, r) with T T^T = Q^-1 (the pseudo-inverse), r the rank of Q (rows, rows).

    Q is singular where a compliant face has more points than nodes: tractions without nodal forces have norm zero.
    """
    values, vectors = eigh(Q)
    kept = values > EXACT * values.max(initial=0.0)  # of the largest eigenvalue; a smaller one is zero
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]))
