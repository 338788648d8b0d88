"""Nonlinear Uzawa: compliant faces belong to the bodies; only the other tractions are multipliers that are iterated.

The bodies with these faces, F(u) = K_B u + j_n'(u), are a nonlinear problem, solved to a given tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Annotated, ClassVar, Literal

import numpy as np
from scipy import sparse
from scipy.linalg import cho_solve

from stickslip.geometry.arrays import LAST_DIGITS, Array, Ints
from stickslip.geometry.errors import SolverError, require
from stickslip.geometry.keys import Key
from stickslip.solvers.classical.gram_uzawa import DenseMetric, inverse_root
from stickslip.solvers.classical.uzawa import (
    NEWTON_STEPS,
    FrictionUpdates,
    InnerKeys,
    Relaxation,
    Solved,
    negligible,
    projected,
    step_length,
)
from stickslip.solvers.contact.admissible_set import ContactBlock
from stickslip.solvers.interface.discrete import GivenSurface
from stickslip.solvers.interface.prepare import condensed
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.schur_complement import CholeskyFactor, CondensedSurface
from stickslip.solvers.iteration import OnStep, Solution, ignore
from stickslip.solvers.laws.normal import Compliance
from stickslip.solvers.linear.conjugate_gradients import extreme_eigenvalue, without_symmetry
from stickslip.solvers.linear.petsc_solver import Allowed
from stickslip.solvers.methods.method import Applicability, Stateless
from stickslip.solvers.newton.surface_model import nearest_in_cone


@dataclass(frozen=True)
class CompliantBodies:
    """S u + N_n^T W c_n (u_n - g)_+^m_n = f - B^T p on the contact dofs, p the tractions of all other rows.

    The left side F is the gradient of a convex energy and strongly monotone, because S is positive definite. Its
    generalised Jacobian is V = S + N^T W k N.

    Source: Pop (1999), (2.1), b(u, v) = a(u, v) + j_n(u, v).
    """

    problem: SurfaceProblem
    surface: CondensedSurface

    @cached_property
    def places(self) -> tuple[tuple[ContactBlock, Compliance], ...]:
        """Rows and law of each compliant contact."""
        laws = ((place, place.rows.normal) for place in self.problem.cone.places)
        return tuple((place, law) for place, law in laws if isinstance(law, Compliance))

    @cached_property
    def others(self) -> Ints:
        """Indices of the rows whose tractions are multipliers, not a function of the displacement."""
        left = self.problem.cone.carrying.copy()
        for place, _ in self.places:
            left[place.normal] = False
        return np.flatnonzero(left)

    def tractions(self, p: Array, u_c: Array) -> Array:
        """p (rows,) [Pa] with the pressures of the compliant faces replaced by those at u_c (c,) [m]."""
        found, r = p.copy(), self.problem.relative_displacement(u_c) - self.problem.gap
        for place, law in self.places:
            found[place.normal] = law.pressure(r[place.normal])
        return found

    def springs(self, p: Array) -> Array:
        """k (rows,) [Pa/m], derivative of the compliant pressures by the penetration, at pressures p (rows,) [Pa]."""
        k = np.zeros(len(p))
        for place, law in self.places:
            k[place.normal] = law.stiffness(p[place.normal], p[place.normal])
        return k

    def solve(self, p: Array, u_c: Array, allowed: Allowed) -> tuple[Array, Array, CholeskyFactor]:
        """Solve by semismooth Newton from u_c; each iteration is one volume solve.

        Args:
            p: tractions (rows,) [Pa]; those of compliant faces are replaced.
            u_c: displacement (c,) [m] of the contact dofs to start from.
            allowed: largest energy norm ||delta|| of the residual at the end, as a function of that at the start.

        Returns:
            Tractions (rows,) [Pa], displacement (c,) [m], and the Cholesky factor of V there.

        Raises:
            SolverError: ||delta|| does not fall to the allowed value.
        """
        first: float | None = None
        for _ in range(NEWTON_STEPS):
            p = self.tractions(p, u_c)
            V, delta = self._factor(p), self._left(p, u_c)
            du = cho_solve(V, delta)
            self.surface.counters.volume_solves += 1
            slope = float(delta @ du)
            first = np.sqrt(slope) if first is None else first
            stored = abs(float((self.problem.load.f_c - self.surface.forces(p)) @ u_c))
            # relative accuracy of the displacement, in energy norm, that rounding allows
            if np.sqrt(slope) <= max(allowed(first), LAST_DIGITS * np.sqrt(stored)):
                return p, u_c, V
            u_c = u_c + step_length(partial(self._force, p, u_c, du), slope) * du
        raise SolverError("the compliant faces' own Newton iteration does not converge; use solver.method = uzawa")

    def lambda_max(self, V: CholeskyFactor) -> float:
        """Largest eigenvalue [m/Pa] of W^-1 B V^-1 B^T on the rows `others`; it limits alpha."""
        N = sparse.diags(np.sqrt(self.surface.W[self.others])) @ self.surface.N[self.others]
        return extreme_eigenvalue(lambda x: N @ cho_solve(V, N.T @ x), without_symmetry(len(self.others)))

    def metric(self, V: CholeskyFactor) -> DenseMetric:
        """Metric B V^-1 B^T on the rows `others`; in the step, compliant rows keep their pressure."""
        W, size = self.surface.W, len(self.surface.W)
        B = (sparse.diags(W[self.others]) @ self.surface.N[self.others]).toarray()
        Q, on = np.zeros((size, size)), np.zeros(size, bool)
        Q[np.ix_(self.others, self.others)] = B @ cho_solve(V, B.T)
        on[self.others] = True
        return DenseMetric(surface=self.surface, Q=Q, carrying=on, root=inverse_root(Q[np.ix_(on, on)]), alpha=1.0)

    def _left(self, p: Array, u_c: Array) -> Array:
        """Residual delta (c,) [N] of the equilibrium at the contact dofs."""
        return np.asarray(self.problem.load.f_c - self.surface.forces(p) - self.surface.S @ u_c)

    def _force(self, p: Array, u_c: Array, du: Array, length: float) -> float:
        """Work [J] of delta along du (c,) [m] at a length of that step."""
        end = u_c + length * du
        return float(self._left(self.tractions(p, end), end) @ du)

    def _factor(self, p: Array) -> CholeskyFactor:
        N, k = self.surface.N, self.springs(p)
        return self.surface.factor((N.T @ sparse.diags(self.surface.W * k) @ N).toarray())


OuterMetric = Literal["points", "jacobian"]


@dataclass(frozen=True, kw_only=True)
class NonlinearUzawa(Relaxation, FrictionUpdates, InnerKeys, Stateless):
    """F(u_{k+1}) = R_B - B^T p_k + delta_k, then p_{k+1} = argmin over the cone of |q - p_hat|_(Q_k),
    p_hat = p_k + alpha_k Q_k^-1 W (w(u_{k+1}) - gap).

    F(u) = K_B u + j_n'(u) is strongly monotone, and not differentiable where a point just touches; the inner solve is
    semismooth Newton to ||delta_k|| <= tau_k. p_k holds friction, and the pressures of rigid laws. With V_k in the
    generalised Jacobian of F at u_{k+1}:

    points: Q_k = W, the projection is point by point, alpha_k = relaxation / lambda_max(W^-1 B V_k^-1 B^T).
    jacobian: Q_k = B V_k^-1 B^T, alpha_k = 1, and tau_k decreases with the residual: superlinear convergence if the
    friction bounds are given. Bounds that follow the pressure of a compliant face are not in V_k: fast linear
    convergence.

    Source: Chen, SIAM J. Numer. Anal. 35 (1998); Pop (1999), (1.3).
    """

    NAME: ClassVar = "nonlinear-uzawa"
    WHEN: ClassVar = (
        "as published: compliance stays inside the bodies, only what is left is iterated, none without friction. "
        'By points more than a thousand iterations (`block`); with `outer_metric = "jacobian"`, '
        "Chen's Q_k, 1–14, "
        "superlinear where friction is given"
    )
    WORKS_WITH: ClassVar = Applicability(floating=False, matrix_free=False, contends=False)
    ROW: ClassVar = 6

    outer_metric: Annotated[
        OuterMetric,
        Key("-", "nonlinear-uzawa: Q_k of its step; jacobian: B V_k^-1 B^T of the bodies with their compliant faces"),
    ] = "points"

    def __post_init__(self) -> None:
        super().__post_init__()
        ignored = self.outer_metric == "jacobian" and self.relaxation != type(self).relaxation
        require(not ignored, "relaxation", self.relaxation, "changes nothing with outer_metric = jacobian")

    def discrete(self, surface: GivenSurface) -> None:
        """None: its inner solves are of the bodies with their compliant faces."""

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        bodies = CompliantBodies(problem, condensed(problem.surface))
        last: Solved | None = None
        springs, alpha, V = np.full(len(p), np.inf), 1.0, None
        exact, share = self.outer_metric == "jacobian", 1.0

        def solve(p: Array) -> Solved:
            nonlocal last, springs, alpha, V
            start = problem.load.free if last is None else last.u_c
            p, u_c, V = bodies.solve(p, start, self.inner(problem, last, p, share=share))
            if problem.natural_residual(p, problem.relative_displacement(u_c)) <= self.rtol:
                p, u_c, V = bodies.solve(p, u_c, negligible(problem, self.rtol))
            k = bodies.springs(p)
            if len(bodies.others) and np.abs(k - springs).max() > 0.01 * k.max():  # alpha_k is computed anew
                springs, alpha = k, self.relaxation / bodies.lambda_max(V)
            last = Solved(p, u_c, alpha)
            return last

        def advance(step: SurfaceProblem, found: Solved, w: Array, residual: float) -> Array | None:
            nonlocal share
            if not exact:
                return projected(step, found, w, residual)
            assert V is not None  # an inner solve comes first
            share = min(residual, 1.0)
            nearest = nearest_in_cone(step, bodies.metric(V), found.p, w, max(share**2, self.rtol))
            return None if nearest is None else nearest.p

        return self.iteration(advance)(problem, p, solve, on_step)
