"""Inexact Uzawa: the bodies are solved by conjugate gradients, only as exactly as the outer iteration needs."""

from __future__ import annotations

from dataclasses import dataclass

from geometry.arrays import Array
from solvers.interface.matrix_free import MatrixFreeSurface
from solvers.interface.problem import SurfaceProblem
from solvers.methods.inner_tolerance import InnerTolerance, negligible
from solvers.methods.outer_iteration import FrictionUpdate, Outer, Solved
from solvers.methods.uzawa import step_size
from solvers.newton.solution import OnStep, Solution, ignore


@dataclass(frozen=True, kw_only=True)
class InexactUzawa:
    """K_B u_{k+1} = R_B - B^T p_k + delta_k by conjugate gradients from u_k, ||delta_k|| <= tau_k; then as `Uzawa`.

    Q = W, alpha = relaxation / lambda_max or given. tau_k = 0 is `Uzawa`; for small tau_k the rate is close to that
    (Elman & Golub; `Tied.rate` of solvers/analysis/saddle_points.py bounds it). A residual that is small enough is
    believed only after an inner solve whose error it would show.

    Source: Pop (1999), (1.2); Elman & Golub, SIAM J. Numer. Anal. 31 (1994); Bramble, Pasciak & Vassilev, ibid. 34
    (1997), section 4, where the inner iteration need not be linear, as conjugate gradients are not.
    """

    inner: InnerTolerance = InnerTolerance()
    relaxation: float = 1.5  # [-]
    alpha: float | None = None  # [Pa/m], in place of relaxation / lambda_max
    friction_update: FrictionUpdate = "every iteration"
    rtol: float = 1e-8
    max_it: int = 10000

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        surface = problem.surface
        assert isinstance(surface, MatrixFreeSurface)
        alpha = step_size(problem, self.relaxation, self.alpha)
        last: Solved | None = None

        def solve(p: Array) -> Solved:
            nonlocal last
            u_c = surface.nearly(problem.load, p, self.inner(problem, last, p))
            if problem.natural_residual(p, problem.relative_displacement(u_c)) <= self.rtol:
                u_c = surface.nearly(problem.load, p, negligible(problem, self.rtol))
            last = Solved(p, u_c, alpha)
            return last

        outer = Outer(rtol=self.rtol, max_it=self.max_it, friction_update=self.friction_update)
        return outer(problem, p, solve, on_step)
