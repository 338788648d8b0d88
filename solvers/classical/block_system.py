"""The block system of a scene: F' and B, C of all contacts, assembled by dolfinx, as one nest and for Uzawa."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from petsc4py import PETSc

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.protocols import Mat, Sparse, Vec
from stickslip.solvers.classical.contact_matrices import Multipliers, assemble_B, assemble_C
from stickslip.solvers.classical.inner_problem import InnerProblem
from stickslip.solvers.classical.nest import nested
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.sparse import SparseSurface
from stickslip.solvers.linear.inner_solver import Allowed
from stickslip.solvers.system.system import System


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
        found: Mat = PETSc.Mat()
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
