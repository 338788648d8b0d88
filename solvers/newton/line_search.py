"""Line search of semismooth Newton on the surface: the merit may rise for some iterations."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.interface.problem import SurfaceProblem

MEMORY = 5  # merits of earlier iterates: the largest of them must fall
HALVINGS = 12  # of a step
DECREASE = 1e-3  # share of a step by which the merit must fall


@dataclass
class LineSearch:
    """Shortens steps of tractions and displacement; w is affine in them, so that no volume solve is needed.

    The merit is the 2-norm of the complementarity residual / sqrt(gamma): an energy, and no rows have to be scaled.

    Source: Grippo, Lampariello & Lucidi, SIAM J. Numer. Anal. 23 (1986).
    """

    problem: SurfaceProblem
    gamma: Array  # (rows,) [Pa/m]
    recent: deque[float] = field(default_factory=lambda: deque(maxlen=MEMORY))

    def __call__(self, p: Array, w: Array, p_new: Array, w_new: Array) -> float:
        """Share of the step from (p, w) to (p_new, w_new) to take; the one of least merit if none is small enough."""
        self.recent.append(self._merit(p, w))
        allowed = max(self.recent)
        tried: list[tuple[float, float]] = []
        for t in 0.5 ** np.arange(HALVINGS):
            merit = self._merit(p + t * (p_new - p), w + t * (w_new - w))
            if merit <= (1 - DECREASE * t) * allowed:
                return float(t)
            tried.append((merit, float(t)))
        return min(tried)[1]

    def _merit(self, p: Array, w: Array) -> float:
        residual = self.problem.cone.natural_residual(p, w - self.problem.gap, self.gamma)
        return float(np.linalg.norm(residual / np.sqrt(self.gamma)))
