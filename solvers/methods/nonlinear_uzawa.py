"""Nonlinear Uzawa: compliant faces belong to the bodies, only the multipliers that are left are iterated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from solvers.condensed import CondensedSurface
from solvers.methods.compliant_bodies import CompliantBodies
from solvers.methods.inner_tolerance import InnerTolerance, negligible
from solvers.methods.outer_iteration import FrictionUpdate, Outer, Solved
from solvers.methods.solution import Array, OnStep, Solution, ignore
from solvers.surface_problem import SurfaceProblem

CHANGED = 0.01  # of the largest spring: faces that have changed less keep their alpha_k


@dataclass(frozen=True, kw_only=True)
class NonlinearUzawa:
    """F(u_{k+1}) = R_B - B^T p_k + delta_k, then p_{k+1} = P_C(p_k + alpha_k (w(u_{k+1}) - gap)), Q_k = W.

    F(u) = K_B u + j_n'(u) is strongly monotone and has no derivative where a point just touches; the inner solve is
    semismooth Newton, ||delta_k|| <= tau_k. p_k are friction, and the pressures of rigid laws. alpha_k is relaxation /
    lambda_max(W^-1 B V_k^-1 B^T), V_k in the generalised Jacobian of F at u_{k+1}. The source takes Q_k near
    B V_k^-1 B^T itself, which makes its iteration superlinear; a projection point by point wants it diagonal.

    Source: Chen, SIAM J. Numer. Anal. 35 (1998); Pop (1999), (1.3).
    """

    inner: InnerTolerance = InnerTolerance()
    relaxation: float = 1.5  # [-]
    friction_update: FrictionUpdate = "every iteration"
    rtol: float = 1e-8
    max_it: int = 10000

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        surface = problem.surface
        assert isinstance(surface, CondensedSurface)
        bodies = CompliantBodies(problem, surface)
        last: Solved | None = None
        springs, alpha = np.full(len(p), np.inf), 1.0

        def solve(p: Array) -> Solved:
            nonlocal last, springs, alpha
            start = problem.load.free if last is None else last.u_c
            p, u_c, V = bodies.solve(p, start, self.inner(problem, last, p))
            if problem.natural_residual(p, problem.relative_displacement(u_c)) <= self.rtol:
                p, u_c, V = bodies.solve(p, u_c, negligible(problem, self.rtol))
            k = bodies.springs(p)
            if len(bodies.others) and np.abs(k - springs).max() > CHANGED * k.max():
                springs, alpha = k, self.relaxation / bodies.lambda_max(V)
            last = Solved(p, u_c, alpha)
            return last

        outer = Outer(rtol=self.rtol, max_it=self.max_it, friction_update=self.friction_update)
        return outer(problem, p, solve, on_step)
