"""A model of the contact problem with an approximate Delassus operator, solved on the surface by semismooth Newton.

Its linear systems are solved densely where there are few contact rows, else by GMRES.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.interface.flexibility import DelassusOperator
from stickslip.solvers.interface.limit_analysis import balancing_tractions
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Status
from stickslip.solvers.metrics import Secants, SurfaceMetric
from stickslip.solvers.newton.active_set import ActiveSet
from stickslip.solvers.newton.attempts import FIRM, Attempts, Start, again, closed
from stickslip.solvers.newton.condensed_system import saddle_point


def gmres(
    A: Callable[[Array], Array], b: Array, x: Array, M: Callable[[Array], Array], atol: float, max_it: int = 200
) -> tuple[Array, float]:
    """Solve A x = b.

    Args:
        A: linear map (n,) to (n,).
        b: right-hand side (n,).
        x: start (n,).
        M: the preconditioner, a linear map that approximates A^-1.
        atol: 2-norm of the residual at which to stop, in the unit of b.
        max_it: largest number of iterations; there are no restarts.

    Returns:
        x (n,) with ||b - A x||_2 <= atol, or the best after max_it iterations; and that norm.

    Source: Saad & Schultz, SIAM J. Sci. Stat. Comput. 7 (1986).
    """
    r = b - A(x)
    left = float(np.linalg.norm(r))
    if not left > atol:
        return x, left
    V, Z = [r / left], []
    R, rotated = np.zeros((max_it, max_it)), np.zeros(max_it + 1)
    rotated[0] = left
    cosines, sines = np.zeros(max_it), np.zeros(max_it)
    k = 0
    while k < max_it and left > atol:
        Z.append(M(V[k]))
        new, basis = A(Z[k]), np.array(V)
        h = basis @ new
        new = new - h @ basis
        again = basis @ new  # Gram-Schmidt twice keeps the basis orthogonal
        new -= again @ basis
        h += again
        size = float(np.linalg.norm(new))
        for i in range(k):
            h[i], h[i + 1] = cosines[i] * h[i] + sines[i] * h[i + 1], cosines[i] * h[i + 1] - sines[i] * h[i]
        radius = np.hypot(h[k], size)
        if not radius > 0:
            break
        cosines[k], sines[k] = h[k] / radius, size / radius
        h[k] = radius
        R[: k + 1, k] = h
        rotated[k : k + 2] = cosines[k] * rotated[k], -sines[k] * rotated[k]
        left = abs(float(rotated[k + 1]))
        k += 1
        if not size > 0:
            break
        V.append(new / size)
    return x + np.linalg.solve(R[:k, :k], rotated[:k]) @ np.array(Z[:k]) if k else x, left


DENSE = 200  # largest number of contact rows for a dense factorisation


class Metric(Protocol):
    """An approximate Delassus operator W^-1 Q: the metric in which a step of Uzawa's method projects."""

    @property
    def matrix(self) -> Array: ...  # (rows, rows) [m/Pa]

    @property
    def diagonal(self) -> Array: ...  # (rows,) [m/Pa], approximately that of `matrix`

    def __call__(self, p: Array) -> Array: ...  # tractions (rows,) [Pa] to relative displacement (rows,) [m]

    def inverse(self, w: Array) -> Array: ...  # (rows,) [m] to (rows,) [Pa], approximately: preconditions GMRES


@dataclass(frozen=True, kw_only=True)
class Flexibility:
    """The approximate Delassus operator G = N F N^T W, F the secant approximation of K_B^-1 on the contact dofs."""

    surface: DelassusOperator
    F: Secants
    metric: SurfaceMetric

    def __call__(self, p: Array) -> Array:
        """Relative displacement (rows,) [m] of tractions (rows,) [Pa]."""
        return np.asarray(self.surface.N @ self.F(self.surface.forces(p)))

    @cached_property
    def matrix(self) -> Array:
        """G (rows, rows) [m/Pa]."""
        return np.asarray(self.surface.N @ self.F(self.surface.N.T.toarray() * self.surface.W))

    @cached_property
    def _share(self) -> Sparse:
        """(rows, c): share of each contact dof in a row's relative displacement, in proportion to its compliance."""
        N = self.surface.N[:, : self.metric.size]
        give = N.multiply(N) @ self.metric.compliance
        part = np.divide(1.0, give, out=np.zeros_like(give), where=give > 0)  # held dofs alone: no compliance
        return sparse.diags(part) @ N @ sparse.diags(self.metric.compliance)

    def inverse(self, w: Array) -> Array:
        """Tractions (rows,) [Pa] that cause about w (rows,) [m]: for nodal rows spectrally equivalent to G^-1."""
        return np.asarray(self._share @ self.metric.stiffness(self._share.T @ w) / self.surface.W)

    @cached_property
    def diagonal(self) -> Array:
        """Approximate diagonal of G (rows,) [m/Pa]."""
        N = self.surface.N[:, : self.metric.size]
        return np.asarray(N.multiply(N) @ self.metric.diagonal * self.surface.W)


