"""Solvers of linear systems that a user's options of PETSc may replace.

The options are for the solvers of one method, and in force only while these are set up. Functions of the PETSc library
that petsc4py does not wrap are called here.
"""

from __future__ import annotations

import ctypes
import shlex
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache

import numpy as np
from petsc4py import PETSc

from stickslip.geometry.arrays import EXACT
from stickslip.geometry.errors import MachineError, SceneError, SolverError
from stickslip.geometry.protocols import KSP, PC, Mat, Vec
from stickslip.solvers.parallel.counters import Counters


@cache
def petsc_library() -> ctypes.CDLL:
    """The PETSc library that petsc4py has loaded."""
    with open("/proc/self/maps") as maps:
        return ctypes.CDLL(next(line.split()[-1] for line in maps if "libpetsc" in line))


def call(function: Callable[..., int], *handles: int) -> None:
    """Call a function of the PETSc library with the handles of PETSc objects.

    Raises:
        MachineError: it returns an error.
    """
    code = function(*(ctypes.c_void_p(handle) for handle in handles))
    if code:
        raise MachineError(f"PETSc error {code} in {function.__name__}")


def option_used(name: str) -> bool:
    """Whether PETSc has asked for an option (without the leading dash) since it was set."""
    used = ctypes.c_int(0)
    code = petsc_library().PetscOptionsUsed(None, name.encode(), ctypes.byref(used))
    if code:
        raise MachineError(f"PETSc error {code} in PetscOptionsUsed")
    return bool(used.value)


EXAMPLE = "write for example -fieldsplit_u_ksp_type cg -fieldsplit_u_pc_type gamg"


class PetscOptions:
    """The options, with a prefix that the user leaves out; those that PETSc has used are known afterwards."""

    def __init__(self, text: str, prefix: str, solvers: tuple[str, ...] = ("",)) -> None:
        """Read and check the options; no collective call.

        Args:
            text: as on a command line.
            prefix: put before each name.
            solvers: prefixes, after `prefix`, of the solvers that will read them.

        Raises:
            SceneError: a word is no option, or PETSc refuses a value.

        >>> PetscOptions("-ksp_view -fieldsplit_u_ksp_rtol 1e-10", "block_").values
        {'block_ksp_view': None, 'block_fieldsplit_u_ksp_rtol': '1e-10'}
        """
        self.prefix, self.values = prefix, dict(_parsed(text, prefix))
        self._used: set[str] = set()
        self._named: set[str] = set()
        for solver in solvers if self.values else ():
            self._check(prefix + solver)
        self._used.clear()

    @contextmanager
    def in_force(self, defaults: Mapping[str, str] | None = None) -> Iterator[None]:
        """Give PETSc the options, and `defaults` (full names) where they say nothing; take them back at the end."""
        known, values = PETSc.Options(), {**(defaults or {}), **self.values}
        for name, value in values.items():
            known.setValue(name, value)
        try:
            yield
        finally:
            self._used.update(name for name in self.values if option_used(name))
            for name in values:
                known.delValue(name)

    def unused(self) -> list[str]:
        """Options that PETSc has not asked for up to now, as the user wrote them; each is named only once."""
        found = [name for name in self.values if name not in self._used | self._named]
        self._named.update(found)
        return [f"-{name.removeprefix(self.prefix)}" for name in found]

    def _check(self, prefix: str) -> None:
        one = PETSc.Mat().createAIJ(1, nnz=1, comm=PETSc.COMM_SELF)
        one.setUp()
        one.assemble()
        ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        ksp.setOptionsPrefix(prefix)
        ksp.setOperators(one)
        try:
            with self.in_force():
                ksp.setFromOptions()
        except PETSc.Error as error:
            text = " ".join(
                f"-{name.removeprefix(self.prefix)} {value or ''}".strip() for name, value in self.values.items()
            )
            raise SceneError(f"petsc_options = {text}: PETSc refuses it with error {error.ierr}; {EXAMPLE}") from None


def _parsed(text: str, prefix: str) -> Iterator[tuple[str, str | None]]:
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise SceneError(f"petsc_options = {text}: {error}") from None
    while words:
        name = words.pop(0)
        if not _is_name(name):
            raise SceneError(f"petsc_options = {name}: is not an option; {EXAMPLE}")
        yield prefix + name[1:], words.pop(0) if words and not _is_name(words[0]) else None


def _is_name(word: str) -> bool:
    return word.startswith("-") and word[1:2].isalpha()


MUMPS: Mapping[str, str] = {"icntl_7": "5", "icntl_14": "200"}  # ordering by METIS, and percent of memory for pivots
FACTORS = ("lu", "cholesky")
MAX_IT = 10000
NOISE = 8 * float(np.finfo(float).eps)  # rounding of K u, relative to the largest diagonal entry of K times u
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
    """Describe a KSP that did not converge, with PETSc's name of the reason."""
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
        ksp = PETSc.KSP().create(V.comm)
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
