"""The block system of a scene: F' and B, C of all contacts, for Uzawa's iteration, and as one nest for Newton's method.

The inner problem of Uzawa's iteration, F(u) = f - B^T p with F(u) = K u + j_n(u), is solved by Newton's method; F' is K
plus the derivative that UFL takes of the form j_n (`ufl.derivative`). Without compliance F is linear. In semismooth
Newton's systems a KSP solves the nest of an active set: rows of open points and of slip are in place of those of B and
-C; all others are those of the source, (5.3).

Source: Pop (1999), (1.3), and (2.1), b(u, v) = a(u, v) + j_n(u, v); Chen, SIAM J. Numer. Anal. 35 (1998).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from petsc4py import PETSc
from scipy import sparse

from stickslip.geometry.arrays import EXACT, HALF_DIGITS, LAST_DIGITS, Array, Ints
from stickslip.geometry.errors import SolverError
from stickslip.geometry.protocols import Mat, Sparse, Vec
from stickslip.solvers.classical.block_matrices import (
    Multipliers,
    assemble_B,
    assemble_C,
    backward_error,
    nested,
    solve,
)
from stickslip.solvers.classical.uzawa import NEWTON_STEPS, step_length
from stickslip.solvers.contact.admissible_set import AdmissibleSet, ContactBlock
from stickslip.solvers.fem.contact_forms import ComplianceForms, PointLaw
from stickslip.solvers.interface.prepare import PREFIX, SparseSurface
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.laws.normal import Compliance
from stickslip.solvers.linear.petsc_solver import NOISE, Allowed, InnerSolver, PetscOptions, direct, failure
from stickslip.solvers.newton.active_set import ActiveSet
from stickslip.solvers.parallel.replicated import distributed
from stickslip.solvers.system.nodal_contact import FormOfPart, relative_to_obstacle
from stickslip.solvers.system.system import System


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
            # factor by which ||delta|| falls in an iteration; if less, F' is assembled and factorised anew
            if slope > (0.1 * before) ** 2 and k and not self._fresh:
                self._renew(q)
                dq, slope = self._newton(delta)
            self._fresh = False
            size = float(np.sqrt(max(slope, 0.0)))
            first = first or size
            # relative accuracy of the displacement, in energy norm, that rounding allows
            rounding = LAST_DIGITS * max(first, float(np.sqrt(max((self.K * q).dot(q), 0.0))))
            if size <= max(allowed(first) if allowed else 0.0, rounding) or delta.norm() <= self.rounding(q):
                return
            q.axpy(step_length(partial(self._force, rhs, q, dq), slope), dq)
            before = size
        raise SolverError(
            "the inner Newton iteration for F(u) = K u + j_n(u) does not converge: try method = condensed-newton"
        )

    def rounding(self, q: Vec) -> float:
        """Norm [N] below which a residual at q [m] is rounding of F(u)."""
        return float(NOISE * self._stiffest * np.hypot(q.norm(), self._moved))

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
        if place.rows.master is None and place.rows.of_facets and not contact.sliding:
            forms = ComplianceForms(system.weak, contact, law)
            work, tangent = system.weak.compile(forms.work), system.weak.compile(forms.tangent)
            form = FormOfPart(forms.relative, system.T, system.vector(), work, tangent)
        self.counters.forms += 2
        return CompliantFace(place, PointLaw(law, len(place.rows.W_n)), law, form)

    def _force(self, rhs: Vec, q: Vec, dq: Vec, length: float) -> float:
        """Work [J] of delta along dq [m] at a length of that step."""
        return float((rhs - self.F(q + length * dq)).dot(dq))

    def _newton(self, delta: Vec) -> tuple[Vec, float]:
        """Newton's step V^-1 delta, and delta . V^-1 delta [J], with V the tangent as last prepared."""
        dq = delta.duplicate()
        # of the first residual of a linear solve in Newton's method, where inner solves are iterative
        self.solver.solve(delta, dq, (lambda start: 0.1 * start) if self.solver.iterative else None)
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
        k, p_ref = np.zeros(len(self.problem.gap)), max(self.problem.p_ref, np.finfo(float).tiny)
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


