"""Projected Uzawa: solve the bodies, then project the contact traction onto its cone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from stickslip.geometry.arrays import Array
from stickslip.solvers.classical.outer_iteration import FixedStep, Outer, Solved
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.methods.applicability import Applicability
from stickslip.solvers.methods.method import Stateless
from stickslip.solvers.newton.solution import OnStep, Solution, ignore


@dataclass(frozen=True, kw_only=True)
class Uzawa(FixedStep, Stateless):
    """K_B u_{k+1} = R_B - B^T p_k exactly, then p_{k+1} = P_C(p_k + alpha (w(u_{k+1}) - gap)), metric Q = W.

    alpha is fixed: given, or relaxation / lambda_max(W^-1 B K_B^-1 B^T). Converges for 0 < relaxation < 2 if the
    friction bounds are fixed. That limit is sharp without projection; K_C enters implicitly, by the laws' resolvents,
    and does not change it. With Coulomb's law the bound follows p_n in every iteration: contraction is not guaranteed,
    and the iteration ends with Status.STALLED if the residual no longer decreases.

    Source: Elman & Golub, SIAM J. Numer. Anal. 31 (1994); Pop (1999), section 5.
    """

    NAME: ClassVar = "uzawa"
    WHEN: ClassVar = "the classical projected iteration, to compare with: hundreds to thousands of cheap iterations"
    WORKS_WITH: ClassVar = Applicability(floating=False)
    ROW: ClassVar = 4

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        alpha = self.step_size(problem)

        def solve(p: Array) -> Solved:  # K_B u = R_B - B^T p: one volume solve
            return Solved(p, problem.contact_displacement(p), alpha)

        outer = Outer(rtol=self.rtol, max_it=self.max_it, friction_update=self.friction_update)
        return outer(problem, p, solve, on_step)
