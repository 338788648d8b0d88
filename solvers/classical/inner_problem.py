"""The inner problem of Uzawa's iteration, F(u) = f - B^T p with F(u) = K u + j_n(u), solved by Newton's method.

F' is K plus the derivative that UFL takes of the form j_n (`ufl.derivative`). Without compliance F is linear.

Source: Pop (1999), (1.3), and (2.1), b(u, v) = a(u, v) + j_n(u, v); Chen, SIAM J. Numer. Anal. 35 (1998).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc
from scipy import sparse

from stickslip.geometry.arrays import LAST_DIGITS, TINY, Array
from stickslip.geometry.errors import SolverError
from stickslip.geometry.protocols import Mat, Vec
from stickslip.solvers.contact.admissible_set import ContactBlock
from stickslip.solvers.fem.contact_forms import ComplianceForms
from stickslip.solvers.fem.point_laws import PointLaw
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.sparse import PREFIX, SparseSurface
from stickslip.solvers.laws.compliance import Compliance
from stickslip.solvers.linear.inner_solver import NOISE, Allowed, InnerSolver
from stickslip.solvers.parallel.distribute import distributed
from stickslip.solvers.system.nodal_contact import FormOfPart, relative_to_obstacle
from stickslip.solvers.system.system import System

NEWTON_STEPS = 100
HALVINGS = 30
OVERSHOOT = 0.9  # largest slope of the energy at the end of a step, relative to that at its start, of opposite sign
SLOW = 0.1  # factor by which ||delta|| falls in an iteration; if less, F' is assembled and factorised anew
INEXACT = 0.1  # of the first residual of a linear solve in Newton's method, where inner solves are iterative


@dataclass(frozen=True)
class CompliantFace:
    """One contact with compliance: its law at the contact points, and its form j_n if one form over the mesh has it."""

    place: ContactBlock
    law: PointLaw
    nominal: Compliance
    form: FormOfPart | None  # None: between bodies, and where contact slides

    def penetration(self, problem: SurfaceProblem, u_c: Array) -> Array:
        """u_n - g (m_n,) [m] at the contact points, u_c (c,) [m] the displacement of the contact dofs."""
        at = self.place.normal
        found: Array = problem.relative_displacement(u_c)[at] - problem.gap[at]
        return found


class InnerProblem:
    """F(u) = K u + j_n(u) on the free displacements q, and the solver of its linear systems."""

    def __init__(self, system: System, surface: SparseSurface) -> None:
        """Compile j_n and its derivative; collective."""
        self.system, self.surface, self.K = system, surface, surface.volume.K
        self.contact, self.counters = surface.volume.contact, system.counters
        self.faces: tuple[CompliantFace, ...] | None = None
        self._solver: InnerSolver | None = None
        self._stale = self._fresh = True
        self._stiffest, self._moved = self.K.getDiagonal().norm(PETSc.NormType.INFINITY), 0.0
        self.renewals = 0  # number of times that F' was assembled and prepared

    def begin(self, problem: SurfaceProblem) -> None:
        """Set the data of a step: prescribed motions and obstacles at its time; collective."""
        self.problem, time = problem, problem.cone.time
        if self.faces is None:
            self.faces = tuple(self._face(place) for place in problem.cone.places if place.rows.normal.at_quadrature)
        u_s = self.system.prescribed(time)
        self._moved = u_s.norm()
        for face in self.faces:
            if face.form is not None:
                relative_to_obstacle(self.system, face.place.rows.name, u_s, time).copy(face.form.shift)
        self._stale = True  # so that a resumed run, which has no factor, goes on with the same bits

    @property
    def linear(self) -> bool:
        return not self.faces

    @property
    def solver(self) -> InnerSolver:
        """Of F' as last prepared; of K where F is linear."""
        if self.linear:
            return self.surface.volume.solver
        assert self._solver is not None
        return self._solver

    def solve(self, rhs: Vec, q: Vec, allowed: Allowed | None) -> None:
        """Improve q until F(q) = rhs to ||delta|| <= `allowed`, exactly without it; collective.

        Raises:
            SolverError: Newton's method, or a linear solve in it, does not converge.
        """
        if self.linear:
            self.solver.solve(rhs, q, allowed)
            return
        self._press_on(rhs, q)
        if self._stale:
            self._renew(q)
        first, before = 0.0, np.inf
        for k in range(NEWTON_STEPS):
            delta = rhs - self.F(q)
            dq, slope = self._newton(delta)
            if slope > (SLOW * before) ** 2 and k and not self._fresh:
                self._renew(q)
                dq, slope = self._newton(delta)
            self._fresh = False
            size = float(np.sqrt(max(slope, 0.0)))
            first = first or size
            # relative accuracy of the displacement, in energy norm, that rounding allows
            rounding = LAST_DIGITS * max(first, float(np.sqrt(max((self.K * q).dot(q), 0.0))))
            if size <= max(allowed(first) if allowed else 0.0, rounding) or delta.norm() <= self.rounding(q):
                return
            q.axpy(self._length(rhs, q, dq, slope), dq)
            before = size
        raise SolverError(
            "the inner Newton iteration for F(u) = K u + j_n(u) does not converge: try method = condensed-newton"
        )

    def rounding(self, q: Vec) -> float:
        """Norm [N] below which a residual at q [m] is rounding of F(u)."""
        return NOISE * self._stiffest * float(np.hypot(q.norm(), self._moved))

    def F(self, q: Vec) -> Vec:
        """F(q) = K q + j_n(q) over the free displacements [N]; collective."""
        total = self.K * q
        u_c = self.contact.read(q)
        force, between = np.zeros(len(u_c)), False
        for face in self.faces or ():
            if face.form is not None:
                face.form.at(q)
                face.form.add_forces(total)
                continue
            p = np.zeros(len(self.problem.gap))
            p[face.place.normal] = face.law.pressure(face.penetration(self.problem, u_c))
            force, between = force + self.surface.forces(p), True
        return total + self.on_contact(force) if between else total

    def tangent(self, q: Vec) -> Mat:
        """F'(q) = K + dj_n/du (free, free) [N/m]; collective."""
        J, u_c = self.K.copy(), self.contact.read(q)
        for face in self.faces or ():
            if face.form is not None:
                face.form.at(q)
                face.form.add_tangent(J)
            else:
                k = face.law.stiffness(face.penetration(self.problem, u_c))
                J.axpy(1.0, self._springs(face, k), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        return J

    def with_springs(self, k: Array) -> Mat:
        """K + N^T W k N (free, free) [N/m] with springs k (rows,) [Pa/m] at the points of compliant faces."""
        J = self.K.copy() if self.faces else self.K
        for face in self.faces or ():
            J.axpy(1.0, self._springs(face, k[face.place.normal]), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        return J

    def on_contact(self, forces: Array) -> Vec:
        """Forces (c,) [N] at the contact dofs over the free displacements."""
        found = self.K.createVecRight()
        self.contact.write(found, forces)
        return found

    def tractions(self, p: Array, u_c: Array) -> Array:
        """p (rows,) [Pa] with the pressures of compliant faces replaced by those at u_c (c,) [m]."""
        found = p.copy()
        for face in self.faces or ():
            found[face.place.normal] = face.law.pressure(face.penetration(self.problem, u_c))
        return found

    def _face(self, place: ContactBlock) -> CompliantFace:
        system, law = self.system, place.rows.normal
        assert isinstance(law, Compliance)
        contact, form = system.problem.pairs[place.rows.name].contact, None
        if place.rows.master is None and not contact.sliding:
            forms = ComplianceForms(system.weak, contact, law)
            work, tangent = system.weak.compile(forms.work), system.weak.compile(forms.tangent)
            form = FormOfPart(forms.relative, system.T, system.vector(), work, tangent)
        self.counters.forms += 2
        return CompliantFace(place, PointLaw(law, len(place.rows.W_n)), law, form)

    def _newton(self, delta: Vec) -> tuple[Vec, float]:
        """Newton's step V^-1 delta, and delta . V^-1 delta [J], with V the tangent as last prepared."""
        dq = delta.duplicate()
        self.solver.solve(delta, dq, (lambda start: INEXACT * start) if self.solver.iterative else None)
        return dq, float(delta.dot(dq))

    def _renew(self, q: Vec) -> None:
        """Assemble and prepare F' at q; collective."""
        J = self.tangent(q)
        if self._solver is None:
            self._solver = self.surface.volume.inner_solver(J)
        else:
            self._solver.renew(J)
        self._stiffest = J.getDiagonal().norm(PETSc.NormType.INFINITY)  # springs too: u_n - g has the rounding of u
        self._stale, self._fresh, self.renewals = False, True, self.renewals + 1

    def _press_on(self, rhs: Vec, q: Vec) -> None:
        """Press a floating body that nothing touches yet onto its compliant faces, as if all their points were closed.

        Its F' is singular. Springs from the gap have the stiffness of the law at the scale of tractions of the step.
        """
        u_c = self.contact.read(q)
        faces = self.faces or ()
        if not self.surface.floating or any(np.any(face.penetration(self.problem, u_c) > 0) for face in faces):
            return
        k, p_ref = np.zeros(len(self.problem.gap)), max(self.problem.p_ref, TINY)
        for face in faces:
            p = np.full(len(face.place.rows.W_n), p_ref)
            k[face.place.normal] = p / face.nominal.penetration(p)  # secant
        apart = self.problem.relative_displacement(u_c) - self.problem.gap
        force, dq = self.on_contact(self.surface.forces(k * apart)), q.duplicate()
        InnerSolver(self.with_springs(k), PREFIX, self.counters).solve(rhs - self.K * q - force, dq)
        q += dq

    def _springs(self, face: CompliantFace, k: Array) -> Mat:
        """N^T W k N (free, free) [N/m] of springs k (m_n,) [Pa/m] at the points of a face."""
        N, W = self.surface.N[face.place.normal], self.surface.W[face.place.normal]
        local = (N.T @ sparse.diags(W * k) @ N).tocoo()
        dofs, free = self.contact.rows, self.K.createVecRight()
        entries = local.data, (dofs[local.row], dofs[local.col])
        return distributed(sparse.csr_matrix(entries, shape=(free.getSize(), free.getSize())), free, free)

    def _length(self, rhs: Vec, q: Vec, dq: Vec, slope: float) -> float:
        """Length in (0, 1] of the step, along which the convex energy falls; slope: minus that at its start [J]."""
        length = 1.0
        for _ in range(HALVINGS):
            if (rhs - self.F(q + length * dq)).dot(dq) >= -OVERSHOOT * slope:
                break
            length /= 2
        return length