class SurfaceSystem:
    """A_p p + A_w (w_0 - G p + N R b) = rhs on the rows that carry traction, and R^T B^T p = R^T f: a saddle point."""

    def __init__(self, laws: ActiveSet, gamma: Array, flexibility: Metric, w_0: Array) -> None:
        """
        Args:
            laws: the active set, A_p, A_w and rhs.
            gamma: (rows,) [Pa/m], see `linearise`.
            flexibility: G.
            w_0: relative displacement (rows,) [m] of the model at p = 0, b = 0.
        """
        self.laws, self.problem, self.flexibility = laws, laws.problem, flexibility
        surface = self.problem.surface
        self.rows = np.flatnonzero(laws.held | laws.slip | (laws.k > 0))
        self.held = laws.held[self.rows]  # their A_p is zero, or that of a small proximal term
        k = laws.k[self.rows]
        scale = np.where(
            k > 0, gamma[self.rows] / np.where(k > 0, k, 1.0), 1.0
        )  # so that springs are weighted as held rows are
        self.A_p = (sparse.diags(scale) @ laws.A_p[self.rows])[:, self.rows].tocsr()
        self.A_w = (sparse.diags(scale) @ laws.A_w[self.rows]).tocsr()
        rhs = scale * laws.rhs[self.rows]
        NR = surface.N @ surface.R
        self.C = np.asarray(self.A_w @ NR)  # (m, r)
        self.H = NR[self.rows].T * surface.W[self.rows]  # (r, m)
        self.right = np.concatenate([rhs - self.A_w @ w_0, self.problem.load.resultant])

    def solve(self, p: Array, b: Array, leave: float) -> tuple[Array, Array]:
        """Solve for tractions (rows,) [Pa] and rigid motions (r,) [m].

        Args:
            p, b: start of GMRES.
            leave: 2-norm of the residual [Pa] at which it stops.

        Raises:
            LinAlgError: the active set leaves a rigid mode free.
        """
        m = len(self.rows)
        found = self._dense() if len(p) <= DENSE else self._iterate(np.concatenate([p[self.rows], b]), leave)
        full = np.zeros(len(p))
        full[self.rows] = found[:m]
        self.laws.refuse_unbalanced(full)
        return full, found[m:]

    def _dense(self) -> Array:
        m, nothing = len(self.rows), np.zeros((len(self.H), len(self.H)))
        inner = self.A_p.toarray() - self.A_w @ self.flexibility.matrix[:, self.rows]
        return np.concatenate(saddle_point(inner, self.C, self.H, nothing, self.right[:m], self.right[m:]))

    def _iterate(self, x: Array, leave: float) -> Array:
        m = len(self.rows)
        approximate = self._preconditioner()
        out_of_balance = np.concatenate([np.zeros(m), self.right[m:] - self.H @ x[:m]])
        if len(self.H):
            x = x + approximate(out_of_balance)  # from here on every iterate balances the loads
        began = float(np.linalg.norm(self.right - self._apply(x)))
        x, left = gmres(self._apply, self.right, x, approximate, leave)
        if left > max(leave, 0.5 * began):
            raise np.linalg.LinAlgError("GMRES does not converge: some rigid motion is hardly held")
        return x

    def _apply(self, x: Array) -> Array:
        m = len(self.rows)
        p = np.zeros(len(self.problem.gap))
        p[self.rows] = x[:m]
        carried = self.A_p @ x[:m] - self.A_w @ self.flexibility(p) + self.C @ x[m:]
        return np.concatenate([carried, self.H @ x[:m]])

    def _preconditioner(self) -> Callable[[Array], Array]:
        """Block preconditioner: held rows by the inverse metric, then the others with G's diagonal.

        Rigid motions are eliminated exactly, by the Schur complement on them.
        """
        m, flexibility = len(self.rows), self.flexibility
        pure = self.held
        mixed = np.flatnonzero(~pure)
        scale = self.A_w[:, self.rows].diagonal()
        local = (self.A_p - self.A_w[:, self.rows] @ sparse.diags(flexibility.diagonal[self.rows]))[mixed]
        try:
            others = splu(sparse.csc_matrix(local[:, mixed])) if len(mixed) else None
        except RuntimeError as error:  # SuperLU: exactly singular
            raise np.linalg.LinAlgError(str(error)) from None
        follow = self.A_p[mixed]

        def inner(r: Array) -> Array:
            w = np.zeros(len(self.problem.gap))
            w[self.rows[pure]] = -r[pure] / scale[pure]
            p = np.where(pure, flexibility.inverse(w)[self.rows], 0.0)
            if others is not None:
                p[mixed] = others.solve(r[mixed] - follow @ p)
            return p

        if not len(self.H):
            return inner
        moved = np.column_stack([inner(column) for column in self.C.T])
        schur = self.H @ moved

        def balanced(r: Array) -> Array:
            p = inner(r[:m])
            b = np.linalg.solve(schur, self.H @ p - r[m:])
            return np.concatenate([p - moved @ b, b])

        return balanced


