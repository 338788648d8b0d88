"""Projected Uzawa: solve the bodies, then push the contact traction back into its cone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from solvers.methods.solution import Array, OnStep, Solution, Status, Step, ignore
from solvers.surface_problem import SurfaceProblem

STALL_WINDOW = 500  # iterations without a new least residual


@dataclass(frozen=True, kw_only=True)
class Uzawa:
    """p <- P_C(p + alpha (w(p) - gap)), alpha = relaxation / lambda_max, metric Q = W.

    Converges for 0 < relaxation < 2 when the bounds are fixed; with Coulomb's law the bound follows p_n in every
    iteration, contraction is not guaranteed, and the residual is watched.

    Source: Elman & Golub, SIAM J. Numer. Anal. 31 (1994); Pop (1999), section 5.
    """

    relaxation: float = 1.5  # [-]
    rtol: float = 1e-8
    max_it: int = 10000

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        alpha = self.relaxation / problem.surface.lambda_max if len(p) else 1.0
        history: list[Step] = []
        status = Status.MAX_IT
        least, found_at = np.inf, 0
        for k in range(self.max_it + 1):
            u_c = problem.contact_displacement(p)  # K_B u = R_B - B^T p: one volume solve
            w = problem.relative_displacement(u_c)
            residual = problem.natural_residual(p, w)
            history.append(Step(k, residual, problem.volume_solves))
            on_step(history[-1])
            if not np.isfinite(residual):
                status = Status.NOT_FINITE
                break
            if residual <= self.rtol:
                status = Status.CONVERGED
                break
            if residual < least:
                least, found_at = residual, k
            elif k - found_at > STALL_WINDOW:
                status = Status.STALLED
                break
            if k < self.max_it:
                p = problem.project(p + alpha * (w - problem.gap), alpha)
        return Solution(p, w, u_c, status, residual, tuple(history))
