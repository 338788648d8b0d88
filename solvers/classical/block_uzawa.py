"""Block Uzawa: the method as published, on the block system that dolfinx assembles from UFL forms.

[ F'  B^T ] [u]   [f]     F(u) = K u + j_n(u),  F' by ufl.derivative
[ B   -C  ] [p] = [g]     p = (p_n, t),  t = s lambda,  |lambda| <= 1
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import Array
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import Vec
from stickslip.solvers.classical.block_matrices import PREFIX, SPLITS
from stickslip.solvers.classical.block_system import BlockSystem, NestedSystem
from stickslip.solvers.classical.gram_uzawa import DenseMetric, GramKeys, GramMetric, inverse_root
from stickslip.solvers.classical.uzawa import FixedStep, InnerKeys, Solved, projected
from stickslip.solvers.interface.flexibility import DelassusOperator
from stickslip.solvers.interface.prepare import uncondensed
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Convergence, OnStep, Solution, Status, ignore
from stickslip.solvers.linear.conjugate_gradients import extreme_eigenvalue, without_symmetry
from stickslip.solvers.linear.petsc_solver import PetscOptions
from stickslip.solvers.methods.method import Applicability, Before, Method, Ready, Refusal, Setup, Solve, keys_of
from stickslip.solvers.newton.semismooth import SemismoothNewton
from stickslip.solvers.newton.surface_model import nearest_in_cone
from stickslip.solvers.parallel.serialise import Plain
from stickslip.solvers.scene.problem import Problem

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class BlockUzawa(FixedStep, GramKeys, InnerKeys, Method):
    """F(u_{k+1}) = f - B^T p_k + delta_k, then p_{k+1} = P_C(p_k + alpha Q^-1 (B u_{k+1} - C p_k - g)).

    p holds the pressures of rigid laws and the tangential tractions t = s lambda. The projection is onto p_n >= 0 and
    |lambda| <= 1, as |t| <= s, so that nothing is divided by s = 0; C enters implicitly, which is (1.2) with the
    preconditioner Q + alpha C. sigma_T = -s lambda after (2.6); the last inner solve gives the u that belongs to it.

    Inner solves are exact, delta_k = 0, or inexact (1.2) with ||delta_k|| <= tau_k by `inner_rule`; with compliance F
    is not linear (1.3). Q: the surface mass W (`mass`), or the trailing block of the Cholesky factor of a Gram matrix
    of H1 (`gram`, (5.6)), complete or incomplete. alpha = relaxation / lambda_1, lambda_1 the largest eigenvalue of
    Q^-1 B F'^-1 B^T by Lanczos' method, measured again when F' is.

    Nothing is condensed: what the condensed methods compute is held to this method, and this method to them.

    Source: Pop (1999), (1.1)-(1.3), (2.6), (5.3)-(5.7); Elman & Golub, SIAM J. Numer. Anal. 31 (1994); Bramble, Pasciak
    & Vassilev, ibid. 34 (1997); Chen, ibid. 35 (1998).
    """

    NAME: ClassVar = "block-uzawa"
    WHEN: ClassVar = (
        "what the source writes, to read and to check by: UFL forms, dolfinx's block matrices, Uzawa on λ. Nothing is "
        "condensed: each of its 10 to 180 iterations a step (`gram`; `mass` thousands) is a solve of the bodies; with "
        '`outer = "ksp"` Newton on the nest, any fieldsplit by `petsc_options`'
    )
    WORKS_WITH: ClassVar = Applicability(
        shared=False, floating=False, bedded=True, fields=False, condensed=False, matrix_free=False, contends=False
    )
    ROW: ClassVar = 8

    preconditioner: Annotated[
        Literal["gram", "mass"], Key("-", "block-uzawa: Q, from the Gram matrix `gram`, or the surface mass")
    ] = "gram"
    inner_solves: Annotated[
        Literal["exact", "inexact"],
        Key("-", "block-uzawa: by a factor; or by conjugate gradients with multigrid to inner_tolerance"),
    ] = "exact"
    outer: Annotated[
        Literal["uzawa", "ksp"],
        Key("-", "block-uzawa: Uzawa's iteration; or semismooth Newton, the nest of each active set solved by a KSP"),
    ] = "uzawa"
    rates: Annotated[bool, Key("-", "block-uzawa: also measure the smallest eigenvalue, for the theorem's rate")] = (
        False
    )
    petsc_options: Annotated[
        str,
        Key("-", 'block-uzawa: options of PETSc, for example "-fieldsplit_u_ksp_type cg -fieldsplit_u_pc_type gamg"'),
    ] = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.options()  # refuses what is no option

    def refusals(self, problem: Problem) -> Iterator[Refusal]:
        """Keys that have no effect together."""
        if self.outer == "ksp":
            default = BlockUzawa()
            for key in [key for key in keys_of(BlockUzawa) if key not in ("outer", "petsc_options")]:
                if getattr(self, key) != getattr(default, key):
                    yield key, getattr(self, key), 'with outer = "ksp" does not use it; use outer = "uzawa"'
        elif self.preconditioner == "gram" and self.alpha is not None:
            yield "alpha", self.alpha, 'has it as the step of Q = W; use preconditioner = "mass"'

    def options(self) -> PetscOptions:
        """The user's options of PETSc.

        Raises:
            SceneError: a word is no option, or PETSc refuses it.
        """
        return PetscOptions(self.petsc_options, PREFIX, SPLITS)

    def build(self, setup: Setup) -> Ready:
        return OnBlocks(self, setup)


class OnBlocks(Ready):
    """The iteration on the assembled blocks."""

    def __init__(self, method: BlockUzawa, setup: Setup, known: OnBlocks | None = None) -> None:
        """Assemble the blocks, and the Gram matrix if it is asked for; collective.

        Args:
            known: the iteration for other contact rows of the same bodies.
        """
        self.method, self.surface = method, uncondensed(setup.surface)
        self.options: PetscOptions = known.options if known else method.options()
        self.surface.volume.iterative, self.surface.volume.options = method.inner_solves == "inexact", self.options
        self.blocks = BlockSystem(setup.system, self.surface)
        self.lambda_1: float | None = None
        self._measured_at: int | None = None
        self.peak: float = known.peak if known else 0.0  # largest q . K q so far [J], where inner solves are not exact
        gram = method.preconditioner == "gram" and method.outer == "uzawa" and len(self.blocks.rows) > 0
        self._gram = GramMetric(setup.system, method.gram) if gram else None
        self._dense: DenseMetric | None = None

    def renewed(self, setup: Setup) -> Ready:
        return OnBlocks(self.method, setup, self)

    def snapshot(self) -> dict[str, Plain]:
        return {"lambda_1": self.lambda_1, "peak": self.peak}

    def restore(self, snapshot: dict[str, Plain], surface: DelassusOperator) -> None:
        self.peak, self.lambda_1 = snapshot["peak"], snapshot["lambda_1"]
        self._measured_at = None if self.lambda_1 is None else 0

    def after(self, state: Before) -> Solve:
        return partial(self.step, state.u)

    def step(self, u: Vec, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        """Solve one step from displacement u [m] of all dofs and tractions p (rows,) [Pa]; see `SameEveryStep`."""
        q = self.blocks.begin(problem, u)
        solve = self._newton if self.method.outer == "ksp" else self._uzawa
        found, exact = solve(problem, p, q, on_step)
        for option in self.options.unused():
            log.warning("solver.petsc_options: PETSc does not use %s with outer = %s", option, self.method.outer)
        self.surface.q = q  # u after (2.6): of these tractions
        self.surface.linear_error = 0.0 if exact else self._linear_error(found.p, q)
        return found

    def _linear_error(self, p: Array, q: Vec) -> float:
        """Error that inner solves have left, in the energy norm, relative to the largest displacement so far [-]."""
        self.peak = max(self.peak, self.blocks.stored(q))
        return self.blocks.inner_error(p, q) / float(np.sqrt(self.peak)) if self.peak else 0.0

    def _newton(self, problem: SurfaceProblem, p: Array, q: Vec, on_step: OnStep) -> tuple[Solution, bool]:
        """Semismooth Newton on the nest, and whether all solves were by a factor; improves q [m] in place."""
        linear = NestedSystem(self.blocks, q, self.options, self.method.rtol)
        newton = SemismoothNewton(rtol=self.method.rtol, max_it=self.method.max_it, linear=linear)
        found = newton(problem, p, on_step)
        if found.status is Status.CONVERGED and found.u_c is not linear.u_c:
            self.blocks.solve(found.p, q, None)  # a start was the answer: q is not yet its displacement
            return found, self.blocks.inner.solver.direct
        return found, linear.direct

    def _uzawa(self, problem: SurfaceProblem, p: Array, q: Vec, on_step: OnStep) -> tuple[Solution, bool]:
        """Uzawa's iteration, and whether all inner solves were by a factor; improves q [m] in place."""
        method, blocks, inexact = self.method, self.blocks, self.method.inner_solves == "inexact"
        last: Solved | None = None

        def solve(p: Array) -> Solved:  # F(u_{k+1}) = f - B^T p_k + delta_k
            nonlocal last
            change = None if last is None else 0.3 * self._norm(p - last.p)
            allowed = method.inner(problem, last, p, change) if inexact else None
            p, u_c = blocks.solve(p, q, allowed)
            if inexact and problem.natural_residual(p, problem.relative_displacement(u_c)) <= method.rtol:
                p, u_c = blocks.solve(p, q, None)  # delta = 0: the residual is that of the answer
            self._measure()
            last = Solved(p, u_c, self.alpha)
            return last

        def advance(step: SurfaceProblem, found: Solved, w: Array, residual: float) -> Array | None:
            if self._gram is None:  # p_{k+1} = P_C(p_k + alpha W^-1 (B u_{k+1} - C p - g)), point by point
                return projected(step, found, w, residual)
            nearest = nearest_in_cone(step, self._metric, found.p, w, max(residual, method.rtol))
            return None if nearest is None else nearest.p

        found = method.iteration(advance)(problem, p, solve, on_step)
        return replace(found, convergence=self._convergence(found)), blocks.inner.solver.direct

    @property
    def alpha(self) -> float:
        """alpha = relaxation / lambda_1, below 2 / lambda_1; or as given."""
        assert self.lambda_1 is not None
        return self.method.alpha or self.method.relaxation / self.lambda_1

    @cached_property
    def _root(self) -> Any:  # an array, or a sparse matrix
        """T with T T^T = Q^-1 on the multipliers that may be non-zero."""
        rows = self.blocks.rows
        if self._gram is None:
            return sparse.diags(1 / np.sqrt(self.surface.W[rows]), format="csr")
        return inverse_root(self._Q[np.ix_(rows, rows)])

    @cached_property
    def _Q(self) -> Any:  # likewise
        """The metric (rows, rows): the surface mass, or the Gram matrix, which is zero but for rows of multipliers."""
        if self._gram is None:
            return sparse.diags(self.surface.W, format="csr")
        rows, Q = self.blocks.rows, self._gram.on_tractions(self.surface, self.blocks.cone)
        found = np.zeros_like(Q)
        found[np.ix_(rows, rows)] = Q[np.ix_(rows, rows)]
        return found

    @property
    def _metric(self) -> DenseMetric:
        """Q / alpha; compliant rows keep their pressure in it."""
        if self._dense is None or self._dense.alpha != self.alpha:
            on = np.zeros(len(self.surface.W), bool)
            on[self.blocks.rows] = True
            self._dense = DenseMetric(surface=self.surface, Q=self._Q, carrying=on, root=self._root, alpha=self.alpha)
        return self._dense

    def _norm(self, p: Array) -> float:
        """Norm of a change of tractions (rows,) [Pa] in the metric Q / alpha: about an energy norm [J^(1/2)]."""
        return float(np.sqrt(max(float(p @ (self._Q @ p)), 0.0) / self.alpha))

    def _preconditioned(self, x: Array) -> Array:
        """T^T (B F'^-1 B^T) T x: similar to Q^-1 B F'^-1 B^T."""
        counters = self.surface.counters
        p, before = np.zeros(len(self.surface.W)), (counters.volume_solves, counters.linear_iterations)
        p[self.blocks.rows] = self._root @ x
        forces = self.surface.W[self.blocks.rows] * self.blocks.response(p)[self.blocks.rows]
        counters.lanczos_applications += 1
        counters.volume_solves, counters.linear_iterations = before
        return np.asarray(self._root.T @ forces)

    def _eigenvalue(self, which: Literal["LA", "SA"]) -> float:
        """Largest or smallest eigenvalue of Q^-1 B F'^-1 B^T; the start does not depend on the columns of T."""
        rows = self.blocks.rows
        start = self._root.T @ (self._Q[rows][:, rows] @ without_symmetry(len(rows)))
        return extreme_eigenvalue(self._preconditioned, np.asarray(start), which)

    def _measure(self) -> None:
        """Measure lambda_1, unless F' is still that of the last measurement; collective."""
        if self._measured_at != self.blocks.renewals:
            self.lambda_1 = self._eigenvalue("LA") if len(self.blocks.rows) else 1.0
            self._measured_at = self.blocks.renewals

    def _convergence(self, found: Solution) -> Convergence | None:
        """Compare theory's statement on the step with what happened; collective if `rates` is asked for."""
        if self.lambda_1 is None or not len(self.blocks.rows):
            return None
        alpha, lambda_1, lambda_m = self.alpha, self.lambda_1, None
        if self.method.rates:
            lambda_m = self._eigenvalue("SA")
        return Convergence(
            preconditioner=self.method.preconditioner,
            alpha=alpha,
            lambda_1=lambda_1,
            lambda_m=lambda_m,
            bound=None if lambda_m is None else max(abs(1 - alpha * lambda_1), abs(1 - alpha * lambda_m)),
            observed=found.contraction,
            residuals=tuple(step.residual for step in found.history),
        )
