"""Inexact Uzawa: conjugate gradients solve the bodies to the accuracy that the outer iteration needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from stickslip.geometry.arrays import Array
from stickslip.solvers.classical.uzawa import FixedStep, InnerKeys, Solved, negligible
from stickslip.solvers.interface.prepare import matrix_free
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import OnStep, Solution, ignore
from stickslip.solvers.methods.method import Applicability, Ready, Setup, Stateless


@dataclass(frozen=True, kw_only=True)
class InexactUzawa(FixedStep, InnerKeys, Stateless):
    """K_B u_{k+1} = R_B - B^T p_k + delta_k by conjugate gradients from u_k, ||delta_k|| <= tau_k; then as `Uzawa`.

    Q = W; alpha is given, or relaxation / lambda_max. With tau_k = 0 it is `Uzawa`; for small tau_k its rate is close
    to that of `Uzawa` (Elman & Golub; `Tied.rate` of workflows/lab/studies/saddle_points.py bounds it). Before a
    residual below the tolerance is accepted, the bodies are solved again, so accurately that the residual is reliable.

    Source: Pop (1999), (1.2); Elman & Golub, SIAM J. Numer. Anal. 31 (1994); Bramble, Pasciak & Vassilev, ibid. 34
    (1997), section 4, where the inner iteration need not be linear, as conjugate gradients are not.
    """

    NAME: ClassVar = "inexact-uzawa"
    WHEN: ClassVar = (
        "as published: `uzawa` whose inner solves are a few conjugate gradients, as exact as the outer residual "
        "asks: on the scenes tried less than one an iteration"
    )
    WORKS_WITH: ClassVar = Applicability(floating=False, condensed=False, contends=False)
    ROW: ClassVar = 5

    def build(self, setup: Setup) -> Ready:
        # conjugate gradients as published: of earlier solves only the last answer is used, to start from
        matrix_free(setup.surface).volume.remember(1)
        return self

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        surface = matrix_free(problem.surface)
        alpha = self.step_size(problem)
        last: Solved | None = None

        def solve(p: Array) -> Solved:
            nonlocal last
            u_c = surface.nearly(problem.load, p, self.inner(problem, last, p))
            if problem.natural_residual(p, problem.relative_displacement(u_c)) <= self.rtol:
                u_c = surface.nearly(problem.load, p, negligible(problem, self.rtol))
            last = Solved(p, u_c, alpha)
            return last

        return self.iteration()(problem, p, solve, on_step)
