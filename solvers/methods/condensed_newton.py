"""Condensed Newton: semismooth Newton, its linear systems solved exactly: with the Schur complement of the bodies.

A discrete problem has a sparse Delassus operator W in its place, often rank-deficient: Newton's systems then are
singular. W + epsilon I with q - epsilon r_k is regular, near to the problem, and at its fixed point r_{k+1} = r_k it is
the problem itself. Newton needs few iterations for each of these proximal points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, cast

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from stickslip.geometry.arrays import Array
from stickslip.solvers.interface.discrete import DiscreteProblem, GivenSurface
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import OnStep, Solution, Status, Step, ignore
from stickslip.solvers.methods.method import Applicability, Solve, Stateless, Turn
from stickslip.solvers.newton import condensed_system
from stickslip.solvers.newton.active_set import ActiveSet
from stickslip.solvers.newton.semismooth import SemismoothNewton
from stickslip.solvers.newton.surface_model import DENSE


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
    first: float = 1e-2  # epsilon, relative to the largest diagonal entry of W, like the next two
    least: float = 1e-10
    most: float = 1e2
    factor: float = 10.0  # by which it rises and falls
    enough: float = 0.1  # residual of a regular problem, of the tolerance
    steps: int = 40  # of Newton's method for one regular problem, before epsilon is raised
    problems: int = 60  # regular ones

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        assert isinstance(problem, DiscreteProblem)
        epsilon, count, successes, patience = self.first, 0, 0, 1
        best = self._judged(problem, p, 0)
        history = list(best.history)
        for _ in range(self.problems):
            if best.status is Status.CONVERGED or count >= self.max_it or epsilon > self.most:
                break
            solve = self.newton(self.enough * self.rtol, min(self.steps, self.max_it - count))
            found = solve(problem.regular(p, epsilon), p, ignore)
            count += found.iterations
            if found.status is Status.CONVERGED:
                p, successes = found.p, successes + 1
                if successes >= patience:
                    epsilon, successes = max(epsilon / self.factor, self.least), 0
            else:
                epsilon, successes, patience = self.factor * epsilon, 0, 2 * patience
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


def solve_given(laws: ActiveSet, u: Array) -> tuple[Array, Array]:
    """Solve a Newton system of a `DiscreteProblem`.

    Args:
        laws: the linearised laws.
        u: displacement of the last iterate (rows,), which anchors rigid modes; there are none here.

    Returns:
        Tractions p (rows,) and displacement of the contact dofs u_c = -W N^T p (rows,).

    Raises:
        LinAlgError: it is singular.
    """
    problem, surface = laws.problem, cast(GivenSurface, laws.problem.surface)
    A = sparse.csc_matrix(laws.A_p - laws.A_w @ (surface.N @ surface.matrix @ surface.N.T))
    right = laws.rhs - laws.A_w @ problem.offset
    if len(right) <= DENSE:
        p = np.linalg.solve(A.toarray(), right)
    else:
        try:
            p = splu(A).solve(right)
        except RuntimeError as error:  # SuperLU: exactly singular
            raise np.linalg.LinAlgError(str(error)) from None
    return p, surface.displacement(-surface.forces(p))


@dataclass(frozen=True, kw_only=True)
class CondensedNewton(Stateless):
    """Semismooth Newton on the condensed surface problem, see `SemismoothNewton`.

    Source: Alart & Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991).
    """

    NAME: ClassVar = "condensed-newton"
    WHEN: ClassVar = (
        "1–16 iterations at every mesh size tried, some tens where plain Newton cycles; needs the condensed form"
    )
    WORKS_WITH: ClassVar = Applicability(floating=True, worn=True, matrix_free=False)
    ROW: ClassVar = 1
    ROWS_ALONE: ClassVar = True
    TURNS: ClassVar = (Turn("condensed", 1),)

    def discrete(self, surface: GivenSurface) -> Solve:
        def newton(rtol: float, max_it: int) -> Solve:
            return SemismoothNewton(rtol=rtol, max_it=max_it, linear=solve_given)

        return ProximalPoints(rtol=self.rtol, max_it=self.max_it, newton=newton)

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        newton = SemismoothNewton(rtol=self.rtol, max_it=self.max_it, linear=condensed_system.solve)
        return newton(problem, p, on_step)
