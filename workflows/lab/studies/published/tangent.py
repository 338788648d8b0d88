"""The slip tangent of the perturbed Lagrangian, solved by GMRES with incomplete LU, by Gauss-Seidel and by MUMPS.

The tangent K = K_B + Σ K_C^s of the published contact elements on all displacements is unsymmetric in slip.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, onenormest, splu

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.errors import MachineError
from stickslip.geometry.protocols import KSP, Mat, Sparse
from stickslip.solvers.classical.contact_element import SLIP, ContactElements, held_from
from stickslip.solvers.classical.perturbed_lagrangian import PerturbedLagrangian
from stickslip.solvers.interface.factorised import METIS
from stickslip.solvers.stepping.stepper import Accepted
from stickslip.solvers.system.system import System
from stickslip.workflows.lab.studies.finding import Row
from stickslip.workflows.lab.studies.published.contact import march, scene, slipping


@dataclass(frozen=True, kw_only=True)
class SlipTangent:
    """The tangent matrix of Newton-Raphson at a solved step; on one rank.

    Source: Pop (1999), (4.4)-(4.5).
    """

    K_B: Sparse  # (n, n) [N/m]
    N: Sparse  # (rows, n), displacement to gaps
    slope: Sparse  # Σ*' (rows, rows) [N/m]
    omega: Array  # (rows,) [N/m], penalties
    status: Ints  # (rows,) OPEN, STICK or SLIP
    force: Array  # (n,) [N], of contact on the bodies

    @staticmethod
    def at(system: System, accepted: Accepted, omega: Array) -> SlipTangent:
        """The tangent at a solved step.

        Args:
            system: the assembled scene.
            accepted: the step, solved by the perturbed Lagrangian with the same `omega`, not augmented.
            omega: penalties (rows,) [Pa/m].
        """
        problem = accepted.problem
        elements = ContactElements.of(problem, omega, held_from(problem, accepted.substep_start.p))
        answer = elements.answer(accepted.state.w - elements.reference)
        indptr, indices, data = system.K_B.getValuesCSR()
        K_B = sparse.csr_matrix((data, indices, indptr), shape=system.K_B.size)
        c = len(system.interface.dofs)
        onto = sparse.csr_matrix((np.ones(c), (np.arange(c), system.interface.dofs)), shape=(c, K_B.shape[0]))
        N = problem.surface.N[:, :c] @ onto
        force = -np.asarray(N.T @ (problem.surface.W * accepted.state.p))
        return SlipTangent(K_B=K_B, N=N, slope=answer.slope, omega=elements.omega, status=answer.status, force=force)

    @property
    def of_displacements(self) -> tuple[Sparse, Array]:
        """K_B + N^T Σ*' N (n, n), with ΔΣ eliminated, and a right-hand side (n,): the forces of contact."""
        return (self.K_B + self.N.T @ self.slope @ self.N).tocsr(), self.force

    @property
    def of_both(self) -> tuple[Sparse, Array]:
        """The same system with the unknowns (ΔU, ΔΣ) (n + rows,), as in (4.5) and (5.3)."""
        flexible = sparse.diags(1 / self.omega)
        whole = sparse.bmat([[self.K_B, self.N.T], [flexible @ self.slope @ self.N, -flexible]], format="csr")
        whole.eliminate_zeros()  # as the sum above does: an incomplete factor depends on the pattern
        return whole, np.concatenate([self.force, np.zeros(len(self.omega))])

    def share(self, *status: int) -> float:
        """Part of the rows whose status is one of those named: OPEN, STICK, SLIP."""
        return float(np.isin(self.status, status).mean())


def unsymmetry(K: Sparse) -> float:
    """||K - K^T|| / ||K|| in the Frobenius norm."""
    return float(sparse.linalg.norm(K - K.T) / sparse.linalg.norm(K))


