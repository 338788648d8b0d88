"""Cost of `auto` beside the best method: `python -m stickslip.workflows.lab.benchmarks.auto` prints the table.

Every method solves each scene in 2 and in 32 steps. CPU seconds of preparation and steps, without mesh, assembly and
results; one thread. A run that takes longer than the limit is extended by its last steps, and marked ~.
"""

from __future__ import annotations

import gc
import json
import time as clock
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from mpi4py import MPI

from stickslip import Contact, Counters, HistoryRow, Scene, SolverError, Tied, read
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.stepping.choice import Choice, Size, Stage, choose
from stickslip.solvers.stepping.method_chain import MethodChain, Reached
from stickslip.solvers.stepping.stepper import Stepper
from stickslip.solvers.system.system import System, assemble
from stickslip.workflows.lab.benchmarks.own_process import apart
from stickslip.workflows.lab.verification.prepared import march

STAGES = (
    Stage("condensed-newton", "condensed"),
    Stage("surface-uzawa", "condensed"),
    Stage("surface-uzawa", "matrix-free"),
    Stage("tangent-cg", "matrix-free"),
)
COUNTS = (2, 32)  # load steps
LONG = "took longer than the limit"


@dataclass(frozen=True)
class Case:
    """A ready scene with all mesh sizes scaled, and what else is set."""

    scene: str
    scale: float
    settings: tuple[str, ...] = ()
    label: str = ""
    tied: bool = False  # whether the bodies are tied to each other
    free: tuple[str, ...] = ()  # supports that are left out

    @property
    def name(self) -> str:
        return self.label or self.scene

    def read(self, count: int) -> Scene:
        """Return the scene in `count` equal steps."""
        shape = read(self.scene).geometry
        sizes = [key for key in vars(shape) if key.endswith("mesh_size") and getattr(shape, key)]
        meshed = [f"geometry.{key}={self.scale * getattr(shape, key)!r}" for key in sizes]
        scene = read(self.scene, [*meshed, f"steps.count={count}", *self.settings])
        contacts = {
            name: Contact(surface=c.surface, against=c.against, normal=Tied())
            if self.tied and c.against not in scene.obstacles
            else c
            for name, c in scene.contacts.items()
        }
        supports = {name: support for name, support in scene.supports.items() if name not in self.free}
        return replace(scene, contacts=contacts, supports=supports)


BARS = (
    "geometry.length=10.0",
    "geometry.lower_length=10.0",
    "geometry.height=0.3",
    "bodies.upper.density=1e-3",
    "gravity={ acceleration = [[[0, 0], [1, 0], [2, 1.0]], [[0, 0], [1, -9.81]]] }",
)
WEIGHT = (
    "bodies.block.density=1e-3",
    "gravity={ acceleration = [[[0, 0], [1, 0], [2, 1.0]], 0.0, [[0, 0], [1, -9.81]]] }",
)
LINEAR = ("geometry.order=1",)
CASES = (
    *(Case("block", scale) for scale in (1.6, 0.5, 0.16)),
    *(Case("two_blocks", scale) for scale in (1.5, 0.45, 0.14)),
    *(Case("cylinders", scale) for scale in (1.5, 0.45, 0.2)),
    *(Case("cube", scale) for scale in (1.15, 0.53, 0.32)),
    *(Case("cube", scale, ("geometry.order=2",), "cube, order 2") for scale in (1.15, 0.75)),
    *(Case("cube", scale, WEIGHT, "cube, floats", free=("top",)) for scale in (0.53, 0.4)),
    *(Case("half_ball", scale, LINEAR) for scale in (1.5, 0.675, 0.375, 0.21)),
    *(Case("spheres", scale, LINEAR) for scale in (1.5, 0.75, 0.45)),
    Case("two_blocks", 0.45, label="two_blocks, tied", tied=True),
    Case("two_blocks", 1.0, BARS[3:], "two_blocks, 1 floats", free=("top",)),
    Case("two_blocks", 1.0, BARS[:3], "bars, held"),
    Case("two_blocks", 1.0, BARS, "bars, 1 floats", free=("top",)),
    Case("two_blocks", 1.0, BARS, "bars, 1 floats, tied", True, free=("top",)),
    Case("shrink_fit", 0.5, label="rings, 1 floats"),
    *(Case("strip", scale, label="strip, floats") for scale in (0.5, 0.12)),
    Case("stack", 1.0, label="stack, 9 float"),
    Case("stack", 1.0, label="stack, 9 float, tied", tied=True),
)


