"""DelassusOperator with their compliant faces, F(u) = K_B u + j_n'(u): not linear, solved as exactly as asked."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.linalg import cho_solve
from scipy.sparse.linalg import LinearOperator, eigsh

from geometry.arrays import Array, Ints
from geometry.errors import SolverError
from solvers.contact.admissible_set import ContactBlock
from solvers.interface.problem import SurfaceProblem
from solvers.interface.schur_complement import CholeskyFactor, CondensedSurface
from solvers.laws.compliance import Compliance
from solvers.methods.inner_tolerance import Allowed
from solvers.metrics.dense import DenseMetric, inverse_root

NEWTON_STEPS = 100
HALVINGS = 30
OVERSHOOT = 0.9  # of the slope along a step, that its end may have the other way
ROUNDING = 1e-14  # of the displacement, in energy norm: no solve comes nearer
LANCZOS = 1e-4  # relative error of an eigenvalue


@dataclass(frozen=True)
class CompliantBodies:
    """S u + N_n^T W c_n (u_n - g)_+^m_n = f - B^T p on the contact dofs, p the tractions of all other rows.

    F is the gradient of a convex energy, strongly monotone as S is, and its generalised Jacobian V = S + N^T W k N.

    Source: Pop (1999), (2.1), b(u, v) = a(u, v) + j_n(u, v).
    """

    problem: SurfaceProblem
    surface: CondensedSurface

    @cached_property
    def places(self) -> tuple[tuple[ContactBlock, Compliance], ...]:
        laws = ((place, place.rows.normal) for place in self.problem.cone.places)
        return tuple((place, law) for place, law in laws if isinstance(law, Compliance))

    @cached_property
    def others(self) -> Ints:
        """Rows whose tractions are not a function of displacement."""
        left = self.problem.cone.carrying.copy()
        for place, _ in self.places:
            left[place.normal] = False
        return np.flatnonzero(left)

    def tractions(self, p: Array, u_c: Array) -> Array:
        """p (rows,) with what the compliant faces press at u_c."""
        found, r = p.copy(), self.problem.relative_displacement(u_c) - self.problem.gap
        for place, law in self.places:
            found[place.normal] = law.pressure(r[place.normal])
        return found

    def springs(self, p: Array) -> Array:
        """k (rows,) [Pa/m], the slope of those pressures where they are p."""
        k = np.zeros(len(p))
        for place, law in self.places:
            k[place.normal] = law.stiffness(p[place.normal], p[place.normal])
        return k

    def solve(self, p: Array, u_c: Array, allowed: Allowed) -> tuple[Array, Array, CholeskyFactor]:
        """Tractions (rows,), u_c, and the factor of V there; semismooth Newton from u_c, a volume solve a step.

        Raises:
            SolverError: ||delta|| does not come down to what is allowed.
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
            if np.sqrt(slope) <= max(allowed(first), ROUNDING * np.sqrt(stored)):
                return p, u_c, V
            u_c = u_c + self._length(p, u_c, du, slope) * du
        raise SolverError("the compliant faces' own Newton iteration does not converge; use solver.method = uzawa")

    def lambda_max(self, V: CholeskyFactor) -> float:
        """Largest eigenvalue of W^-1 B V^-1 B^T on the other rows [m/Pa]: what alpha has to heed."""
        N = sparse.diags(np.sqrt(self.surface.W[self.others])) @ self.surface.N[self.others]
        size = len(self.others)
        if size < 3:
            return float(np.linalg.eigvalsh(N @ cho_solve(V, N.T.toarray())).max(initial=0.0))
        operator = LinearOperator((size, size), matvec=lambda x: N @ cho_solve(V, N.T @ x), dtype=float)
        start = 1 + np.sin(np.arange(size))  # the same on every rank, no symmetry
        (largest,) = eigsh(operator, k=1, which="LA", v0=start, tol=LANCZOS, return_eigenvectors=False)
        return float(largest) * (1 + LANCZOS)

    def metric(self, V: CholeskyFactor) -> DenseMetric:
        """B V^-1 B^T on the other rows; the compliant ones keep their pressure while these move."""
        W, size = self.surface.W, len(self.surface.W)
        B = (sparse.diags(W[self.others]) @ self.surface.N[self.others]).toarray()
        Q, on = np.zeros((size, size)), np.zeros(size, bool)
        Q[np.ix_(self.others, self.others)] = B @ cho_solve(V, B.T)
        on[self.others] = True
        return DenseMetric(surface=self.surface, Q=Q, carrying=on, root=inverse_root(Q[np.ix_(on, on)]), alpha=1.0)

    def _left(self, p: Array, u_c: Array) -> Array:
        """delta (c,) [N]."""
        return np.asarray(self.problem.load.f_c - self.surface.forces(p) - self.surface.S @ u_c)

    def _factor(self, p: Array) -> CholeskyFactor:
        N, k = self.surface.N, self.springs(p)
        return self.surface.factor((N.T @ sparse.diags(self.surface.W * k) @ N).toarray())

    def _length(self, p: Array, u_c: Array, du: Array, slope: float) -> float:
        """Of a step along which the energy falls: it is convex, so its slope tells whether the step went too far."""
        length = 1.0
        for _ in range(HALVINGS):
            end = u_c + length * du
            if self._left(self.tractions(p, end), end) @ du >= -OVERSHOOT * slope:
                break
            length /= 2
        return length
