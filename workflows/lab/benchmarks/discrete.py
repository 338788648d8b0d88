"""Our methods beside Siconos on discrete problems: `python -m stickslip.workflows.lab.benchmarks.discrete FILES...`.

One process, one thread. Every solver gets the same scaled problem, and every answer is judged by the same residual.
Siconos is Debian's python3-siconos; without it our methods are measured alone.
"""

from __future__ import annotations

import importlib
import math
import os
import time as clock
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from stickslip import MachineError, StickslipError
from stickslip.geometry.arrays import Array
from stickslip.solvers.interface.discrete import DiscreteProblem, discrete_problem, residual
from stickslip.solvers.stepping.discrete_chain import AUTO, refuse_unusable, solve
from stickslip.workflows.cost.measure import ONE_THREAD
from stickslip.workflows.formats.fclib import read_problem
from stickslip.workflows.pictures.performance_profile import CLOCK, FACTORS, draw_profile, shares

os.environ.update(ONE_THREAD)  # before the first operation that would start them

OURS = "ours: "
SICONOS = {  # name: solvers in 2D and 3D, most iterations
    "NSGS": ("SICONOS_FRICTION_2D_NSGS", "SICONOS_FRICTION_3D_NSGS", 100000),
    "CPG": ("SICONOS_FRICTION_2D_CPG", "", 1000),
    "NSN_AC": ("", "SICONOS_FRICTION_3D_NSN_AC", 1000),
    "ADMM": ("", "SICONOS_FRICTION_3D_ADMM", 10000),
}
ASKED = (1.0, 0.1, 0.01)  # of the tolerance: what Siconos is asked for, one after the other, by its own measure
ROUNDING = 1e-6  # of a residual that is computed twice
WIDE = 18  # letters of a column
LIMIT = 20.0  # [s] of a call after which Siconos is not asked again
SPARSE = 100  # rows from which its solvers in 3D get a sparse matrix
Solver = Callable[[DiscreteProblem, float], tuple[float, Array | None]]  # problem, tolerance to seconds and r (rows,)


def ours(method: str) -> Solver:
    """Return one of our methods, or the chain `auto`."""

    def solver(problem: DiscreteProblem, tolerance: float) -> tuple[float, Array]:
        began = clock.perf_counter()
        found = solve(problem, method, tolerance).solution
        return clock.perf_counter() - began, problem.surface.forces(found.p)

    return solver


def siconos(numerics: Any, plane: str, space: str, max_it: int) -> Solver:
    """Return a solver of Siconos; `numerics` is its module.

    The seconds are those of the call that is accurate enough, without the construction of the problem.
    """

    def once(problem: DiscreteProblem, tolerance: float) -> tuple[float, Array]:
        options = numerics.SolverOptions(getattr(numerics, plane if problem.dim == 2 else space))
        options.dparam[numerics.SICONOS_DPARAM_TOL] = tolerance
        options.iparam[numerics.SICONOS_IPARAM_MAX_ITER] = max_it
        matrix = problem.surface.matrix
        stored = matrix.tocsc() if problem.dim == 3 and len(problem.q) > SPARSE else matrix.toarray()
        given = numerics.FrictionContactProblem(problem.dim, len(problem.mu), stored, problem.q, problem.mu)
        r, u = np.zeros(len(problem.q)), np.zeros(len(problem.q))
        driver = numerics.fc2d_driver if problem.dim == 2 else numerics.fc3d_driver
        began = clock.perf_counter()
        driver(given, r, u, options)
        return clock.perf_counter() - began, r

    def solver(problem: DiscreteProblem, tolerance: float) -> tuple[float, Array | None]:
        if not (plane if problem.dim == 2 else space):
            return math.inf, None
        for part in ASKED:
            taken, r = once(problem, part * tolerance)
            if left_by(problem, r) <= tolerance or taken > LIMIT:
                break
        return taken, r

    return solver


def installed() -> Any | None:
    """Return Siconos's module of solvers; None if it is not installed."""
    try:
        return importlib.import_module("siconos.numerics")
    except ImportError:
        return None


def left_by(problem: DiscreteProblem, r: Array | None) -> float:
    """Return the residual of reactions r (rows,); inf if there are none."""
    if r is None or not np.isfinite(r).all():
        return math.inf
    return residual(r, problem.surface.matrix @ r + problem.q, problem.mu)


def measure(problem: DiscreteProblem, solver: Solver, tolerance: float) -> float:
    """Return seconds of one solver; inf if it does not solve the problem."""
    taken, r = solver(problem, tolerance)
    return taken if left_by(problem, r) <= tolerance * (1 + ROUNDING) else math.inf


def line(name: str, times: Mapping[str, float]) -> str:
    """Return seconds of each solver on one problem, and our default's time by that of Siconos's fastest."""
    cells = " ".join(f"{t:{WIDE}.4f}" if math.isfinite(t) else f"{'-':>{WIDE}}" for t in times.values())
    others, ratio = [t for solver, t in times.items() if not solver.startswith(OURS)], ""
    if others and OURS + AUTO in times:
        best = max(min(others), CLOCK)
        ratio = f"{max(times[OURS + AUTO], CLOCK) / best:.2g}" if math.isfinite(best) else "Siconos: none"
    return f"{name[:38]:38} {cells}  {ratio}".rstrip()


def profile(found: Mapping[str, Sequence[float]]) -> Iterator[str]:
    """Yield the performance profile as a table."""
    yield "share of the problems that a solver solves within a factor of the fastest one's time:"
    yield f"{'solver':22} " + " ".join(f"{factor:>6g}" for factor in FACTORS) + "    any"
    for name, values in shares(found).items():
        yield f"{name:22} " + " ".join(f"{100 * value:5.0f}%" for value in values)


def main(
    files: Annotated[list[Path], typer.Argument(help="discrete problems in the FCLIB format")],
    tolerance: Annotated[float, typer.Option(help="on the residual")] = 1e-8,
    method: Annotated[list[str] | None, typer.Option(help="our methods; repeat [auto]")] = None,
    picture: Annotated[Path | None, typer.Option(help="PNG of the performance profile")] = None,
) -> None:
    """Measure, and print the table."""
    try:
        for name in method or ():
            refuse_unusable(name)
        problems = {path.stem: read_problem(path) for path in files}
    except StickslipError as error:
        raise SystemExit(f"discrete: {error}") from None
    solvers = {OURS + name: ours(name) for name in method or (AUTO,)}
    numerics = installed()
    warnings.filterwarnings("ignore", module="siconos")  # of how it stores sparse matrices
    if numerics is None:
        print("Siconos is not installed (Debian: python3-siconos): our methods alone")
    else:
        numerics.numerics_set_verbose(0)
        solvers |= {name: siconos(numerics, *which) for name, which in SICONOS.items()}
    found: dict[str, list[float]] = {name: [] for name in solvers}
    print(f"{'problem':38} " + " ".join(f"{name[-WIDE:]:>{WIDE}}" for name in solvers) + "  default/Siconos")
    for stem, stored in problems.items():
        problem = discrete_problem(stored.W, stored.q, stored.mu)
        times = {name: measure(problem, solver, tolerance) for name, solver in solvers.items()}
        print(line(stem, times), flush=True)
        for name, taken in times.items():
            found[name].append(taken)
    print("\n".join(profile(found)))
    if picture is not None:
        try:
            draw_profile(picture, f"{len(problems)} discrete problems at {tolerance:g}", found)
        except MachineError as error:
            raise SystemExit(f"discrete: {error}") from None


if __name__ == "__main__":
    typer.run(main)
