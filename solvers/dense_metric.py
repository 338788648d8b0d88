"""A metric of Uzawa's method given as a dense matrix on the rows of contact."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from solvers.bodies import Bodies

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DenseMetric:
    """Q / alpha on the rows: what tractions cause if that were the bodies; see `methods.surface_system.Metric`."""

    surface: Bodies
    Q: Array  # (rows, rows), as a metric of tractions
    carrying: NDArray[np.bool_]  # (rows,) that may carry a traction: on these Q is positive definite
    alpha: float

    @cached_property
    def matrix(self) -> Array:
        """W^-1 Q / alpha (rows, rows) [m/Pa]."""
        return np.asarray(self.Q / (self.alpha * self.surface.W[:, None]))

    @cached_property
    def diagonal(self) -> Array:
        return np.diag(self.matrix)

    @cached_property
    def _factor(self) -> Any:
        return cho_factor(self.Q[np.ix_(self.carrying, self.carrying)])

    def __call__(self, p: Array) -> Array:
        return np.asarray(self.matrix @ p)

    def inverse(self, w: Array) -> Array:
        """alpha Q^-1 W w."""
        found = np.zeros_like(w)
        found[self.carrying] = self.alpha * cho_solve(self._factor, (self.surface.W * w)[self.carrying])
        return found