@dataclass(frozen=True)
class Run:
    """CPU seconds of one method."""

    prepared: float  # [s]
    steps: tuple[float, ...]  # [s] of each step that was solved
    iterations: tuple[int, ...]  # of each
    linear: int  # iterations of conjugate gradients
    count: int  # of steps that the scene has
    status: str

    @property
    def complete(self) -> bool:
        return len(self.steps) == self.count

    @property
    def seconds(self) -> float:
        """Sum up all steps; those that are missing cost as much as the last ones, inf if there are none."""
        if not self.steps or not (self.complete or self.status == LONG):
            return np.inf
        last = self.steps[len(self.steps) // 2 :]
        return self.prepared + sum(self.steps) + (self.count - len(self.steps)) * sum(last) / len(last)


@dataclass(frozen=True)
class Row:
    """A scene in a number of steps."""

    name: str
    size: Size
    auto: str  # the stage that `auto` begins with
    runs: Mapping[str, Run]  # by stage

    @property
    def ratio(self) -> float:
        """Return seconds of the stage that `auto` begins with, over those of the fastest."""
        return self.runs[self.auto].seconds / min(run.seconds for run in self.runs.values())

    def line(self) -> str:
        """Return the line of the table."""
        size = self.size
        told = "".join(f"{run.seconds:9.2f}{' ' if run.complete else '~'}" for run in self.runs.values())
        begins = f"| {self.auto:29} {self.ratio:5.2f}"
        return f"{self.name:22}{size.dofs:8}{size.contact_dofs:8}{size.steps:6}" + told + begins


class LimitError(Exception):
    """The limit was passed."""


def measure(system: System, stage: Stage, limit: float) -> Run:
    """Solve all steps of the system's scene by one method, or as many as the limit [s] allows."""
    system.counters.linear_iterations = 0
    began = clock.process_time()

    def watch(row: HistoryRow | None = None) -> None:
        if clock.process_time() - began > limit:
            raise LimitError

    stepper = Stepper(system, MethodChain(system, Reached(Choice((stage,), ""), 0, ())))
    prepared = clock.process_time() - began
    began = clock.process_time()
    marks, iterations, status, count = [began], list[int](), "converged", len(system.course.timeline.times)
    try:
        for accepted in march(stepper, watch):
            iterations.append(accepted.iterations)
            marks.append(clock.process_time())
            if len(iterations) < count:
                watch()
    except LimitError:
        status = LONG
    except SolverError as error:
        status = str(error)
    linear = system.counters.linear_iterations
    return Run(prepared, tuple(np.diff(marks)), tuple(iterations), linear, count, status)


def row(case: Case, count: int, limit: float) -> Row:
    """Measure a case in `count` steps; `limit` [s] is that of a run."""
    scene = case.read(count)
    problem = resolve(scene)
    mesh = build_mesh(problem.shape, problem.request, MPI.COMM_WORLD)
    system = assemble(problem, mesh, Counters())
    _ = system.K_B  # assembled too
    size = Size.of(problem, mesh, system.constraints, system.contacts)
    begins = str(choose(system).stages[0])
    runs = {}
    for stage in STAGES:
        runs[str(stage)] = measure(system, stage, limit)
        gc.collect()  # factors are large
    return Row(case.name, size, begins, runs)


def main(
    limit: Annotated[float, typer.Option(help="CPU seconds that the steps of one run may take", min=0.1)] = 20.0,
    only: Annotated[str, typer.Option(help="scenes whose name contains this")] = "",
    output: Annotated[Path | None, typer.Option("-o", "--output", help="file for one line of JSON a row")] = None,
) -> None:
    """Measure, and print the table."""
    names = "".join(f"{name:>9} " for name in ("newton", "uzawa", "free", "tangent"))
    print(f"{'scene':22}{'dofs':>8}{'contact':>8}{'steps':>6}{names}| auto begins with")
    for case, count in product((case for case in CASES if only in case.name), COUNTS):
        found = apart(row, case, count, limit)
        print(found.line(), flush=True)
        if output:
            with output.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(found)) + "\n")


if __name__ == "__main__":
    typer.run(main)
