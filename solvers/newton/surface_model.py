"""A model of the contact problem with an approximate Delassus operator, solved on the surface by semismooth Newton."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from geometry.arrays import Array
from solvers.interface.limit_analysis import balancing_tractions
from solvers.interface.problem import SurfaceProblem
from solvers.newton.active_set import linearise
from solvers.newton.surface_system import Metric, SurfaceSystem

RETREATS = 6  # number of halvings of a step to an active set that leaves a rigid mode free
ATTEMPT = 30  # Newton iterations from one start
INNER = 0.1  # of the residual of the step: residual to which the model is solved
INEXACT = 0.3  # of that residual: what each linear system may leave


@dataclass(frozen=True, kw_only=True)
class ModelSolution:
    """An iterate of the model: tractions and rigid motions."""

    p: Array  # (rows,) [Pa]
    b: Array  # (r,) [m]
    residual: float  # complementarity residual of the model


@dataclass(frozen=True, kw_only=True)
class SurfaceModel:
    """w(q, b) = w - G (q - p) + N R b about tractions p whose w is known, with R^T (f - B^T q) = 0.

    G approximates the Delassus operator.
    """

    problem: SurfaceProblem
    flexibility: Metric  # G
    p: Array  # (rows,) [Pa]
    w: Array  # (rows,) [m]

    def at(self, p: Array, b: Array) -> Array:
        """Relative displacement (rows,) [m] of the model at tractions p (rows,) [Pa] and rigid motions b (r,) [m]."""
        surface = self.problem.surface
        return np.asarray(self.w - self.flexibility(p - self.p) + surface.N @ (surface.R @ b))

    def solve(self, start: Array, gamma: Array, enough: float) -> ModelSolution | None:
        """Semismooth Newton on the model.

        Args:
            start: trial tractions (rows,) [Pa].
            gamma: (rows,) [Pa/m], see `linearise`.
            enough: residual at which to stop.

        Returns:
            The last iterate if its residual is small enough, else the best; None if no active set held the bodies.
        """
        best: ModelSolution | None = None
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
                best = ModelSolution(p=at, b=b, residual=residual)
            if residual <= enough:
                break
            p_hat = at + gamma * (w - self.problem.gap)
        return best

    def _newton(
        self, p_hat: Array, held: Array, gamma: Array, enough: float, at: Array, b: Array
    ) -> tuple[Array, Array, Array] | None:
        """One Newton step from p_hat; while its active set leaves a rigid mode free, p_hat moves half way to `held`.

        Returns:
            Tractions, rigid motions and the trial tractions of the linearisation; None if RETREATS were not enough.
        """
        problem, known = self.problem, self.w + self.flexibility(self.p)
        leave = INEXACT * enough * min(problem.p_ref, problem.u_ref * float(gamma.min(initial=np.inf)))
        for _ in range(RETREATS):
            try:
                laws = linearise(problem, p_hat, gamma)
                return *SurfaceSystem(laws, gamma, self.flexibility, known).solve(at, b, leave), p_hat
            except np.linalg.LinAlgError:
                p_hat = (p_hat + held) / 2
        return None


def nearest_in_cone(
    problem: SurfaceProblem, metric: Metric, p: Array, w: Array, residual: float
) -> ModelSolution | None:
    """A step of Uzawa's method in the metric G: the admissible q nearest to p_hat = p + G^-1 (w - gap).

    Args:
        problem: the contact problem of the step.
        metric: G.
        p: tractions (rows,) [Pa].
        w: their relative displacement (rows,) [m].
        residual: that of p, or the tolerance if that is larger.

    Returns:
        None if no active set held the bodies.
    """
    model = SurfaceModel(problem=problem, flexibility=metric, p=p, w=w)
    enough = INNER * min(residual, 1.0)
    best: ModelSolution | None = None
    for start, factor in _starts(problem, p, w, residual):
        found = model.solve(start, factor * problem.gamma, enough)
        if found is not None and (best is None or not best.residual <= found.residual):
            best = found
        if best is not None and best.residual <= enough:
            break
    return best


def _starts(problem: SurfaceProblem, p: Array, w: Array, residual: float) -> Iterator[tuple[Array, float]]:
    """Starts of Newton, trial tractions and a factor of gamma: those of p, all rows closed, balance of rigid bodies."""
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
