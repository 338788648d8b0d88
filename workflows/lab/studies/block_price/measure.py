"""One measurement: work, seconds, and the errors of λ and u against condensed-newton on the same mesh."""

from __future__ import annotations

import json
import signal
import time as clock
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from types import FrameType

import numpy as np
from mpi4py import MPI

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import StickslipError
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation, prepare
from stickslip.solvers.system.system import System
from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.lab.studies.block_price.cases import EXACT, EXACTLY, Case
from stickslip.workflows.lab.studies.published.finding import Row

SHORT, TIMES = 0.5, 3  # s; shorter runs are repeated, up to so many times, and the shortest counts
AGAIN = 0.1  # s between two reminders that the time is over: one within a callback that ignores exceptions is lost
COARSE = 2  # cells over the height in the run before, which loads the forms


class OverTimeError(BaseException):
    """The time of a measurement is over: raised by a signal, like KeyboardInterrupt, and no error."""


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise `OverTimeError` after so many seconds of CPU time."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise OverTimeError

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds, AGAIN)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


@dataclass(frozen=True)
class Solved:
    """A scene solved to its end."""

    simulation: Simulation
    steps: tuple[StepResult, ...]
    cpu: float  # [s]
    wall: float  # [s]

    @property
    def u(self) -> Array:
        """Displacement of all dofs at the end [m]."""
        last = self.simulation.reported
        assert last is not None
        return np.array(last.state.u.array)

    @property
    def seconds(self) -> float:
        """Preparation and iteration [s]."""
        return self.simulation.seconds.prepare + self.simulation.seconds.iterate


@dataclass(frozen=True)
class Exact:
    """What errors are measured against."""

    lam: Array  # (n, d)
    bound: Array  # (n,) [Pa]
    weight: Array  # (n,) [m^(d-1)]
    u: Array  # all dofs [m]


def row_of(case: Case, folder: Path, limit: float) -> Row:
    """The row: read if it was measured before, else measured and saved; one that was stopped gets more time."""
    path = folder / f"{case.name}.json"
    if path.exists():
        row: Row = json.loads(path.read_text())
        if row.get("stopped", limit) >= limit:
            return row
    write_aside(path, json.dumps(measure(case, limit), default=float, allow_nan=False).encode())
    found: Row = json.loads(path.read_text())
    return found


def measure(case: Case, limit: float) -> Row:
    """The row of a case; one that fails, or takes more than `limit` seconds, says so in its status.

    Errors are taken at the end of the last step: of λ over the nodes where the reference has s > 0, the largest one
    and the root of the weighted mean square; of u in the energy norm, relative.
    """
    row: Row = asdict(case)
    try:
        exact, scene = reference(case.problem), case.scene(lambda_1=_lambda_1(case))
        warm_up(replace(case.problem, n=COARSE, method=case.method))
        with limited(limit):
            found = shortest(scene)
    except OverTimeError:
        return row | {"status": f"stopped after {limit:g} s", "stopped": limit}
    except StickslipError as error:
        return row | {"status": str(error)}
    seconds, counters = found.simulation.seconds, found.simulation.counters
    last = found.steps[-1]
    base, told = last.contacts["base"], last.convergence
    loaded = exact.bound > 0
    off = np.linalg.norm(base.lam - exact.lam, axis=1)[loaded]
    weight, system = exact.weight[loaded], found.simulation.system
    return row | {
        "status": "converged",
        "dofs": found.simulation.system.constraints.free_total,
        "points": len(base.weight),
        "iterations": sum(step.iterations for step in found.steps),
        "substeps": sum(step.substeps for step in found.steps),
        "volume_solves": counters.volume_solves,
        "for_lambda_1": counters.lanczos_applications,
        "linear_iterations": counters.linear_iterations,
        "prepare": seconds.prepare,
        "iterate": seconds.iterate,
        "seconds": found.seconds,
        "cpu": found.cpu,
        "wall": found.wall,
        "residual": max(step.residual for step in found.steps),
        "lambda_1": told.lambda_1 if told else None,
        "lam_max": off.max(initial=0.0),
        "lam_l2": float(np.sqrt(weight @ off**2 / weight.sum())) if len(off) else 0.0,
        "u_error": _energy(system, found.u - exact.u) / _energy(system, exact.u),
    }


def shortest(scene: Scene) -> Solved:
    """The scene solved; several times if that is short, and the shortest counts."""
    found = solve(scene)
    for _ in range(TIMES - 1):
        if found.seconds < SHORT:
            found = min(found, solve(scene), key=lambda each: each.seconds)
    return found


def solve(scene: Scene) -> Solved:
    """Solve a scene."""
    wall, cpu = clock.perf_counter(), clock.process_time()
    simulation = prepare(scene, MPI.COMM_SELF)
    steps = tuple(simulation.steps())
    return Solved(simulation, steps, clock.process_time() - cpu, clock.perf_counter() - wall)


@lru_cache(maxsize=1)
def reference(case: Case) -> Exact:
    """The answer of condensed-newton to EXACT."""
    found = solve(case.scene(EXACT))
    base = found.steps[-1].contacts["base"]
    return Exact(base.lam, base.bound, base.weight, found.u)


@lru_cache
def warm_up(case: Case) -> None:
    """One iteration on a coarse mesh, so that compiling and loading of forms is in no measurement."""
    scene = case.scene()
    with suppress(StickslipError):  # it is not to converge
        solve(replace(scene, solver=replace(scene.solver, max_iterations=1)))


@lru_cache
def known_lambda_1(case: Case) -> float:
    """lambda_1 of W^-1 B F'^-1 B^T, as block-uzawa measures it [m/Pa]."""
    told = solve(case.scene()).steps[-1].convergence
    assert told is not None
    return told.lambda_1


def _lambda_1(case: Case) -> float | None:
    if case.part is None or case.method != EXACTLY[0]:
        return None
    return known_lambda_1(replace(case.problem, method=EXACTLY[0]))


def _energy(system: System, u: Array) -> float:
    """(u . K u)^(1/2) [J^(1/2)]."""
    x = system.vector()
    x.array[:] = u
    return float(np.sqrt(max((system.K * x).dot(x), 0.0)))