class BlockSystem:
    """[[F', B^T], [B, -C]] on the free displacements q and the multipliers p.

    Attributes:
        B: (m, free) [m^(d-1)], PETSc.
        C: (m, m) diagonal [m^(d+1)/N], PETSc.
    """

    def __init__(self, system: System, surface: SparseSurface) -> None:
        """Assemble B and C, and compile j_n; collective."""
        self.system, self.surface = system, surface
        self.cone = AdmissibleSet(system.contacts, 0.0, system.problem.timeline.end)
        self.multipliers = Multipliers.of(system, self.cone)
        self.inner = InnerProblem(system, surface)
        self.B = assemble_B(system, surface, self.cone, self.multipliers)

    @cached_property
    def B_T(self) -> Mat:
        """B^T (free, m)."""
        found = PETSc.Mat()
        self.B.transpose(found)
        return found

    @cached_property
    def C(self) -> Mat:
        return assemble_C(self.system, self.cone, self.multipliers)

    @cached_property
    def rows(self) -> Ints:
        """Numbers among all rows of the multipliers that may be non-zero."""
        found = self.multipliers.rows
        return np.asarray(found[self.cone.carrying[found]])

    @property
    def renewals(self) -> int:
        """Number of times that F' was assembled; zero where F is linear."""
        return self.inner.renewals

    def nest(self, q: Vec) -> Mat:
        """[[F'(q), B^T], [B, -C]] as one nested PETSc matrix; collective."""
        minus_C = self.C.copy()
        minus_C.scale(-1.0)
        return nested(self.inner.tangent(q), self.B_T, self.B, minus_C)

    def on_free(self, rows: Sparse) -> Mat:
        """Matrix (m, free) of one (m, c) on the contact dofs."""
        return self.multipliers.on_free(self.system, rows)

    def begin(self, problem: SurfaceProblem, u: Vec) -> Vec:
        """Set the data of a step; collective.

        Args:
            problem: the contact problem of the step.
            u: displacement [m] of all dofs that the step starts from.

        Returns:
            Its free part q [m].
        """
        self.problem = problem
        self.inner.begin(problem)
        return self.system.free_part(u, problem.cone.time)

    def forces(self, p: Array) -> Vec:
        """B^T p over the free displacements [N] of tractions p (rows,) [Pa], those of compliant faces left out."""
        found = self.system.T.createVecRight()
        self.B.multTranspose(self.multipliers.vector(p), found)
        return found

    def solve(self, p: Array, q: Vec, allowed: Allowed | None) -> tuple[Array, Array]:
        """Improve q until F(q) = f - B^T p + delta; collective.

        Args:
            p: tractions (rows,) [Pa].
            q: free displacements [m], in place.
            allowed: largest ||delta||, see `InnerSolver`; None: an exact solve.

        Returns:
            p with the pressures of compliant faces at q, and displacement u_c (c,) [m] of the contact dofs.
        """
        self.inner.solve(self.problem.load.f_q - self.forces(p), q, allowed)
        u_c = self.inner.contact.read(q)
        return self.inner.tractions(p, u_c), u_c

    def stored(self, q: Vec) -> float:
        """q . K q [J] of free displacements [m]; collective."""
        return float((self.surface.volume.K * q).dot(q))

    def inner_error(self, p: Array, q: Vec) -> float:
        """Energy norm [J^(1/2)] of the error of q that inner solves have left, by f - B^T p - K q; collective.

        Args:
            p: tractions (rows,) [Pa], compliant ones included.
            q: free displacements [m].
        """
        left = self.problem.load.f_q - self.inner.on_contact(self.surface.forces(p)) - self.surface.volume.K * q
        return self.surface.volume.solver.norm(left) if left.norm() > self.inner.rounding(q) else 0.0

    def response(self, p: Array) -> Array:
        """N F'^-1 B^T p (rows,) [m] of tractions p (rows,) [Pa], F' as last prepared; one volume solve; collective."""
        found = self.system.T.createVecRight()
        self.inner.solver.solve(self.forces(p), found)
        return np.asarray(self.surface.N @ self.inner.contact.read(found))


