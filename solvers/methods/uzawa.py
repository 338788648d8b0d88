"""Projected Uzawa: solve the bodies, then push the contact traction back into its cone."""

from __future__ import annotations

from dataclasses import dataclass

from geometry.arrays import Array
from solvers.interface.problem import SurfaceProblem
from solvers.methods.outer_iteration import FrictionUpdate, Outer, Solved
from solvers.newton.solution import OnStep, Solution, ignore


@dataclass(frozen=True, kw_only=True)
class Uzawa:
    """K_B u_{k+1} = R_B - B^T p_k exactly, then p_{k+1} = P_C(p_k + alpha (w(u_{k+1}) - gap)), metric Q = W.

    alpha is fixed: given, or relaxation / lambda_max, lambda_max that of W^-1 B K_B^-1 B^T. Converges for
    0 < relaxation < 2 when the bounds are fixed (sharp without projection: K_C goes into it implicitly, by the laws'
    resolvents, and leaves the bound as it is); with Coulomb's law the bound follows p_n in every iteration,
    contraction is not guaranteed, and the residual is watched.

    Source: Elman & Golub, SIAM J. Numer. Anal. 31 (1994); Pop (1999), section 5.
    """

    relaxation: float = 1.5  # [-]
    alpha: float | None = None  # [Pa/m], in place of relaxation / lambda_max
    friction_update: FrictionUpdate = "every iteration"
    rtol: float = 1e-8
    max_it: int = 10000

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        alpha = step_size(problem, self.relaxation, self.alpha)

        def solve(p: Array) -> Solved:  # K_B u = R_B - B^T p: one volume solve
            return Solved(p, problem.contact_displacement(p), alpha)

        outer = Outer(rtol=self.rtol, max_it=self.max_it, friction_update=self.friction_update)
        return outer(problem, p, solve, on_step)


def step_size(problem: SurfaceProblem, relaxation: float, alpha: float | None) -> float:
    """The one given, or relaxation / lambda_max [Pa/m]; without contact there is none to choose."""
    if alpha is not None or not len(problem.gap):
        return alpha or 1.0
    return relaxation / problem.surface.lambda_max
