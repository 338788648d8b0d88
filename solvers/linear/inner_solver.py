"""Inner solves of a block system: a PETSc KSP that a user may set from PETSc's options."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from petsc4py import PETSc

from geometry.errors import SolverError
from geometry.protocols import KSP, PC, Mat, Vec
from solvers.linear.multigrid import boomeramg
from solvers.parallel.counters import Counters

METIS, WORKSPACE = 5, 200  # MUMPS' ICNTL(7), and ICNTL(14) [percent]
EXACT = 1e-13  # relative residual of an iterative solve that stands for an exact one: rounding
MAX_IT = 10000
Allowed = Callable[[float], float]  # from ||delta|| at the start of a solve to the largest one at its end


def mumps_workspace(pc: PC) -> None:
    """Options of MUMPS for a factor: its ordering, and memory for pivots beyond its own estimate."""
    prefix, known = pc.getOptionsPrefix() or "", PETSc.Options()
    for key, value in (("7", METIS), ("14", WORKSPACE)):
        name = f"{prefix}mat_mumps_icntl_{key}"
        if not known.hasName(name):
            known.setValue(name, str(value))


class InnerSolver:
    """V x = r: by MUMPS' Cholesky factor, or by conjugate gradients with multigrid; or as PETSc's options say.

    The norm of a residual is the natural one, ||delta||² = delta . M^-1 delta with M the preconditioner: about the
    energy norm of the error [J^(1/2)] that delta leaves in x. The matrix may change; the preconditioner stays that of
    the last `renew`.
    """

    def __init__(self, V: Mat, prefix: str, counters: Counters, *, iterative: bool) -> None:
        """
        Args:
            V: symmetric and positive definite [N/m].
            prefix: of the options, ends with an underscore.
            counters: counts factorisations, volume solves and iterations.
            iterative: conjugate gradients with multigrid, in place of a factor.
        """
        self.prefix, self.counters, self.iterative = prefix, counters, iterative
        self.renew(V)

    def renew(self, V: Mat) -> None:
        """Set up for a matrix; collective."""
        self.V = V
        V.setOption(PETSc.Mat.Option.SPD, True)
        ksp: KSP = PETSc.KSP().create(V.comm)
        ksp.setOptionsPrefix(self.prefix)
        ksp.setOperators(V)
        if self.iterative:
            ksp.setPC(boomeramg(V, self.prefix))
            ksp.setType("cg")
        else:
            ksp.setType("preonly")
            pc = ksp.getPC()
            pc.setType("cholesky")
            pc.setFactorSolverType("mumps")
            mumps_workspace(pc)
        ksp.setTolerances(rtol=EXACT, atol=0.0, max_it=MAX_IT)
        ksp.setFromOptions()
        if ksp.getType() != "preonly":
            ksp.setInitialGuessNonzero(True)
            ksp.setNormType(PETSc.KSP.NormType.NATURAL if ksp.getType() == "cg" else PETSc.KSP.NormType.DEFAULT)
        try:
            ksp.setUp()
        except PETSc.Error as error:
            raise SolverError(f"the inner solver cannot be set up: PETSc error {error.ierr}") from None
        self.ksp = ksp
        self.counters.factorisations += 1

    def solve(self, r: Vec, x: Vec, allowed: Allowed | None = None) -> None:
        """Improve x until ||r - V x|| is small enough; collective. With a factor every solve is exact.

        Args:
            r: right-hand side [N].
            x: the start, then the solution [m].
            allowed: largest norm of the residual at the end; None: an exact solve.

        Raises:
            SolverError: it does not converge.
        """
        if self.iterative:
            self.ksp.setConvergenceTest(_Test(allowed or (lambda start: 0.0), EXACT * self.norm(r)))
        self.ksp.solve(r, x)
        self.counters.volume_solves += 1
        if not self.direct:
            self.counters.linear_iterations += self.ksp.getIterationNumber()
        reason = self.ksp.getConvergedReason()
        if reason < 0 or not np.isfinite(x.norm()):
            raise SolverError(f"the inner solver {self.ksp.getType()} did not converge: PETSc reason {reason}")

    @property
    def direct(self) -> bool:
        """Whether a solve is one application of a factor."""
        return self.ksp.getType() == "preonly"

    def norm(self, r: Vec) -> float:
        """Natural norm of a residual r [N], about the energy norm of the error that it leaves [J^(1/2)]; collective."""
        z = r.duplicate()
        self.ksp.getPC().apply(r, z)
        return float(np.sqrt(max(r.dot(z), 0.0)))


class _Test:
    """Converged when the residual is below what the outer iteration allows, or at rounding."""

    def __init__(self, allowed: Allowed, rounding: float) -> None:
        self.allowed, self.rounding, self.enough = allowed, rounding, 0.0

    def __call__(self, ksp: KSP, iteration: int, norm: float) -> int:
        if iteration == 0:
            self.enough = max(self.allowed(norm), self.rounding)
        if norm <= self.enough:
            return int(PETSc.KSP.ConvergedReason.CONVERGED_ATOL)
        if not np.isfinite(norm):
            return int(PETSc.KSP.ConvergedReason.DIVERGED_NANORINF)
        return 0 if iteration < MAX_IT else int(PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT)