@dataclass(frozen=True, kw_only=True)
class ModelSolution:
    """An iterate of the model: tractions and rigid motions."""

    p: Array  # (rows,) [Pa]
    b: Array  # (r,) [m]
    residual: float  # complementarity residual of the model


@dataclass(frozen=True, kw_only=True)
class SurfaceModel:
    """w(q, b) = w - G (q - p) + N R b about tractions p whose w is known, with R^T (f - B^T q) = 0.

    G approximates the Delassus operator.
    """

    problem: SurfaceProblem
    flexibility: Metric  # G
    p: Array  # (rows,) [Pa]
    w: Array  # (rows,) [m]
    enough: float  # residual to which it is to be solved [-]

    def relative(self, p: Array, u: Array) -> Array:
        """Relative displacement (rows,) [m] at tractions p (rows,) [Pa] and rigid motions u = b (r,) [m]."""
        surface = self.problem.surface
        return np.asarray(self.w - self.flexibility(p - self.p) + surface.N @ (surface.R @ u))

    def solve(self, laws: ActiveSet, p: Array, u: Array) -> tuple[Array, Array]:
        """Tractions (rows,) [Pa] and rigid motions b (r,) [m] that satisfy the linearised laws; p and u start GMRES.

        Raises:
            LinAlgError: the active set leaves a rigid mode free.
        """
        problem, known = self.problem, self.w + self.flexibility(self.p)
        scale = min(problem.p_ref, problem.u_ref * float(problem.gamma.min(initial=np.inf)))
        if self.p.any():
            scale = min(scale, problem.scales.of_tractions(self.p))
        system = SurfaceSystem(laws, problem.gamma, self.flexibility, known)
        found = system.solve(p, u, 0.3 * self.enough * scale)  # what each linear system may leave
        return problem.surface.agreed(found[0]), problem.surface.agreed(found[1])  # what is learnt is shared by ranks


def nearest_in_cone(
    problem: SurfaceProblem, metric: Metric, p: Array, w: Array, residual: float
) -> ModelSolution | None:
    """A step of Uzawa's method in the metric G: the admissible q nearest to p_hat = p + G^-1 (w - gap).

    Args:
        problem: the contact problem of the step.
        metric: G.
        p: tractions (rows,) [Pa].
        w: their relative displacement (rows,) [m].
        residual: that of p, or the tolerance if that is larger.

    Returns:
        None if no active set held the bodies.
    """
    model = SurfaceModel(problem=problem, flexibility=metric, p=p, w=w, enough=0.1 * min(residual, 1.0))
    attempt = Attempts(problem, model, rtol=model.enough, max_it=1000)  # Newton iterations
    best = attempt.follow(_chain(model, residual, attempt))
    if best.status is Status.NO_HOLD:
        return None
    return ModelSolution(p=best.p, b=best.u_c, residual=best.residual)


def _chain(model: SurfaceModel, residual: float, attempts: Attempts) -> Iterator[tuple[Start, float | None]]:
    """Plain Newton from several starts, then damped from the best iterate."""
    nowhere = np.zeros(model.problem.surface.R.shape[1])
    for p_hat, factor in _starts(model.problem, model.p, model.w, residual):
        yield Start(p=model.p, u_c=nowhere, p_hat=p_hat, factor=factor, in_equilibrium=False), None
    for proximal in FIRM:
        assert attempts.best is not None
        if attempts.best.status is not Status.NO_HOLD:
            yield again(model.problem, attempts.best), proximal


def _starts(problem: SurfaceProblem, p: Array, w: Array, residual: float) -> Iterator[tuple[Array, float]]:
    """Starts of Newton, trial tractions and a factor of gamma: those of p, all rows closed, balance of rigid bodies."""
    if np.isfinite(residual):
        for factor in (1.0, 10.0, 0.1):
            yield p + factor * problem.gamma * (w - problem.gap), factor
    elif p.any():
        yield p, 1.0
    yield closed(problem), 1.0
    if problem.surface.floating:
        rigid = balancing_tractions(problem)
        if rigid is not None:
            yield rigid, 1.0
