"""Uzawa with the published preconditioner: a step in the metric of a Gram matrix, projected in that metric."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from solvers.gram_metric import GramMetric
from solvers.methods.solution import Array, OnStep, Solution, Status, Step, ignore
from solvers.methods.surface_model import nearest_in_cone
from solvers.surface_problem import SurfaceProblem

STALL_WINDOW = 500  # iterations without a new least residual


@dataclass(frozen=True)
class GramUzawa:
    """p <- argmin over the cone of |q - p_hat|_Q, p_hat = p + alpha Q^-1 (B u - R_C), alpha = relaxation / lambda_max.

    lambda_max is that of Q^-1 B K_B^-1 B^T. Two readings of the source: Q the Gram matrix of the multipliers, P P^T as
    (5.6) writes it; or Q^-1 the block of contact dofs in the factor of the displacements' Gram matrix. The first is of
    the wrong order, 2 for -1: condition numbers grow like h^-3, and on all but the coarsest meshes it ends in
    MAX_IT. The second is bounded in h for the complete factor only.

    The source has no projection, since its Newton steps fix what sticks; here the cone is met in Q itself, a contact
    problem on the surface, whose bound of friction follows the pressure. For 0 < relaxation < 2 and fixed bounds that
    converges; to clip point by point would be no projection in this metric, and need not.

    Source: Pop (1999), (5.6)-(5.7) and its last algorithm.
    """

    metric: GramMetric
    relaxation: float = 1.5  # [-]
    rtol: float = 1e-8
    max_it: int = 10000

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        metric = self.metric.on(problem, self.relaxation)
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
                found = nearest_in_cone(problem, metric, p, w, max(residual, self.rtol))
                if found is None:
                    status = Status.NO_HOLD
                    break
                p = found.p
        return Solution(p, w, u_c, status, residual, tuple(history))