def dropped_fill(A: Sparse, relaxation: float) -> Array:
    """Sum over each row (n,) of the fill outside A's pattern that its relaxed ILU(0) drops.

    The relaxed factorisation adds `relaxation` times that sum to the pivot as it goes: 0 is ILU(0), 1 the modified one,
    which keeps row sums. Row by row it is therefore ILU(0) of A + relaxation * diag(sum), which any library computes.

    Args:
        A: (n, n), with all of its diagonal in the pattern.
        relaxation: between 0 and 1.

    Source: Saad, Iterative Methods for Sparse Linear Systems (2003), 10.3.5; the source of the published methods names
    Elman, BIT 29 (1989).

    Raises:
        MachineError: a pivot is zero.

    >>> from scipy import sparse
    >>> A = sparse.csr_matrix(np.array([[4.0, -1, -1], [-1, 4, 0], [-1, 0, 4]]))
    >>> dropped_fill(A, 0.0)  # -1/4 at (1, 2) and at (2, 1)
    array([ 0.  , -0.25, -0.25])
    """
    A = A.tocsr()
    A.sort_indices()
    n = A.shape[0]
    fill, row = np.zeros(n), np.zeros(n)  # the present row, zero between the rows
    pivots: list[float] = []
    columns: list[NDArray[np.int32]] = []  # of U, right of the diagonal
    values: list[Array] = []
    for i in range(n):
        own = A.indices[A.indptr[i] : A.indptr[i + 1]]
        row[own] = A.data[A.indptr[i] : A.indptr[i + 1]]
        reached = [own]
        at = int(np.searchsorted(own, i))
        for k in own[:at].tolist():
            row[columns[k]] -= row[k] / pivots[k] * values[k]
            reached.append(columns[k])
        kept = row[own]
        row[own] = 0.0
        touched = np.unique(np.concatenate(reached))
        fill[i] = row[touched].sum()
        row[touched] = 0.0
        pivot = float(kept[at] + relaxation * fill[i])
        if not abs(pivot) > 0:
            raise MachineError(f"incomplete LU: pivot {i} is {pivot}")
        pivots.append(pivot)
        columns.append(own[at + 1 :])
        values.append(kept[at + 1 :])
    return fill


PREFIX = "tangent_"
RESTART = 200  # directions that GMRES stores: more than a good preconditioner needs
MOST = 1000  # iterations
REPEATED = 3  # solves, of which the fastest counts
SHORT = 0.5  # [s] a solve longer than this is not repeated


@dataclass(frozen=True, kw_only=True)
class ILU:
    """ILU(levels), plain, relaxed (dropped fill is added to the diagonal) or stabilised (the diagonal is raised first).

    The latter two are plain factorisations of K with another diagonal, see `dropped_fill`; the time to compute that
    diagonal is not counted.
    """

    levels: int = 0
    relaxation: float = 0.0  # part of the dropped fill that is added
    shift: float = 0.0  # of each diagonal entry, relative to it


@dataclass(frozen=True, kw_only=True)
class Solve:
    """Result and cost of one solve."""

    x: Array  # (n,)
    ended: str  # "converged", or the reason why not
    iterations: int = 0
    residual: float = np.inf  # |b - K x| / |b|
    fill: float = 0.0  # entries of the factors by those of K; 0 without a factorisation
    seconds: float  # of set-up and solution


def gmres(K: Sparse, b: Array, ilu: ILU | None, rtol: float = 1e-8) -> Solve:
    """GMRES with a preconditioner on the right, so that it stops by the residual itself.

    Args:
        K: (n, n).
        b: right-hand side (n,).
        ilu: the preconditioner; None: without one.
        rtol: 2-norm of the residual, relative to that of b, at which to stop.
    """
    try:
        P = _changed(K, ilu) if ilu is not None and (ilu.relaxation or ilu.shift) else K
    except MachineError as error:
        return Solve(x=np.zeros_like(b), ended=str(error), residual=1.0, seconds=np.nan)

    def prepare(ksp: KSP) -> None:
        ksp.setType("gmres")
        ksp.setGMRESRestart(RESTART)
        PETSc.Options()[f"{PREFIX}ksp_gmres_cgs_refinement_type"] = "refine_ifneeded"
        ksp.setFromOptions()
        ksp.setPCSide(PETSc.PC.Side.RIGHT)
        ksp.setTolerances(rtol=rtol, atol=0.0, max_it=MOST)
        pc = ksp.getPC()
        pc.setType("none" if ilu is None else "ilu")
        if ilu is not None:
            pc.setFactorLevels(ilu.levels)
            pc.setFactorShift(PETSc.Mat.FactorShiftType.NONE)

    return _fastest(K, P, b, prepare, rtol)


