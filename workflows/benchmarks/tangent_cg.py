"""The price of tangent-cg: `python -m stickslip.workflows.benchmarks.tangent_cg` writes docs/tangent_cg.md.

It stands beside surface-uzawa, in linear solves and in seconds. One core, one thread. Seconds are CPU seconds of
preparation and steps, without mesh, assembly and results; a linear solve is one of the same bodies with their contact
nodes held, to 1e-8, the fastest of three.
"""

from __future__ import annotations

import os
import time as clock
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from stickslip.geometry.errors import StickslipError
from stickslip.solvers.results.linear_reference import linear_reference
from stickslip.solvers.simulation.simulation import Simulation, prepare
from stickslip.workflows.formats.aside import write_aside
from stickslip.workflows.scene_file.read import read

for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[threads] = "1"

PAGE = Path(__file__).resolve().parents[2] / "docs" / "tangent_cg.md"
METHODS = ("tangent-cg", "surface-uzawa")
FRICTION = (0.05, 0.3, 1.0)
TOLERANCES = (1e-4, 1e-8)
SOLVER = "cg+boomeramg"  # the linear solve whose cycles are counted
OTHERS: dict[str, tuple[str, tuple[str, ...]]] = {
    "cube, tetrahedra": ("cube", ("geometry.cells=simplex", "geometry.mesh_size=0.06")),
    "cube, order 2": ("cube", ("geometry.order=2", "geometry.mesh_size=0.1")),
    "cube, 16 steps": ("cube", ("geometry.mesh_size=0.05", "steps.count=16")),
    "half_ball": ("half_ball", ("geometry.mesh_size=0.09",)),
    "spheres": ("spheres", ()),
}
INTRODUCTION = """# The price of tangent-cg

`tangent-cg` decides contact while the bodies are solved: an iteration is one product with the stiffness, one
multigrid cycle and sweeps over the contact points. `surface-uzawa` solves the bodies once in each of its iterations.
Below, both steps of the ready scene `cube` (pressed, then dragged; n cells a side, hexahedra), by friction coefficient
and tolerance; then other scenes.

A *solve* is one linear solve of the same bodies with their contact nodes held, by conjugate gradients with BoomerAMG
to 1e-8: in the columns *cycles* they are counted (multigrid cycles of the run over those of the solve), in the columns
*seconds* CPU seconds of preparation and steps are divided by the wall time of the solve, the least of three. One core
of a shared machine: counts are firm, seconds are not. The error is what the method states of the last step, in the
energy norm. Where nearly all points slip (μ = 0.05), cycles include those that make coarse motions.

Few steps on a large contact surface are where it wins; with many steps on one operator `surface-uzawa` has learnt the
operator, and where little of the surface touches (`half_ball`, `spheres`) it takes fewer cycles. So `auto` does not
take it yet: ask for it, `solver.method = "tangent-cg"`, where much of the surface is pressed and most of it sticks.

"""


@dataclass(frozen=True)
class Measured:
    """One run."""

    cycles: int
    iterations: tuple[int, ...]  # by step
    seconds: float  # CPU [s]
    error: float  # energy norm, relative
    solve: tuple[int, float]  # iterations and seconds of the linear solve


def measure(simulation: Simulation, prepared: float) -> Measured:
    """Solve all steps.

    Raises:
        StepError: a step could not be solved.
    """
    stepper, counters = simulation.stepper, simulation.counters
    state, began, iterations = stepper.start(), clock.process_time(), []
    for time in simulation.scene.requested_times():
        accepted = stepper.reach(state, time, lambda row: None)
        state = accepted.state
        iterations.append(accepted.iterations)
    seconds, cycles = prepared + clock.process_time() - began, counters.linear_iterations
    assert state.correction is not None
    solves = [linear_reference(simulation.system, SOLVER).solvers[SOLVER] for _ in range(3)]
    best = min(solves, key=lambda solve: solve.seconds)
    error = state.correction.size / float(state.peak * 2) ** 0.5
    return Measured(cycles, tuple(iterations), seconds, error, (best.iterations or 0, best.seconds))


def run(scene: str, settings: tuple[str, ...], method: str, tolerance: float) -> Measured | str:
    """Prepare and solve a ready scene; the sentence of what went wrong."""
    solver = f'solver={{ method = "{method}", surface = "matrix-free", tolerance = {tolerance!r} }}'
    try:
        simulation = prepare(read(scene, [*settings, solver, "output.error=false"]))
        return measure(simulation, simulation.seconds.prepare)
    except StickslipError as error:
        return str(error).split(";")[0]


def line(name: str, found: tuple[Measured | str, ...]) -> str:
    """A row of the table: counts, solves and seconds of each method."""
    cells = [name]
    for one in found:
        if isinstance(one, str):
            cells += [one, "", "", ""]
        else:
            count, seconds = one.solve
            steps = " + ".join(map(str, one.iterations)) if len(one.iterations) < 3 else str(sum(one.iterations))
            cells += [steps, f"{one.cycles / count:.1f}", f"{one.seconds / seconds:.1f}", f"{one.error:.0e}"]
    return "| " + " | ".join(cells) + " |"


def lines(sizes: tuple[int, ...]) -> Iterator[str]:
    """The rows of both tables."""
    heads = "".join(f" {m}: iterations | cycles [solves] | seconds [solves] | error |" for m in METHODS)
    head = f"| case, tolerance |{heads}\n|---" + "|---" * 4 * len(METHODS) + "|"
    yield "## Cube\n"
    yield head
    for n in sizes:
        for mu in FRICTION:
            for tolerance in TOLERANCES:
                settings: tuple[str, ...] = f"geometry.mesh_size={1 / n!r}", f"contacts.base.friction.mu={mu}"
                found = tuple(run("cube", settings, method, tolerance) for method in METHODS)
                yield line(f"n = {n}, μ = {mu:g}, {tolerance:g}", found)
    yield "\n## Other scenes\n"
    yield head
    for name, (scene, more) in OTHERS.items():
        for tolerance in TOLERANCES:
            yield line(f"{name}, {tolerance:g}", tuple(run(scene, more, m, tolerance) for m in METHODS))


def main(
    sizes: Annotated[str, typer.Option(help="cells a side of the cube")] = "16,24,36,48",
    output: Annotated[Path, typer.Option("-o", "--output", help="where the page goes")] = PAGE,
) -> None:
    """Measure, print each row as it is found, and write the page."""
    rows = []
    for row in lines(tuple(map(int, sizes.split(",")))):
        print(row, flush=True)
        rows.append(row)
    write_aside(output, (INTRODUCTION + "\n".join(rows) + "\n").encode())


if __name__ == "__main__":
    typer.run(main)
