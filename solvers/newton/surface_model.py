"""A model of the contact problem with an approximate Delassus operator, solved on the surface by semismooth Newton."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.interface.limit_analysis import balancing_tractions
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.newton.active_set import ActiveSet
from stickslip.solvers.newton.attempts import Attempts
from stickslip.solvers.newton.solution import Status
from stickslip.solvers.newton.starts import Start, again
from stickslip.solvers.newton.surface_system import Metric, SurfaceSystem

MOST = 1000  # Newton iterations
FIRM = (1e-3, 1e-5)  # weights of the proximal term of damped attempts [-]
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
    enough: float  # residual to which it is to be solved [-]

    def relative(self, p: Array, u: Array) -> Array:
        """Relative displacement (rows,) [m] at tractions p (rows,) [Pa] and rigid motions u = b (r,) [m]."""
        surface = self.problem.surface
        return np.asarray(self.w - self.flexibility(p - self.p) + surface.N @ (surface.R @ u))

    def solve(self, laws: ActiveSet, p: Array, u: Array) -> tuple[Array, Array]:
        """Tractions (rows,) [Pa] and rigid motions b (r,) [m] that satisfy the linearised laws; p and u start GMRES.

        Raises:
            LinAlgError: the active set leaves a rigid mode free.
        """
        problem, known = self.problem, self.w + self.flexibility(self.p)
        scale = min(problem.p_ref, problem.u_ref * float(problem.gamma.min(initial=np.inf)))
        if self.p.any():
            scale = min(scale, problem.scale(self.p))
        system = SurfaceSystem(laws, problem.gamma, self.flexibility, known)
        found = system.solve(p, u, INEXACT * self.enough * scale)
        return problem.surface.agreed(found[0]), problem.surface.agreed(found[1])  # what is learnt is shared by ranks


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
    model = SurfaceModel(problem=problem, flexibility=metric, p=p, w=w, enough=INNER * min(residual, 1.0))
    attempt = Attempts(problem, model, rtol=model.enough, max_it=MOST)
    for start, proximal in _chain(model, residual, attempt):
        attempt(start, proximal)
        if attempt.over:
            break
    best = attempt.best
    if best is None or best.status is Status.NO_HOLD:
        return None
    return ModelSolution(p=best.p, b=best.u_c, residual=best.residual)


def _chain(model: SurfaceModel, residual: float, attempts: Attempts) -> Iterator[tuple[Start, float | None]]:
    """Plain Newton from several starts, then damped from the best iterate."""
    nowhere = np.zeros(model.problem.surface.R.shape[1])
    for p_hat, factor in _starts(model.problem, model.p, model.w, residual):
        yield Start(p=model.p, u_c=nowhere, p_hat=p_hat, factor=factor, in_equilibrium=False), None
    for proximal in FIRM:
        assert attempts.best is not None
        if attempts.best.status is not Status.NO_HOLD:
            yield again(model.problem, attempts.best), proximal


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
