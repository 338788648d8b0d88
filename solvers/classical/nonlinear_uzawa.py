"""Nonlinear Uzawa: compliant faces belong to the bodies; only the other tractions are multipliers that are iterated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.solvers.classical.compliant_bodies import CompliantBodies
from stickslip.solvers.classical.inner_tolerance import InnerKeys, negligible
from stickslip.solvers.classical.outer_iteration import FrictionUpdates, Outer, Relaxation, Solved, projected
from stickslip.solvers.interface.discrete import GivenSurface
from stickslip.solvers.interface.prepare import condensed
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.methods.applicability import Applicability
from stickslip.solvers.methods.method import Stateless
from stickslip.solvers.newton.solution import OnStep, Solution, ignore
from stickslip.solvers.newton.surface_model import nearest_in_cone

OuterMetric = Literal["points", "jacobian"]
CHANGED = 0.01  # relative to the largest spring: alpha_k is computed anew only if some spring changes by more


@dataclass(frozen=True, kw_only=True)
class NonlinearUzawa(Relaxation, FrictionUpdates, InnerKeys, Stateless):
    """F(u_{k+1}) = R_B - B^T p_k + delta_k, then p_{k+1} = argmin over the cone of |q - p_hat|_(Q_k),
    p_hat = p_k + alpha_k Q_k^-1 W (w(u_{k+1}) - gap).

    F(u) = K_B u + j_n'(u) is strongly monotone, and not differentiable where a point just touches; the inner solve is
    semismooth Newton to ||delta_k|| <= tau_k. p_k holds friction, and the pressures of rigid laws. With V_k in the
    generalised Jacobian of F at u_{k+1}:

    points: Q_k = W, the projection is point by point, alpha_k = relaxation / lambda_max(W^-1 B V_k^-1 B^T).
    jacobian: Q_k = B V_k^-1 B^T, alpha_k = 1, and tau_k decreases with the residual: superlinear convergence if the
    friction bounds are given. Bounds that follow the pressure of a compliant face are not in V_k: fast linear
    convergence.

    Source: Chen, SIAM J. Numer. Anal. 35 (1998); Pop (1999), (1.3).
    """

    NAME: ClassVar = "nonlinear-uzawa"
    WHEN: ClassVar = (
        "as published: compliance stays inside the bodies, only what is left is iterated, none without friction. "
        'By points more than a thousand iterations (`block`); with `outer_metric = "jacobian"`, '
        "Chen's Q_k, 1–14, "
        "superlinear where friction is given"
    )
    WORKS_WITH: ClassVar = Applicability(floating=False, matrix_free=False, contends=False)
    ROW: ClassVar = 6

    outer_metric: Annotated[
        OuterMetric,
        Key("-", "nonlinear-uzawa: Q_k of its step; jacobian: B V_k^-1 B^T of the bodies with their compliant faces"),
    ] = "points"

    def __post_init__(self) -> None:
        super().__post_init__()
        ignored = self.outer_metric == "jacobian" and self.relaxation != type(self).relaxation
        require(not ignored, "relaxation", self.relaxation, "changes nothing with outer_metric = jacobian")

    def discrete(self, surface: GivenSurface) -> None:
        """None: its inner solves are of the bodies with their compliant faces."""

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        bodies = CompliantBodies(problem, condensed(problem.surface))
        last: Solved | None = None
        springs, alpha, V = np.full(len(p), np.inf), 1.0, None
        exact, inner = self.outer_metric == "jacobian", self.inner

        def solve(p: Array) -> Solved:
            nonlocal last, springs, alpha, V
            start = problem.load.free if last is None else last.u_c
            p, u_c, V = bodies.solve(p, start, inner(problem, last, p))
            if problem.natural_residual(p, problem.relative_displacement(u_c)) <= self.rtol:
                p, u_c, V = bodies.solve(p, u_c, negligible(problem, self.rtol))
            k = bodies.springs(p)
            if len(bodies.others) and np.abs(k - springs).max() > CHANGED * k.max():
                springs, alpha = k, self.relaxation / bodies.lambda_max(V)
            last = Solved(p, u_c, alpha)
            return last

        def advance(step: SurfaceProblem, found: Solved, w: Array, residual: float) -> Array | None:
            nonlocal inner
            if not exact:
                return projected(step, found, w, residual)
            assert V is not None  # an inner solve comes first
            small = min(residual, 1.0)
            inner = replace(self.inner, share=self.inner.share * small)
            nearest = nearest_in_cone(step, bodies.metric(V), found.p, w, max(small**2, self.rtol))
            return None if nearest is None else nearest.p

        outer = Outer(rtol=self.rtol, max_it=self.max_it, friction_update=self.friction_update, advance=advance)
        return outer(problem, p, solve, on_step)
