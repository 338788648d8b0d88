"""Proximal points: a discrete problem by a sequence of regular ones, each solved by Newton from the last answer.

W is often rank-deficient, and Newton's systems then are singular. W + epsilon I with q - epsilon r_k is regular, near
to the problem, and at its fixed point r_{k+1} = r_k is the problem itself. Newton needs few iterations for each.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.interface.discrete import DiscreteProblem
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.methods.method import Solve
from stickslip.solvers.newton.solution import OnStep, Solution, Status, Step, ignore

FIRST, FACTOR, LEAST, MOST = 1e-2, 10.0, 1e-10, 1e2  # epsilon, relative to the largest diagonal entry of W
INNER = 40  # Newton iterations for one regular problem, before epsilon is raised
EXACT = 0.1  # of the tolerance: residual of a regular problem
OUTER = 60  # regular problems


@dataclass(frozen=True, kw_only=True)
class ProximalPoints:
    """epsilon falls tenfold when regular problems are solved, and rises tenfold when one is not.

    After each failure it falls only after twice as many successes as before: on a branch that has no solution r drifts
    by residual / epsilon an iteration, and steps that are large, but not too large for Newton, lead to where a contact
    changes its state.

    Source: Rockafellar, SIAM J. Control Optim. 14 (1976); for this problem: Acary, Brémond & Huber, in: Advanced Topics
    in Nonsmooth Dynamics, Springer (2018).
    """

    rtol: float
    max_it: int  # Newton iterations of all regular problems
    newton: Callable[[float, int], Solve]  # residual and most iterations to the solver of a regular problem

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        assert isinstance(problem, DiscreteProblem)
        epsilon, count, successes, patience = FIRST, 0, 0, 1
        best = self._judged(problem, p, 0)
        history = list(best.history)
        while best.status is not Status.CONVERGED and len(history) <= OUTER and count < self.max_it and epsilon <= MOST:
            solve = self.newton(EXACT * self.rtol, min(INNER, self.max_it - count))
            found = solve(problem.regular(p, epsilon), p, ignore)
            count += found.iterations
            if found.status is Status.CONVERGED:
                p, successes = found.p, successes + 1
                if successes >= patience:
                    epsilon, successes = max(epsilon / FACTOR, LEAST), 0
            else:
                epsilon, successes, patience = FACTOR * epsilon, 0, 2 * patience
            tried = self._judged(problem, found.p, count)
            history += tried.history
            on_step(history[-1])
            if tried.residual < best.residual:
                best = tried
        return replace(best, history=tuple(history))

    def _judged(self, problem: SurfaceProblem, p: Array, count: int) -> Solution:
        u_c = problem.contact_displacement(p)
        w = problem.relative_displacement(u_c)
        residual = problem.natural_residual(p, w)
        status = Status.CONVERGED if residual <= self.rtol else Status.STALLED
        if not np.isfinite(residual):
            residual, status = np.inf, Status.NOT_FINITE
        return Solution(p, w, u_c, status, residual, (Step(count, residual, problem.volume_solves),))
