"""Time of each phase of a long history: `python -m stickslip.workflows.lab.benchmarks.history --steps 1000` prints it.

A heavy strip is pulled back and forth at its end; one core, one thread. Averages over hundreds of steps show whether
a step costs the same at the end as at the beginning.
"""

from __future__ import annotations

import os
import tempfile
import time as clock
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any
from unittest import mock

import numpy as np
import typer

from stickslip import Scene, Simulation, SolverError, StepResult, Watch, read
from stickslip.solvers.results.observe import Observer
from stickslip.solvers.simulation.checkpoint import Checkpoints
from stickslip.workflows.cost.measure import ONE_THREAD
from stickslip.workflows.lab.benchmarks.own_process import silence
from stickslip.workflows.run import run as running
from stickslip.workflows.run.resume import LearntFiles
from stickslip.workflows.writers.tables import TableWriter
from stickslip.workflows.writers.xdmf import FieldFiles

os.environ.update(ONE_THREAD)  # before the first operation that would start them

CYCLES = 5
LENGTH = 2.0  # [m] of the strip
AMPLITUDE = 0.004  # [m] of its end: slip travels over two thirds of the strip, and back again, in every cycle
PHASES: Mapping[str, tuple[Any, str]] = {  # phases of output, by the functions that are called
    "observe": (Observer, "__call__"),
    "checkpoint": (Checkpoints, "take"),
    "learnt": (LearntFiles, "write"),
    "tables": (TableWriter, "step"),
    "step files": (running, "write_step"),
    "XDMF": (FieldFiles, "step"),
    "time steps": (Simulation, "time_step_errors"),
    "audit": (running, "audit_steps"),
    "result.json": (running, "write_result"),
}
BLOCK = 100  # steps whose seconds are shown together


@dataclass
class Stopwatch:
    """Seconds that calls took, by phase; a call within another one is part of that."""

    seconds: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    inside: bool = False  # of a call that is timed

    @contextmanager
    def on(self, phase: str, owner: Any, name: str) -> Iterator[None]:
        """Time all calls of `owner.name` while the context lasts."""
        called = getattr(owner, name)

        def timed(*args: Any, **keys: Any) -> Any:
            if self.inside:
                return called(*args, **keys)
            self.inside, began = True, clock.perf_counter()
            try:
                return called(*args, **keys)
            finally:
                self.inside = False
                self.seconds[phase] += clock.perf_counter() - began

        with mock.patch.object(owner, name, timed):
            yield


def scene(steps: int, points: int, method: str = "auto") -> Scene:
    """The ready scene `strip`: weight in the first step, then `CYCLES` cycles of pulling."""
    turn = (steps - 1) / (4 * CYCLES)  # steps from one turn to the next, about
    times = [1 + round(turn * k) for k in range(4 * CYCLES + 1)]  # every time of the table is a step
    draw = [[0.0, 0.0], *([float(t), AMPLITUDE * (0, 1, 0, -1)[k % 4]] for k, t in enumerate(times))]
    return read(
        "strip",
        [
            f"geometry.mesh_size={LENGTH / points!r}",  # the last node is held by the grip
            f"supports.grip.displacement={{ x = {draw}, y = 0.0 }}",
            f"steps={{ end = {float(steps)}, count = {steps} }}",
            f'solver.method="{method}"',
            "output.pictures=false",
        ],
    )


@dataclass(frozen=True)
class Cost:
    """Time and work of a history."""

    dofs: int
    points: int
    method: str
    seconds: Mapping[str, float]  # by phase
    cpu: float  # CPU time of all phases [s]; less than `seconds` if the machine is shared or waits for the disk
    blocks: tuple[tuple[float, float, float], ...]  # seconds, iterations, volume solves a step, mean of `BLOCK` steps

    def lines(self) -> Iterator[str]:
        """The report."""
        yield f"{self.dofs} dofs, {self.points} contact points, {self.method}"
        total = self.seconds["total"]
        yield f"{'phase':12} {'seconds':>9} {'share':>7}"
        for phase, seconds in self.seconds.items():
            yield f"{phase:12} {seconds:9.2f} {100 * seconds / total:6.1f} %"
        yield f"CPU seconds  {self.cpu:8.2f}"
        yield f"{'step':>5} {'s/step':>9} {'iterations':>11} {'volume solves':>14}"
        for k, (seconds, iterations, solves) in enumerate(self.blocks):
            yield f"{BLOCK * k + 1:5} {seconds:9.4f} {iterations:11.2f} {solves:14.2f}"


def measure(steps: int, points: int, method: str, folder: Path) -> Cost:
    """Run the history, results in a new `folder`."""
    watch, marks, solved = Stopwatch(), [clock.perf_counter()], list[tuple[int, int]]()

    def on_step(step: StepResult) -> None:
        solved.append((step.iterations, step.volume_solves))
        marks.append(clock.perf_counter())

    def on_prepared(simulation: Simulation) -> None:
        marks[0] = clock.perf_counter()

    before = clock.process_time()
    with ExitStack() as stack:
        for phase, place in PHASES.items():
            stack.enter_context(watch.on(phase, *place))
        outcome, content = running.run(
            scene(steps, points, method), folder, Watch(on_prepared=on_prepared, on_step=on_step)
        )
    if outcome.status != "converged":
        raise SolverError(f"the history ended: {outcome.sentence}")
    told = content["seconds"]
    seconds = {key: told[key] for key in ("mesh", "assemble", "prepare", "iterate")}
    seconds |= {phase: watch.seconds[phase] for phase in PHASES}
    rows = np.column_stack([np.diff(marks), solved])
    return Cost(
        dofs=content["dofs"],
        points=content["contact_points"],
        method=content["method"],
        seconds=seconds | {"other": told["total"] - sum(seconds.values()), "total": told["total"]},
        cpu=clock.process_time() - before,
        blocks=tuple(tuple(rows[k : k + BLOCK].mean(axis=0)) for k in range(0, len(rows), BLOCK)),
    )


def main(
    steps: Annotated[int, typer.Option(help="load steps", min=4 * CYCLES + 1)] = 1000,
    points: Annotated[int, typer.Option(help="contact points")] = 500,
    method: Annotated[str, typer.Option(help="solver.method")] = "auto",
    output: Annotated[Path | None, typer.Option("-o", "--output", help="where the results stay")] = None,
) -> None:
    """Run the history and print its cost."""
    silence()
    with tempfile.TemporaryDirectory() as folder:
        for line in measure(steps, points, method, output or Path(folder) / "run").lines():
            print(line)


if __name__ == "__main__":
    typer.run(main)
