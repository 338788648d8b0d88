"""The unit of cost: one linear elastic solve on the same mesh, its contact surfaces fixed."""

from __future__ import annotations

import logging
import time as clock
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from stickslip.geometry.protocols import KSP, Mat, Vec
from stickslip.solvers.interface.factorised import METIS
from stickslip.solvers.linear.multigrid import HYPRE, boomeramg, gamg
from stickslip.solvers.system.floating_modes import near_nullspace
from stickslip.solvers.system.system import System

RTOL = 1e-8  # true residual, relative to the load
MOST_ITERATIONS = 1000
QUADRATIC = 1.2e-9  # [s] of a factorisation in 3D on one core, times unknowns squared; 108 k unknowns: 14 s
PREFIX = "linear_reference_"
log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Time of one solver; its numbers are None if it was not tried or failed, and `note` says why."""

    setup: float | None = None  # [s]
    solve: float | None = None  # [s]
    iterations: int | None = None  # 1: direct solver
    residual: float | None = None  # |f - K u| / |f| [-]
    note: str = ""

    @property
    def seconds(self) -> float:
        """Set-up and solve together [s]; inf if it has no solution."""
        return np.inf if self.setup is None or self.solve is None else self.setup + self.solve


@dataclass(frozen=True, kw_only=True)
class LinearReference:
    """Times by solver, and the shortest of them."""

    fastest: str  # name of the solver
    seconds: float  # its time [s]
    solvers: dict[str, Timing]  # by name: cg+boomeramg, cg+gamg, mumps

    @staticmethod
    def of(solvers: dict[str, Timing]) -> LinearReference:
        """Find the fastest one."""
        fastest = min(solvers, key=lambda name: solvers[name].seconds)
        return LinearReference(fastest=fastest, seconds=solvers[fastest].seconds, solvers=solvers)


def linear_reference(
    system: System, only: str = "", rtol: float = RTOL, now: Callable[[], float] = clock.perf_counter
) -> LinearReference:
    """Time one linear solve of the bodies under the last step's loads and supports; collective.

    Args:
        system: the bodies; its contact dofs are fixed.
        only: name of the one solver to try; empty: all that can be the fastest.
        rtol: true residual, relative to the load, at which conjugate gradients stop.
        now: the clock [s]; by `time.process_time` the times are those of the processor.
    """
    with system.counters.clock.phase("linear_reference"):
        return _linear_reference(system, only, rtol, now)


def _linear_reference(system: System, only: str, rtol: float, now: Callable[[], float]) -> LinearReference:
    K, f = _fixed(system)
    motions = near_nullspace(system)
    solvers: dict[str, Callable[[KSP], None]] = {
        "cg+boomeramg": lambda ksp: ksp.setPC(boomeramg(K, system.mesh.simplicial, PREFIX)),
        "cg+gamg": lambda ksp: ksp.setPC(gamg(K, motions, PREFIX)),
        "mumps": _cholesky,
    }
    if only:
        return LinearReference.of({only: _timed(K, f, solvers[only], rtol, now)})
    found = {name: _timed(K, f, solvers[name], rtol, now) for name in ("cg+boomeramg", "cg+gamg")[not HYPRE :]}
    best = min(timing.seconds for timing in found.values())
    predicted = QUADRATIC * K.size[0] ** 2 / K.comm.size if system.mesh.dim == 3 else 0.0
    if predicted > 3 * best:
        note = f"not tried: about {predicted:.0f} s are expected for {K.size[0]} unknowns in 3D"
        found["mumps"] = Timing(note=note)
    else:
        found["mumps"] = _timed(K, f, solvers["mumps"], rtol, now)
    for name, timing in found.items():
        log.info("linear reference: %s %.3f s %s", name, timing.seconds, timing.note)
    return LinearReference.of(found)


def _fixed(system: System) -> tuple[Mat, Vec]:
    """Stiffness and load with the contact dofs fixed; a load that is zero is replaced by one that pulls everywhere."""
    K, time = system.K_B.copy(), system.problem.timeline.times[-1]
    f = system.pull(time, system.load(time), system.prescribed(time))
    low, high = K.getOwnershipRange()
    held = system.interface.dofs[(system.interface.dofs >= low) & (system.interface.dofs < high)]
    K.zeroRowsColumns(held.astype(PETSc.IntType), diag=float(K.getDiagonal().sum() / K.size[0]))
    f.array[held - low] = 0.0
    if not f.norm():  # supports that move a body as a whole cause no force, nor do loads on what is held
        f.array[:] = near_nullspace(system)[:, 0]  # also of what is held: there may be nothing else
    return K, f


def _timed(K: Mat, f: Vec, prepare: Callable[[KSP], None], rtol: float, now: Callable[[], float]) -> Timing:
    """Time conjugate gradients to the tolerance, or one direct solve; times are those of the slowest rank; collective.

    Args:
        K: stiffness [N/m].
        f: load [N].
        prepare: sets the preconditioner, or makes it a direct solver.
        rtol: true residual, relative to the load.
        now: the clock [s].
    """
    u, began = f.duplicate(), now()
    ksp = PETSc.KSP().create(K.comm)
    try:
        ksp.setOptionsPrefix(PREFIX)
        ksp.setOperators(K)
        ksp.setType("cg")
        ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        ksp.setTolerances(rtol=rtol, atol=0.0, max_it=MOST_ITERATIONS)
        prepare(ksp)
        ksp.setUp()
        ready = now()
        ksp.solve(f, u)
        solved = now()
    except PETSc.Error as error:
        return Timing(note=f"failed: PETSc error {error.ierr}")
    residual = float((f - K * u).norm() / f.norm())
    # the same on all ranks: they decide by it what to try next
    setup, solve = (K.comm.tompi4py().allreduce(seconds, op=MPI.MAX) for seconds in (ready - began, solved - ready))
    iterations = ksp.getIterationNumber()
    ksp.destroy()
    if not residual <= 2 * rtol:
        return Timing(iterations=iterations, residual=residual, note=f"failed: residual {residual:.1e}, not {rtol:.0e}")
    return Timing(setup=setup, solve=solve, iterations=iterations, residual=residual)


def _cholesky(ksp: KSP) -> None:
    """Make it a direct solver: Cholesky factors by MUMPS, ordered by METIS."""
    ksp.setType("preonly")
    ksp.setNormType(PETSc.KSP.NormType.NONE)
    ksp.getOperators()[0].setOption(PETSc.Mat.Option.SPD, True)
    pc = ksp.getPC()
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    pc.setFactorSetUpSolverType()
    pc.getFactorMatrix().setMumpsIcntl(7, METIS)
    pc.getFactorMatrix().setMumpsIcntl(14, 100)  # percent that is added to the estimate of memory
