"""The unit of our costs: one linear elastic solve of the same mesh with its contact surfaces fixed."""

from __future__ import annotations

import logging
import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from solvers.interface.factorised import METIS
from solvers.linear.multigrid import boomeramg, gamg
from solvers.system.floating_modes import near_nullspace
from solvers.system.system import System

RTOL = 1e-8  # true residual over load
MOST_ITERATIONS = 1000
PREFIX = "linear_reference_"
WORKSPACE = 100  # percent that MUMPS adds to what it believes it needs
QUADRATIC = 1.2e-9  # s per squared unknown that a factorisation in 3D takes on one core: 108 k unknowns, 14 s
HOPELESS = 3.0  # a solver that is predicted to take so many times the best is not tried
log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Timing:
    """One solver's wall time; numbers are null where it was not tried, or failed, and `note` says why."""

    setup: float | None = None  # [s]
    solve: float | None = None  # [s]
    iterations: int | None = None
    residual: float | None = None  # |f - K u| / |f|
    note: str = ""

    @property
    def seconds(self) -> float:
        """Both; infinite if the answer is none."""
        if self.setup is None or self.solve is None or self.residual is None or not self.residual <= 2 * RTOL:
            return np.inf
        return self.setup + self.solve


@dataclass(frozen=True)
class LinearReference:
    """Wall times by solver, and the least of them."""

    fastest: str
    seconds: float
    solvers: dict[str, Timing]

    @staticmethod
    def of(solvers: dict[str, Timing]) -> LinearReference:
        fastest = min(solvers, key=lambda name: solvers[name].seconds)
        return LinearReference(fastest, solvers[fastest].seconds, solvers)


def linear_reference(system: System, only: str = "") -> LinearReference:
    """Solve the bodies under the last step's loads and supports with each solver, or with one only; collective."""
    K, f = _fixed(system)
    motions = near_nullspace(system)
    solvers: dict[str, Callable[[Any], None]] = {
        "cg+boomeramg": lambda ksp: ksp.setPC(boomeramg(K, PREFIX)),
        "cg+gamg": lambda ksp: ksp.setPC(gamg(K, motions, PREFIX)),
        "mumps": _cholesky,
    }
    if only:
        return LinearReference.of({only: _timed(K, f, solvers[only])})
    found = {name: _timed(K, f, solvers[name]) for name in ("cg+boomeramg", "cg+gamg")}
    best = min(timing.seconds for timing in found.values())
    predicted = QUADRATIC * K.size[0] ** 2 / K.comm.size if system.mesh.dim == 3 else 0.0
    if predicted > HOPELESS * best:
        note = f"not tried: about {predicted:.0f} s are expected for {K.size[0]} unknowns in 3D"
        found["mumps"] = Timing(note=note)
    else:
        found["mumps"] = _timed(K, f, solvers["mumps"])
    for name, timing in found.items():
        log.info("linear reference: %s %.3f s %s", name, timing.seconds, timing.note)
    return LinearReference.of(found)


def _fixed(system: System) -> tuple[Any, Any]:
    """Stiffness and load with the contact dofs held; a load that is none is replaced by one everywhere."""
    K, time = system.K_B.copy(), system.problem.timeline.times[-1]
    f = system.pull(time, system.load(time), system.prescribed(time))
    if not f.norm():  # supports that move a body as a whole pull at nothing
        f.array[:] = near_nullspace(system)[:, 0]
    low, high = K.getOwnershipRange()
    held = system.interface.dofs[(system.interface.dofs >= low) & (system.interface.dofs < high)]
    K.zeroRowsColumns(held.astype(PETSc.IntType), diag=float(K.getDiagonal().sum() / K.size[0]))
    f.array[held - low] = 0.0
    return K, f


def _timed(K: Any, f: Any, prepare: Callable[[Any], None]) -> Timing:
    """Conjugate gradients to the tolerance, or one direct solve; set-up and solve apart, each of the slowest rank."""
    u, began = f.duplicate(), clock.perf_counter()
    ksp = PETSc.KSP().create(K.comm)
    try:
        ksp.setOptionsPrefix(PREFIX)
        ksp.setOperators(K)
        ksp.setType("cg")
        ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        ksp.setTolerances(rtol=RTOL, atol=0.0, max_it=MOST_ITERATIONS)
        prepare(ksp)
        ksp.setUp()
        ready = clock.perf_counter()
        ksp.solve(f, u)
        solved = clock.perf_counter()
    except PETSc.Error as error:
        return Timing(note=f"failed: PETSc error {error.ierr}")
    residual = float((f - K * u).norm() / f.norm())
    # the same on all ranks: what is tried next hangs on it
    setup, solve = (K.comm.tompi4py().allreduce(seconds, op=MPI.MAX) for seconds in (ready - began, solved - ready))
    found = Timing(setup=setup, solve=solve, iterations=ksp.getIterationNumber(), residual=residual)
    ksp.destroy()
    return found


def _cholesky(ksp: Any) -> None:
    ksp.setType("preonly")
    ksp.setNormType(PETSc.KSP.NormType.NONE)
    ksp.getOperators()[0].setOption(PETSc.Mat.Option.SPD, True)
    pc = ksp.getPC()
    pc.setType("cholesky")
    pc.setFactorSolverType("mumps")
    pc.setFactorSetUpSolverType()
    pc.getFactorMatrix().setMumpsIcntl(7, METIS)
    pc.getFactorMatrix().setMumpsIcntl(14, WORKSPACE)