def gauss_seidel(K: Sparse, b: Array, rtol: float = 1e-8) -> Solve:
    """The classical Gauss-Seidel iteration, forward, point by point; arguments as for `gmres`."""

    def prepare(ksp: KSP) -> None:
        ksp.setType("richardson")
        ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        ksp.setTolerances(rtol=rtol, atol=0.0, divtol=1e5, max_it=MOST)
        ksp.setMonitor(lambda *now: None)  # without a monitor PETSc does not compute the residual
        ksp.getOperators()[0].setOption(PETSc.Mat.Option.USE_INODES, False)  # point by point
        PETSc.Options()[f"{PREFIX}pc_sor_forward"] = ""
        ksp.getPC().setType("sor")
        ksp.setFromOptions()

    return _fastest(K, K, b, prepare, rtol)


def mumps(K: Sparse, b: Array) -> Solve:
    """LU factorisation by MUMPS, without iterative refinement; arguments as for `gmres`."""
    return _fastest(K, K, b, _direct, np.inf)


def condition(K: Sparse) -> float:
    """Estimated condition number in the 1-norm.

    Source: Higham & Tisseur, SIAM J. Matrix Anal. Appl. 21 (2000).
    """
    factor = splu(K.tocsc())
    inverse = LinearOperator(K.shape, factor.solve, rmatvec=partial(factor.solve, trans="T"), dtype=float)
    return float(onenormest(inverse, t=1) * sparse.linalg.norm(K, 1))


def _changed(K: Sparse, ilu: ILU) -> Sparse:
    """K with the diagonal whose plain incomplete factors are the relaxed or stabilised ones; of the same pattern."""
    found, diagonal = K.copy(), K.diagonal()
    raised = diagonal + ilu.shift * np.abs(diagonal)
    found.setdiag(raised)
    if ilu.relaxation:
        found.setdiag(raised + ilu.relaxation * dropped_fill(found, ilu.relaxation))
    return found


def _petsc(K: Sparse) -> Mat:
    K = K.tocsr()
    K.sort_indices()
    csr = K.indptr.astype(PETSc.IntType), K.indices.astype(PETSc.IntType), K.data
    return PETSc.Mat().createAIJ(K.shape, csr=csr, comm=PETSc.COMM_SELF)


def _solver(A: Mat, P: Mat) -> KSP:
    ksp = PETSc.KSP().create(PETSc.COMM_SELF)
    ksp.setOptionsPrefix(PREFIX)
    ksp.setOperators(A, P)
    return ksp


def _direct(ksp: KSP) -> None:
    ksp.setType("preonly")
    ksp.setNormType(PETSc.KSP.NormType.NONE)
    pc = ksp.getPC()
    pc.setType("lu")
    pc.setFactorSolverType("mumps")
    pc.setFactorSetUpSolverType()
    pc.getFactorMatrix().setMumpsIcntl(7, METIS)


def _fastest(K: Sparse, P: Sparse, b: Array, prepare: Callable[[KSP], None], rtol: float) -> Solve:
    """The fastest of up to REPEATED solves of K x = b with a preconditioner of P, each set up anew."""
    A = _petsc(K)
    matrices = A, A if P is K else _petsc(P)
    found = [_timed(K, *matrices, b, prepare, rtol)]
    while len(found) < REPEATED and found[0].seconds < SHORT:
        found.append(_timed(K, *matrices, b, prepare, rtol))
    return min(found, key=lambda solve: solve.seconds)


def _timed(K: Sparse, A: Mat, P: Mat, b: Array, prepare: Callable[[KSP], None], rtol: float) -> Solve:
    """Solve K x = b once; A is K and P the preconditioner's matrix, as PETSc matrices."""
    x, f = A.createVecs()
    f.array[:] = b
    began = clock.perf_counter()
    ksp = _solver(A, P)
    try:
        prepare(ksp)
        ksp.solve(f, x)
    except PETSc.Error as error:
        return Solve(x=np.array(x.array), ended=f"PETSc error {error.ierr}", seconds=clock.perf_counter() - began)
    seconds = clock.perf_counter() - began
    residual = float(np.linalg.norm(b - K @ x.array) / np.linalg.norm(b))
    reason = int(ksp.getConvergedReason())
    ended = "converged" if reason > 0 and residual <= 10 * rtol else _REASONS.get(reason, f"PETSc's reason {reason}")
    found = Solve(
        x=np.array(x.array),
        ended=ended,
        iterations=ksp.getIterationNumber(),
        residual=residual,
        fill=_fill(ksp, K),
        seconds=seconds,
    )
    ksp.destroy()
    return found


