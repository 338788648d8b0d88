"""Cost of friction in linear solves: `python -m stickslip.workflows.lab.benchmarks.price` writes price.html.

One core, threads fixed, CPU seconds. Every measurement is a process of its own, which also measures the linear
reference: prices are ratios within one process. A measurement that exists is not repeated; remove DIR to begin anew.
Other programs on the same meshes (`peers/`) stand beside our default, and are named if they are not installed;
`--methods peers` measures them alone.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import Progress

from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.lab.benchmarks.peers.programs import measured
from stickslip.workflows.lab.benchmarks.price_page import write_page
from stickslip.workflows.lab.benchmarks.price_run import REFERENCE, Case

PLANE = (16, 32, 64, 128, 256, 512)
SPACE = (8, 12, 16, 24, 32, 48, 64)
TOLERANCES = (1e-4, 1e-8)
KINDS = (("tensor", 1), ("simplex", 1), ("tensor", 2), ("simplex", 2))  # cells, and number of bodies
METHODS = (  # last column: growth of the time with n in 2D and 3D, to predict what does not fit
    ("auto", "auto", 2.5, 4.0),
    ("condensed-newton", "condensed", 2.5, 6.0),
    ("surface-uzawa", "matrix-free", 2.2, 3.3),
    ("uzawa", "auto", 3.0, 4.5),
    ("regularised", "auto", 3.0, 6.0),
)
PEERS = "peers"
ALL = ",".join([name for name, *_ in METHODS] + [PEERS])


def cases(plane: tuple[int, ...], space: tuple[int, ...], methods: tuple[str, ...]) -> Iterator[Case]:
    """Cheapest first; `auto` in 3D on tetrahedra, and on two bodies whose meshes do not match, too."""
    for dim, sizes in ((2, plane), (3, space)):
        for n in sizes:
            yield Case(dim, n, REFERENCE)
            for method, surface, *_ in METHODS:
                for tolerance in TOLERANCES if method != "regularised" else TOLERANCES[1:]:
                    for kind in KINDS if (dim, method) == (3, "auto") else KINDS[:1]:
                        if method in methods:
                            yield Case(dim, n, method, surface, tolerance, *kind)


def expected(case: Case, known: list[dict[str, Any]]) -> float:
    """Expected time of a case [s], from the largest measured one of its kind; 0 if there is none.

    >>> done = {"case": asdict(Case(2, 16)), "status": "converged", "two_steps": 1.0, "further": 0.5}
    >>> expected(Case(2, 32), [done]) == 1.5 * 2**2.5
    True
    """
    if case.method == REFERENCE:  # one linear solve is the least of all
        return 0.0
    kind = (case.dim, case.method, case.surface, case.tolerance, case.cells, case.bodies)
    growth = {method: (plane, space) for method, _, plane, space in METHODS}.get(case.method, (0.0, 0.0))
    for run in reversed(known):
        other = Case(**run["case"])
        if (other.dim, other.method, other.surface, other.tolerance, other.cells, other.bodies) == kind:
            if run["status"] != "converged" or run["two_steps"] is None:
                return float("inf")
            return float(run["two_steps"] + run["further"]) * float((case.n / other.n) ** growth[case.dim - 2])
    return 0.0


def run(case: Case, limit: float) -> dict[str, Any]:
    """Measure in a child process; the result of a run that fails or takes ten times the limit says why.

    The memory of the linear reference is that of another child, which knows the fastest solver and tries no other.
    """
    found = _child(case, limit)
    if case.method == REFERENCE and found["status"] == "converged":
        alone = _child(case, limit, found["reference"]["fastest"])
        found["memory"] = alone.get("memory", found["memory"])
    return found


def _child(case: Case, limit: float, *solver: str) -> dict[str, Any]:
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    polls = {"OMPI_MCA_mpi_yield_when_idle": "0"}  # to yield at each of MUMPS' polls costs a fifth of a step in 2D
    environment = os.environ | threads | polls
    command = [sys.executable, "-m", "stickslip.workflows.lab.benchmarks.price_run", json.dumps(asdict(case)), *solver]
    try:
        done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=10 * limit, check=False)
    except subprocess.TimeoutExpired:
        return {"case": asdict(case), "status": f"took more than {10 * limit:g} s"}
    if done.returncode:
        return {"case": asdict(case), "status": (done.stderr.strip().splitlines() or ["no message"])[-1]}
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def main(
    output: Annotated[Path, typer.Option("-o", "--output", help="where the page goes")] = Path("results/price"),
    limit: Annotated[float, typer.Option(help="seconds that a single run may be expected to take")] = 300.0,
    plane: Annotated[str, typer.Option(help="cells over the height of the block")] = ",".join(map(str, PLANE)),
    space: Annotated[str, typer.Option(help="cells over the height of the cube")] = ",".join(map(str, SPACE)),
    methods: Annotated[str, typer.Option(help=f"of {ALL}; {PEERS}: other programs")] = ALL,
) -> None:
    """Measure what is missing, then write the page."""
    folder, known = output / "runs", list[dict[str, Any]]()
    folder.mkdir(parents=True, exist_ok=True)
    sizes = [tuple(int(n) for n in text.split(",") if n) for text in (plane, space)]
    chosen = tuple(methods.split(","))
    todo = list(cases(sizes[0], sizes[1], chosen))
    with Progress() as progress:
        task = progress.add_task("measuring", total=len(todo))
        for case in todo:
            progress.update(task, description=case.name)
            path = folder / f"{case.name}.json"
            if path.exists():
                found = json.loads(path.read_text())
            elif (seconds := expected(case, known)) > limit:
                found = {"case": asdict(case), "status": f"not run: {seconds:.0f} s expected"}
            else:
                found = run(case, limit)
                write_aside(path, json.dumps(found, indent=1).encode())
            known.append(found)
            progress.advance(task)
    asked = zip((2, 3), sizes, strict=True) if PEERS in chosen else ()
    peers = [run for dim, ns in asked for run in measured(output, dim, ns, limit)]
    print(write_page(output, known, peers))


if __name__ == "__main__":
    typer.run(main)
