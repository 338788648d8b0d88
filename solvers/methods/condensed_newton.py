"""Condensed Newton: semismooth Newton, its linear systems solved with the Schur complement of the bodies, exactly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from stickslip.geometry.arrays import Array
from stickslip.solvers.interface.discrete import GivenSurface
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.methods.applicability import Applicability
from stickslip.solvers.methods.method import Solve, Stateless, Turn
from stickslip.solvers.methods.proximal_points import ProximalPoints
from stickslip.solvers.newton import condensed_system, given_system
from stickslip.solvers.newton.semismooth import SemismoothNewton
from stickslip.solvers.newton.solution import OnStep, Solution, ignore


@dataclass(frozen=True, kw_only=True)
class CondensedNewton(Stateless):
    """Semismooth Newton on the condensed surface problem, see `SemismoothNewton`.

    Source: Alart & Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991).
    """

    NAME: ClassVar = "condensed-newton"
    WHEN: ClassVar = (
        "1–16 iterations at every mesh size tried, some tens where plain Newton cycles; needs the condensed form"
    )
    WORKS_WITH: ClassVar = Applicability(floating=True, matrix_free=False)
    ROW: ClassVar = 1
    ROWS_ALONE: ClassVar = True
    TURNS: ClassVar = (Turn("condensed", 1),)

    def discrete(self, surface: GivenSurface) -> Solve:
        def newton(rtol: float, max_it: int) -> Solve:
            return SemismoothNewton(rtol=rtol, max_it=max_it, linear=given_system.solve)

        return ProximalPoints(rtol=self.rtol, max_it=self.max_it, newton=newton)

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        newton = SemismoothNewton(rtol=self.rtol, max_it=self.max_it, linear=condensed_system.solve)
        return newton(problem, p, on_step)
