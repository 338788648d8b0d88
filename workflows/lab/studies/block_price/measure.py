"""The measurements: cases of each table, one thing varied from a base case; their work, seconds and errors.

Errors of λ and u are those against condensed-newton on the same mesh.
"""

from __future__ import annotations

import json
import signal
import time as clock
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from mpi4py import MPI

from stickslip import Compliance, Scene, Simulation, StepResult, StickslipError, prepare
from stickslip.geometry.arrays import Array
from stickslip.solvers.system.system import System
from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.lab.studies.finding import Row
from stickslip.workflows.lab.studies.published.contact import scene

Mesh = tuple[int, int]  # dimension, n
TOLERANCE, EXACT = 1e-8, 1e-12  # of the methods, and of the reference
HEIGHT = {2: 2.0, 3: 1.0}  # m, of the ready scenes `block` and `cube`; E = 1 Pa
REFERENCE, BLOCK, INEXACT = "condensed-newton", "block-uzawa", ", inexact"
CONDENSED = (REFERENCE, "surface-uzawa", "gram-uzawa", "uzawa")
FACTORS = ("complete", "drop", "ic0")
Q = ("mass", *(f"gram {factor}" for factor in FACTORS))
EXACTLY = tuple(f"{BLOCK}, {each}" for each in Q)
METHODS = (*CONDENSED, *EXACTLY, *(name + INEXACT for name in EXACTLY))
LIKE = {"uzawa": f"{BLOCK}, mass", "gram-uzawa": f"{BLOCK}, gram complete"}  # the same iteration, not condensed


def solver_keys(method: str) -> dict[str, Any]:
    """Keys of [solver] that a name of METHODS stands for.

    >>> solver_keys("block-uzawa, mass, inexact")
    {'method': 'block-uzawa', 'preconditioner': 'mass', 'inner_solves': 'inexact'}
    """
    if method in CONDENSED:
        return {"method": method}
    _, preconditioner, *rest = method.split(", ")
    found: dict[str, Any] = {"method": BLOCK, "preconditioner": preconditioner.split(" ")[0]}
    found["inner_solves"] = "inexact" if rest else "exact"
    if preconditioner != "mass":
        found["gram"] = {"factor": preconditioner.split(" ")[1]}
    return found


@dataclass(frozen=True, kw_only=True)
class Case:
    """One measurement: a mesh of n cells over the height, a contact, and a method."""

    dim: int
    n: int
    method: str
    mu: float = 0.3
    c_n: float | None = None  # normal compliance in E/L, L the height; None: unilateral contact
    steps: int = 2  # 1: pressed and dragged in one step
    sticks: bool = False  # the base is glued: bilateral contact that never slips, a linear problem
    part: float | None = None  # of the bound 2 / lambda_1 on alpha; None: the default
    rule: str = "elman-golub"
    share: float = 0.3  # inner tolerance

    @property
    def name(self) -> str:
        """Name of its file."""
        return "_".join(f"{key}-{value}" for key, value in asdict(self).items()).replace(" ", "-").replace(",", "")

    @property
    def problem(self) -> Case:
        """The same problem for the reference."""
        return Case(
            **{key: getattr(self, key) for key in ("dim", "n", "mu", "c_n", "steps", "sticks")}, method=REFERENCE
        )

    def scene(self, tolerance: float = TOLERANCE, lambda_1: float | None = None) -> Scene:
        """The ready scene `block` or `cube`, changed.

        Args:
            lambda_1: largest eigenvalue that `part` refers to, where Q = W.
        """
        keys = solver_keys(self.method) | {"tolerance": tolerance}
        if keys["method"] == BLOCK:
            keys |= {"inner_rule": self.rule, "inner_tolerance": self.share}
        if self.part is not None:
            keys |= {"alpha": self.part * 2 / lambda_1} if lambda_1 else {"relaxation": 2 * self.part}
        law = "bilateral" if self.sticks else "unilateral"
        laid = scene(self.dim, self.n, self.mu, law, sticks=self.sticks, at_once=self.steps == 1, **keys)
        if self.c_n is None:
            return laid
        soft = replace(laid.contacts["base"], normal=Compliance(c_n=self.c_n / HEIGHT[self.dim]))
        return replace(laid, contacts={"base": soft})


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """Meshes and parameters of each table."""

    meshes: tuple[Mesh, ...] = ((2, 8), (2, 16), (2, 32), (3, 4), (3, 8), (3, 16))
    at: tuple[Mesh, ...] = ((2, 16), (3, 4))  # of the tables that do not vary h
    methods: tuple[str, ...] = METHODS
    mu: tuple[float, ...] = (0.05, 0.3, 1.0)
    c_n: tuple[float, ...] = (0.1, 10.0, 1e3)
    parts: tuple[float, ...] = (0.25, 0.5, 0.75, 0.9, 0.99, 1.02, 1.1)
    bound_at: Mesh = (2, 8)
    inner_at: tuple[Mesh, ...] = ((2, 16), (3, 4))
    inner: tuple[tuple[str, float], ...] = (
        ("elman-golub", 0.01),
        ("elman-golub", 0.1),
        ("elman-golub", 0.3),
        ("elman-golub", 0.6),
        ("bramble-pasciak-vassilev", 0.3),
        ("bramble-pasciak-vassilev", 0.01),
        ("bramble-pasciak-vassilev", 1e-8),
    )


SMALL = Sizes(
    meshes=((2, 4), (2, 8), (3, 2), (3, 4)),
    methods=tuple(name for name in METHODS if "drop" not in name),
    at=((2, 4),),
    mu=(0.3, 1.0),
    c_n=(1e3,),
    parts=(0.5, 0.9, 1.1),
    bound_at=(2, 4),
    inner_at=((2, 4),),
    inner=(("elman-golub", 0.3), ("bramble-pasciak-vassilev", 1e-8)),
)
AS_EXACT = ("bramble-pasciak-vassilev", 1e-8)  # inner solves that stand for exact ones, in conjugate gradients


def tables(sizes: Sizes) -> Mapping[str, list[Case]]:
    """The cases of every table; those of one problem stand together. A case may be in several tables."""
    found: dict[str, list[Case]] = {"h": [], "mu": [], "c_n": [], "steps": [], "alpha": [], "inner": []}
    for dim, n in sizes.meshes:
        found["h"] += [Case(dim=dim, n=n, method=method) for method in sizes.methods]
    for dim, n in sizes.at:
        for mu in sizes.mu:
            found["mu"] += [Case(dim=dim, n=n, method=method, mu=mu) for method in sizes.methods]
        for c_n in sizes.c_n:
            found["c_n"] += [Case(dim=dim, n=n, method=method, c_n=c_n) for method in sizes.methods]
        for steps in (2, 1):
            found["steps"] += [Case(dim=dim, n=n, method=method, steps=steps) for method in sizes.methods]
    dim, n = sizes.bound_at
    for sticks in (True, False):
        for part in sizes.parts:
            found["alpha"].append(Case(dim=dim, n=n, method=EXACTLY[0], sticks=sticks, part=part))
    within = filter(lambda part: part < 1, sizes.parts)  # beyond the bound, a relaxation is refused
    found["alpha"] += [Case(dim=dim, n=n, method=EXACTLY[1], part=part) for part in within]
    for dim, n in sizes.inner_at:
        for method in EXACTLY[:2]:
            found["inner"].append(Case(dim=dim, n=n, method=method))
            for rule, share in sizes.inner:
                found["inner"].append(Case(dim=dim, n=n, method=method + INEXACT, rule=rule, share=share))
    return found


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
    """Reference that errors are measured against."""

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
