"""The contact problem with a guess of the flexibility, solved on the surface alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from geometry.arrays import Array
from solvers.interface.limit_analysis import balancing_tractions
from solvers.interface.problem import SurfaceProblem
from solvers.newton.active_set import linearise
from solvers.newton.surface_system import Metric, SurfaceSystem

RETREATS = 6  # times that trial tractions under which nothing holds the bodies are taken back by half
ATTEMPT = 30  # Newton iterations from one start
INNER = 0.1  # of the residual, how exact the surface is solved
INEXACT = 0.3  # of the residual that is enough: what a Newton system may leave


@dataclass(frozen=True)
class Found:
    """Tractions, the rigid motions they take place at, and what the model's own laws leave there."""

    p: Array  # (rows,)
    b: Array  # (r,)
    residual: float


@dataclass(frozen=True)
class SurfaceModel:
    """w(q, b) = w - G (q - p) + N R b about a point p where w is known, with R^T (f - B^T q) = 0."""

    problem: SurfaceProblem
    flexibility: Metric  # G
    p: Array  # (rows,)
    w: Array  # (rows,)

    def at(self, p: Array, b: Array) -> Array:
        """w (rows,) at tractions p and rigid motions b (r,)."""
        surface = self.problem.surface
        return np.asarray(self.w - self.flexibility(p - self.p) + surface.N @ (surface.R @ b))

    def solve(self, start: Array, gamma: Array, enough: float) -> Found | None:
        """Semismooth Newton from trial tractions; the best of its iterates, the last if its residual is enough.

        None if the linearised laws hold the bodies nowhere.
        """
        best: Found | None = None
        p_hat = held = start
        at, b = self.p, np.zeros(self.problem.surface.R.shape[1])
        for _ in range(ATTEMPT):
            stepped = self._newton(p_hat, held, gamma, enough, at, b)
            if stepped is None:
                break
            at, b, held = stepped
            w = self.at(at, b)
            residual = self.problem.natural_residual(at, w)
            if best is None or not best.residual <= residual:  # NaN is worst
                best = Found(at, b, residual)
            if residual <= enough:
                break
            p_hat = at + gamma * (w - self.problem.gap)
        return best

    def _newton(
        self, p_hat: Array, held: Array, gamma: Array, enough: float, at: Array, b: Array
    ) -> tuple[Array, Array, Array] | None:
        """As near to trial tractions as the laws linearised there hold the bodies; and where that was."""
        problem, known = self.problem, self.w + self.flexibility(self.p)
        leave = INEXACT * enough * min(problem.p_ref, problem.u_ref * float(gamma.min(initial=np.inf)))
        for _ in range(RETREATS):
            try:
                laws = linearise(problem, p_hat, gamma)
                return *SurfaceSystem(laws, gamma, self.flexibility, known).solve(at, b, leave), p_hat
            except np.linalg.LinAlgError:
                p_hat = (p_hat + held) / 2
        return None


def nearest_in_cone(problem: SurfaceProblem, metric: Metric, p: Array, w: Array, residual: float) -> Found | None:
    """A step of Uzawa's method: argmin over the cone of |q - p_hat| in the metric G, p_hat = p + G^-1 (w - gap).

    None if the linearised laws hold the bodies nowhere.

    Args:
        residual: that of p, or what is asked for if that is more.
    """
    model = SurfaceModel(problem, metric, p, w)
    enough = INNER * min(residual, 1.0)
    best: Found | None = None
    for start, factor in _starts(problem, p, w, residual):
        found = model.solve(start, factor * problem.gamma, enough)
        if found is not None and (best is None or not best.residual <= found.residual):
            best = found
        if best is not None and best.residual <= enough:
            break
    return best


def _starts(problem: SurfaceProblem, p: Array, w: Array, residual: float) -> Iterator[tuple[Array, float]]:
    """Trial tractions, and the factor of gamma that belongs to them: from where we are, then from all closed."""
    n = problem.surface.normal_rows
    if np.isfinite(residual):
        for factor in (1.0, 10.0, 0.1):
            yield p + factor * problem.gamma * (w - problem.gap), factor
    elif p.any():
        yield p, 1.0
    yield np.concatenate([np.full(n, problem.p_ref), np.zeros(len(p) - n)]), 1.0
    if problem.surface.floating:
        rigid = balancing_tractions(problem)
        if rigid is not None:
            yield rigid, 1.0