class NestedSystem:
    """Solves the linearised laws together with the bodies on the free displacements; `q` is the last answer."""

    def __init__(self, blocks: BlockSystem, q: Vec, options: PetscOptions, rtol: float) -> None:
        """
        Args:
            blocks: begun for the step.
            q: free displacements [m], in place.
            options: of PETSc, by the user.
            rtol: tolerance of the step.
        """
        self.blocks, self.q, self.options = blocks, q, options
        # backward error, and relative force out of balance, above which the linear system counts as singular
        self.enough = max(EXACT, min(HALF_DIGITS, rtol))
        self.u_c: Array | None = None  # of the last answer, the same object as it returned
        self.direct = True  # whether all solves were by a factor

    def __call__(self, laws: ActiveSet, u_c: Array) -> tuple[Array, Array]:
        """Tractions (rows,) [Pa] and displacement of the contact dofs (c,) [m]; collective. It does not use `u_c`.

        Raises:
            LinAlgError: the active set leaves a rigid mode free.
            SolverError: the KSP did not converge.
        """
        blocks, problem, surface = self.blocks, laws.problem, laws.problem.surface
        multipliers = blocks.multipliers
        m = multipliers.rows
        on = np.zeros(len(surface.W), bool)
        on[m] = True
        faces = np.flatnonzero(~on)  # compliant rows: p = rhs + k w
        A_p, k = laws.A_p[m], laws.k
        through = A_p[:, faces] @ sparse.diags(k[faces])
        A_w = laws.A_w[m] + _in_columns(through, faces, len(surface.W))
        right = laws.rhs[m] - A_p[:, faces] @ laws.rhs[faces] - A_w @ problem.offset
        soft = k[m] > 0
        # rows of B where points are closed, and of -C where they are open or stick elastically: symmetric but for slip
        scale = surface.W[m] * np.where(soft, -1 / np.where(soft, k[m], 1.0), 1 / problem.gamma[m])
        scale *= np.where(~soft & laws.given[m], -1.0, 1.0)
        V = blocks.inner.with_springs(np.where(on, 0.0, k))
        L = blocks.on_free(sparse.diags(scale) @ A_w @ surface.N)
        M = multipliers.matrix(sparse.diags(scale) @ A_p[:, m], multipliers.like)
        nest = nested(V, blocks.B_T, L, M)
        resting = np.where(on, 0.0, laws.rhs + k * problem.offset)  # p of compliant faces at u = 0
        f, g = problem.load.f_q - blocks.inner.on_contact(surface.forces(resting)), multipliers.like.duplicate()
        multipliers.at.write(g, scale * right)
        x, y = self.q, multipliers.like.duplicate()
        self._solve(nest, (f, g), (x, y))
        self.u_c = u_c = blocks.inner.contact.read(x)
        p = np.where(on, 0.0, laws.rhs + k * problem.relative_displacement(u_c))
        p[m] = multipliers.at.read(y)
        given = laws.given & on
        p[given] = 0.0  # exact zeros: the diagonal of A_p is 1 there
        p[given] = (laws.rhs - laws.A_p @ p)[given]
        laws.refuse_unbalanced(p)
        return p, u_c

    def _solve(self, nest: Mat, right: tuple[Vec, Vec], found: tuple[Vec, Vec]) -> None:
        counters = self.blocks.surface.counters
        try:
            ksp = solve(nest, right, found, self.options)
        except PETSc.Error as error:
            raise SolverError(f"the KSP of the block system cannot be set up: PETSc error {error.ierr}") from None
        counters.factorisations += 1
        counters.volume_solves += 1
        if backward_error(nest, right, found) <= self.enough:
            self.direct = self.direct and direct(ksp)
            counters.linear_iterations += 0 if direct(ksp) else ksp.getIterationNumber()
        elif direct(ksp):
            raise np.linalg.LinAlgError("the block system is singular: some rigid motion is not held")
        else:
            raise SolverError(f"the block system is not solved to {self.enough:g}: {failure(ksp)}; try -ksp_rtol")


def _in_columns(block: Sparse, columns: Ints, count: int) -> Sparse:
    """The matrix (m, count) with the columns of `block` at the given places, zero elsewhere."""
    entries = block.tocoo()
    shape = block.shape[0], count
    return sparse.csr_matrix((entries.data, (entries.row, columns[entries.col])), shape=shape)
