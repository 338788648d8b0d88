"""Uzawa with the published preconditioner: step and projection in the metric of a Gram matrix."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar

from stickslip.geometry.arrays import Array
from stickslip.geometry.keys import Key
from stickslip.solvers.classical.gram import GramMetric
from stickslip.solvers.classical.outer_iteration import Outer, Relaxation, Solved
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.methods.applicability import Applicability
from stickslip.solvers.methods.method import Keys, Method, Ready, Refusal, SameEveryStep, Setup
from stickslip.solvers.newton.solution import OnStep, Solution, ignore
from stickslip.solvers.newton.surface_model import nearest_in_cone
from stickslip.solvers.scene.gram import Gram
from stickslip.solvers.scene.problem import Problem


@dataclass(frozen=True, kw_only=True)
class GramKeys(Keys):
    """Key of [solver] for the Gram matrix of the published preconditioner."""

    gram: Annotated[Gram, Key("-", "preconditioner of gram-uzawa, and of block-uzawa with preconditioner = gram")] = (
        Gram()
    )


@dataclass(frozen=True, kw_only=True)
class GramUzawa(Relaxation, GramKeys, Method):
    """p <- argmin over the cone of |q - p_hat|_Q, p_hat = p + alpha Q^-1 (B u - R_C), alpha = relaxation / lambda_max.

    lambda_max is that of Q^-1 B K_B^-1 B^T. The source can be read in two ways: Q is the Gram matrix of the
    multipliers, P P^T as (5.6) writes it; or Q^-1 is the block of contact dofs in the factor of the displacements' Gram
    matrix. The first is an operator of the wrong order, 2 instead of -1: condition numbers grow like h^-3, and on all
    but the coarsest meshes it ends in MAX_IT. The second is bounded in h for the complete factor only.

    The source has no projection, because its Newton steps fix the sticking points. Here the projection onto the cone is
    in the metric Q: a contact problem on the surface, whose friction bound follows the pressure. It converges for
    0 < relaxation < 2 and fixed bounds. Clipping point by point is not a projection in this metric, and may diverge.
    On compliant faces, whose tractions are at quadrature points, Q measures the nodal forces of the tractions and is
    singular; with the compliance of the law added it is regular.

    Source: Pop (1999), (5.6)-(5.7) and its last algorithm.
    """

    NAME: ClassVar = "gram-uzawa"
    WHEN: ClassVar = (
        "as published: preconditioned by the Cholesky factor of a Gram matrix. Complete, of the volume, on forces: "
        "as many iterations on every mesh (83–87 for two steps of `block` to 1e-6, condition number 9.6–10.4; "
        "`uzawa` 302–1563), at the price of a second factorisation; incomplete, it grows like 1/h; of the multiplier "
        "space, like 1/h³, worse than none"
    )
    WORKS_WITH: ClassVar = Applicability(floating=False, matrix_free=False, contends=False)
    ROW: ClassVar = 3

    def refusals(self, problem: Problem) -> Iterator[Refusal]:
        """Values of `gram` that need a basis of the tractions, which tractions at quadrature points do not have."""
        for name, pair in problem.pairs.items():
            if not pair.contact.normal.at_quadrature:
                continue
            why = f"has no basis in H1 for tractions at the quadrature points of contacts.{name}"
            if self.gram.space == "multiplier":
                yield "gram.space", self.gram.space, f"{why}; use volume"
            if self.gram.unknown == "tractions":
                yield "gram.unknown", self.gram.unknown, f"{why}; use forces"

    def build(self, setup: Setup) -> Ready:
        metric = GramMetric(setup.system, self.gram)
        return GramIteration(metric, relaxation=self.relaxation, rtol=self.rtol, max_it=self.max_it)


@dataclass(frozen=True)
class GramIteration(SameEveryStep):
    """The iteration, with the Gram matrix of the scene."""

    metric: GramMetric
    relaxation: float = 1.5  # [-]
    rtol: float = 1e-8
    max_it: int = 10000

    def renewed(self, setup: Setup) -> Ready:
        return self  # the metric is of the bodies, `on` that of the rows

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        metric = self.metric.on(problem, self.relaxation)

        def solve(p: Array) -> Solved:  # K_B u = R_B - B^T p: one volume solve
            return Solved(p, problem.contact_displacement(p), 1.0)  # alpha is in the metric

        def advance(step: SurfaceProblem, inner: Solved, w: Array, residual: float) -> Array | None:
            found = nearest_in_cone(step, metric, inner.p, w, max(residual, self.rtol))
            return None if found is None else found.p

        return Outer(rtol=self.rtol, max_it=self.max_it, advance=advance)(problem, p, solve, on_step)