def _fill(ksp: KSP, K: Sparse) -> float:
    """Entries of the factors divided by those of K; 0 without a factorisation."""
    pc = ksp.getPC()
    if pc.getType() not in ("ilu", "lu"):
        return 0.0
    factor = pc.getFactorMatrix()
    if pc.getType() == "ilu":
        return float(factor.getInfo()["nz_used"] / K.nnz)
    entries = factor.getMumpsInfog(29)  # negative: in millions
    return float((entries if entries > 0 else -1e6 * entries) / K.nnz)


_REASONS = {
    -3: f"not in {MOST} iterations",
    -4: "diverged",
    -5: "broke down",
    -9: "not a number",
    -11: "the factorisation failed",
}


FORMS = ("displacements", "displacements and forces")
DIRECT, INCOMPLETE, CLASSICAL = "MUMPS", "GMRES, ILU(0)", "Gauss-Seidel"
RELAXED, STABILISED = "GMRES, relaxed ILU, ", "GMRES, stabilised ILU, "


def _by(ilu: ILU | None) -> Callable[[Any, Any], Solve]:
    return lambda K, b: gmres(K, b, ilu)


SOLVERS: Mapping[str, Callable[[Any, Any], Solve]] = {
    CLASSICAL: gauss_seidel,
    "GMRES": _by(None),
    INCOMPLETE: _by(ILU()),
    **{f"{RELAXED}{part:g}": _by(ILU(relaxation=part)) for part in (0.5, 0.9, 0.95, 1.0)},
    **{f"{STABILISED}{shift:g}": _by(ILU(shift=shift)) for shift in (1e-3, 1e-2, 1e-1)},
    "GMRES, ILU(1)": _by(ILU(levels=1)),
    "GMRES, ILU(2)": _by(ILU(levels=2)),
}


def tangent(dim: int, n: int, mu: float, omega_factor: float) -> list[Row]:
    """A row for each solver and form: the forces eliminated, or unknowns as in (4.5)."""
    found = scene(
        dim, n, mu, drag=slipping(dim, mu), method="perturbed-lagrangian", omega_factor=omega_factor, augment=False
    )
    simulation, accepted, status = march(found)
    row: Row = {"dim": dim, "n": n, "mu": mu, "omega_factor": omega_factor}
    if status != "converged":
        names = [(form, solver) for form in FORMS for solver in (DIRECT, *SOLVERS)]
        return [row | {"form": form, "solver": solver, "status": f"no tangent: {status}"} for form, solver in names]
    omega = PerturbedLagrangian.of(simulation.system.problem.solver).penalties(simulation.system)
    matrix = SlipTangent.at(simulation.system, accepted[-1], omega)
    row["sliding"] = matrix.share(SLIP)
    systems = dict(zip(FORMS, (matrix.of_displacements, matrix.of_both), strict=True))
    return [solve for form, (K, f) in systems.items() for solve in _solved(row | {"form": form}, K, f)]


def _solved(row: Row, K: Any, force: Any) -> Iterator[Row]:
    """One row for each solver; the first one, MUMPS, also has the data of the matrix."""
    x = mumps(K, force).x
    b = K @ x  # the exact x is known
    direct = mumps(K, b)
    matrix = {"dofs": K.shape[0], "unsymmetry": unsymmetry(K), "condition": condition(K)}
    yield row | matrix | _told(DIRECT, direct, x, direct)
    for name, solve in SOLVERS.items():
        yield row | _told(name, solve(K, b), x, direct)


def _told(name: str, solve: Solve, x: Any, direct: Solve) -> Row:
    """One row: error of the solution; seconds are those of MUMPS in the same process, times `ratio`."""
    done = solve.ended == "converged"
    off = float(np.linalg.norm(solve.x - x) / np.linalg.norm(x)) if done or name == DIRECT else None
    return {
        "solver": name,
        "status": solve.ended,
        "iterations": solve.iterations if done and name != DIRECT else None,
        "residual": solve.residual if np.isfinite(solve.residual) else None,
        "error": off,
        "fill": solve.fill,
        "ratio": solve.seconds / direct.seconds if done else None,
        "seconds": solve.seconds if np.isfinite(solve.seconds) else None,
    }
