"""Bodies with their compliant faces, F(u) = K_B u + j_n'(u): a nonlinear problem, solved to a given tolerance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.linalg import cho_solve
from scipy.sparse.linalg import LinearOperator, eigsh

from stickslip.geometry.arrays import LAST_DIGITS, Array, Ints
from stickslip.geometry.errors import SolverError
from stickslip.solvers.contact.admissible_set import ContactBlock
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.schur_complement import CholeskyFactor, CondensedSurface
from stickslip.solvers.laws.compliance import Compliance
from stickslip.solvers.linear.inner_solver import Allowed
from stickslip.solvers.metrics.dense import DenseMetric, inverse_root

NEWTON_STEPS = 100
HALVINGS = 30
OVERSHOOT = 0.9  # largest slope of the energy at the end of a step, relative to that at its start, of opposite sign
LANCZOS = 1e-4  # relative error of an eigenvalue


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
            u_c = u_c + self._length(p, u_c, du, slope) * du
        raise SolverError("the compliant faces' own Newton iteration does not converge; use solver.method = uzawa")

    def lambda_max(self, V: CholeskyFactor) -> float:
        """Largest eigenvalue [m/Pa] of W^-1 B V^-1 B^T on the rows `others`; it limits alpha."""
        N = sparse.diags(np.sqrt(self.surface.W[self.others])) @ self.surface.N[self.others]
        size = len(self.others)
        if size < 3:
            return float(np.linalg.eigvalsh(N @ cho_solve(V, N.T.toarray())).max(initial=0.0))
        operator = LinearOperator((size, size), matvec=lambda x: N @ cho_solve(V, N.T @ x), dtype=float)
        start = 1 + np.sin(np.arange(size))  # the same on every rank, and without symmetry
        (largest,) = eigsh(operator, k=1, which="LA", v0=start, tol=LANCZOS, return_eigenvectors=False)
        return float(largest) * (1 + LANCZOS)

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

    def _factor(self, p: Array) -> CholeskyFactor:
        N, k = self.surface.N, self.springs(p)
        return self.surface.factor((N.T @ sparse.diags(self.surface.W * k) @ N).toarray())

    def _length(self, p: Array, u_c: Array, du: Array, slope: float) -> float:
        """Length in (0, 1] of the step du (c,) [m], along which the energy falls.

        The energy is convex, so its slope at the end of the step shows whether the step is too long.

        Args:
            slope: minus the slope of the energy at the start [J].
        """
        length = 1.0
        for _ in range(HALVINGS):
            end = u_c + length * du
            if self._left(self.tractions(p, end), end) @ du >= -OVERSHOOT * slope:
                break
            length /= 2
        return length
