"""Inner solves of a block system: a PETSc KSP that a user may set from PETSc's options."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from petsc4py import PETSc

from stickslip.geometry.arrays import EPS, EXACT
from stickslip.geometry.errors import SolverError
from stickslip.geometry.protocols import KSP, PC, Mat, Vec
from stickslip.solvers.linear.petsc_options import PetscOptions
from stickslip.solvers.parallel.counters import Counters

MUMPS: Mapping[str, str] = {"icntl_7": "5", "icntl_14": "200"}  # ordering by METIS, and percent of memory for pivots
FACTORS = ("lu", "cholesky")
MAX_IT = 10000
NOISE = 8 * EPS  # rounding of K u, relative to the largest diagonal entry of K times u
Allowed = Callable[[float], float]  # from ||delta|| at the start of an inner solve to the largest one at its end
REASONS = {
    value: name for name, value in vars(PETSc.KSP.ConvergedReason).items() if isinstance(value, int) and value < 0
}


def mumps_options(prefix: str) -> dict[str, str]:
    """Our options of MUMPS' factors of solvers with a prefix."""
    return {f"{prefix}mat_mumps_{key}": value for key, value in MUMPS.items()}


def direct(ksp: KSP) -> bool:
    """Whether a solve is one application of a factor."""
    return ksp.getType() == "preonly" and ksp.getPC().getType() in FACTORS


def failure(ksp: KSP) -> str:
    """What a KSP that did not converge was, and PETSc's name of the reason."""
    reason = ksp.getConvergedReason()
    return f"{ksp.getType()} with {ksp.getPC().getType()} ended with {REASONS.get(reason, reason)}"


class InnerSolver:
    """V x = r: by MUMPS' Cholesky factor, or by conjugate gradients with multigrid; or as PETSc's options say.

    A preconditioner alone (`pc_type` without `ksp_type`) is used inside conjugate gradients. The norm of a residual is
    the natural one, ||delta||² = delta . M^-1 delta with M the preconditioner: about the energy norm of the error
    [J^(1/2)] that delta leaves in x. The matrix may change; the preconditioner stays that of the last `renew`.
    """

    def __init__(
        self,
        V: Mat,
        prefix: str,
        counters: Counters,
        *,
        multigrid: Callable[[Mat], PC] | None = None,
        options: PetscOptions | None = None,
    ) -> None:
        """
        Args:
            V: symmetric and positive definite [N/m].
            prefix: of the options, ends with an underscore.
            counters: counts factorisations, volume solves and iterations.
            multigrid: makes the preconditioner of conjugate gradients; None: a factor in their place.
            options: of the user.
        """
        self.prefix, self.counters, self._multigrid = prefix, counters, multigrid
        self.iterative, self.options = multigrid is not None, options or PetscOptions("", prefix)
        self.renew(V)

    def renew(self, V: Mat) -> None:
        """Set up for a matrix; collective.

        Raises:
            SolverError: PETSc cannot set it up.
        """
        self.V = V
        V.setOption(PETSc.Mat.Option.SPD, True)
        ksp: KSP = PETSc.KSP().create(V.comm)
        ksp.setOptionsPrefix(self.prefix)
        ksp.setOperators(V)
        try:
            with self.options.in_force({} if self.iterative else mumps_options(self.prefix)):
                self._set_up(ksp)
        except PETSc.Error as error:
            raise SolverError(f"the inner solver cannot be set up: PETSc error {error.ierr}") from None
        self.ksp = ksp
        self.counters.factorisations += 1

    def _set_up(self, ksp: KSP) -> None:
        if self._multigrid is not None:
            ksp.setPC(self._multigrid(self.V))
            ksp.setType("cg")
        else:
            ksp.setType("preonly")
            pc = ksp.getPC()
            pc.setType("cholesky")
            pc.setFactorSolverType("mumps")
        # relative residual of an iterative solve that stands for an exact one: rounding
        ksp.setTolerances(rtol=EXACT, atol=0.0, max_it=MAX_IT)
        ksp.setFromOptions()
        if ksp.getType() == "preonly" and not direct(ksp):
            ksp.setType("cg")
        if not direct(ksp):
            ksp.setInitialGuessNonzero(True)
            ksp.setNormType(PETSc.KSP.NormType.NATURAL if ksp.getType() == "cg" else PETSc.KSP.NormType.DEFAULT)
        ksp.setUp()

    def solve(self, r: Vec, x: Vec, allowed: Allowed | None = None) -> None:
        """Improve x until ||r - V x|| is small enough; collective.

        Args:
            r: right-hand side [N].
            x: the start, then the solution [m].
            allowed: largest norm of the residual at the end, for iterative solvers of our own; None: rounding. A factor
                is exact, and a solver from the user's options has its own tolerance.

        Raises:
            SolverError: it does not converge.
        """
        if self.iterative:
            rounding = EXACT * max(self.norm(r), self.norm(self.V * x))
            self.ksp.setConvergenceTest(_Test(allowed or (lambda start: 0.0), rounding))
        self.ksp.solve(r, x)
        self.counters.volume_solves += 1
        if not self.direct:
            self.counters.linear_iterations += self.ksp.getIterationNumber()
        if self.ksp.getConvergedReason() < 0 or not np.isfinite(x.norm()):
            other = 'inner_solves = "exact"' if self.iterative else "other petsc_options"
            raise SolverError(f"an inner solve failed: {failure(self.ksp)}; try {other}")

    @property
    def direct(self) -> bool:
        """Whether a solve is one application of a factor."""
        return direct(self.ksp)

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
