"""The price of tangent-cg: `python -m stickslip.workflows.lab.benchmarks.tangent_cg` writes docs/tangent_cg.md.

It stands beside surface-uzawa, in linear solves and in seconds. One core, one thread. Seconds are CPU seconds of
preparation and steps, without mesh, assembly and results; a linear solve is one of the same bodies with their contact
nodes held, to 1e-8, by the fastest solver.
"""

from __future__ import annotations

import os
import time as clock
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from stickslip import Simulation, StickslipError, prepare, read
from stickslip.solvers.results.linear_reference import linear_reference
from stickslip.workflows.cost.measure import ONE_THREAD
from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.formats.templates import render
from stickslip.workflows.lab.benchmarks.price_run import cubes
from stickslip.workflows.lab.verification.prepared import march, pressed

os.environ.update(ONE_THREAD)  # before the first operation that would start them

PAGE = Path(__file__).resolve().parents[3] / "docs" / "tangent_cg.md"
METHODS = ("tangent-cg", "surface-uzawa")
FRICTION = (0.05, 0.3, 1.0)
TOLERANCES = (1e-4, 1e-8)
SOLVER = "cg+boomeramg"  # the linear solve whose cycles are counted
SMALL = 36  # cells a side, with more surface-uzawa is not measured
COUNTED = 2.0  # [s] steps up to this time are counted; a further one tells what the next would take


class Case(NamedTuple):
    """A ready scene, what is set in it, and the methods that solve it."""

    name: str
    scene: str
    settings: tuple[str, ...] = ()
    methods: tuple[str, ...] = METHODS


OTHERS = (
    Case("cube, order 2", "cube", (*pressed(3, 10, further=True), "geometry.order=2")),
    Case("cube, 16 steps", "cube", ("geometry.mesh_size=0.05", "steps.count=16")),
    Case("half_ball", "half_ball", ("geometry.mesh_size=0.09",)),
    Case("spheres", "spheres"),
)


@dataclass(frozen=True)
class Measured:
    """One run."""

    cycles: int  # of the steps that are counted
    iterations: tuple[int, ...]  # by step
    seconds: float  # CPU [s]
    further: float | None  # CPU [s] of the third step
    error: float  # energy norm, relative
    solve: tuple[int, int, float]  # iterations of the linear solve, of that to the same tolerance, seconds


def measure(simulation: Simulation) -> Measured:
    """Solve all steps, and count those up to `COUNTED`.

    Raises:
        StepError: a step could not be solved.
    """
    prepared, marks, iterations, cycles = simulation.seconds.prepare, [clock.process_time()], list[int](), list[int]()
    for accepted in march(simulation.stepper):
        iterations.append(accepted.iterations)
        cycles.append(simulation.counters.linear_iterations)
        marks.append(clock.process_time())
    state, last = accepted.state, sum(time <= COUNTED for time in simulation.scene.requested_times())
    assert state.correction is not None
    reference = linear_reference(simulation.system)
    own = linear_reference(simulation.system, SOLVER, simulation.scene.solver.tolerance).solvers[SOLVER]
    return Measured(
        cycles=cycles[last - 1],
        iterations=tuple(iterations),
        seconds=prepared + marks[last] - marks[0],
        further=marks[last + 1] - marks[last] if last < len(cycles) else None,
        error=state.correction.size / float(state.peak * 2) ** 0.5,
        solve=(reference.solvers[SOLVER].iterations or 0, own.iterations or 0, reference.seconds),
    )


def run(scene: str, settings: tuple[str, ...], method: str, tolerance: float) -> Measured | str:
    """Prepare and solve a ready scene; the sentence of what went wrong."""
    solver = f'solver={{ method = "{method}", surface = "matrix-free", tolerance = {tolerance!r} }}'
    try:
        return measure(prepare(read(scene, [*settings, solver, "output.error=false"])))
    except StickslipError as error:
        return str(error).split(";")[0]


def line(name: str, found: tuple[Measured | str, ...]) -> str:
    """Return a row of the table: counts, solves and seconds of each method."""
    cells = [name]
    for one in found:
        if isinstance(one, str):
            cells += [one, "", "", ""]
        else:
            count, own, seconds = one.solve
            steps = " + ".join(map(str, one.iterations)) if len(one.iterations) < 4 else str(sum(one.iterations))
            further = "" if one.further is None else f", {one.further / seconds:.2f}"
            cells += [steps, f"{one.cycles / count:.1f}, {one.cycles / own:.1f}"]
            cells += [f"{one.seconds / seconds:.1f}{further}", f"{one.error:.0e}"]
    return "| " + " | ".join(cells) + " |"


def cases(sizes: Sequence[int]) -> Iterator[Case]:
    """Yield cubes with n cells a side."""
    tetrahedra = "geometry.cells=simplex"
    for n in sizes:
        methods, size = METHODS[: 2 if n <= SMALL else 1], tuple(pressed(3, n, further=True))
        for mu in FRICTION:
            yield Case(f"n = {n}, μ = {mu:g}", "cube", (*size, f"contacts.base.friction.mu={mu}"), methods)
        yield Case(f"n = {n}, tetrahedra", "cube", (*size, tetrahedra), methods)
        two = (*size, *cubes(n))
        yield Case(f"n = {n}, two cubes", "two_blocks", (*two, "geometry.cells=tensor"), methods)
        yield Case(f"n = {n}, two cubes, tetrahedra", "two_blocks", (*two, tetrahedra), methods)


def rows(cases: Iterable[Case]) -> Iterator[str]:
    """Measure all cases to each tolerance, and print each row as it is found."""
    for case, tolerance in product(cases, TOLERANCES):
        found = (run(case.scene, case.settings, method, tolerance) for method in case.methods)
        row = line(f"{case.name}, {tolerance:g}", tuple(found))
        print(row, flush=True)
        yield row


def main(
    sizes: Annotated[str, typer.Option(help="cells a side of the cube")] = "24,36,48",
    output: Annotated[Path, typer.Option("-o", "--output", help="where the page goes")] = PAGE,
) -> None:
    """Measure, print each row as it is found, and write the page."""
    first = list(rows(cases([int(size) for size in sizes.split(",")])))
    template = "lab/benchmarks/templates/tangent_cg.md"
    write_aside(output, render(template, methods=METHODS, cubes=first, others=list(rows(OTHERS))).encode())


if __name__ == "__main__":
    typer.run(main)
