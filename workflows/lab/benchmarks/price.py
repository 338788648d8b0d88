"""Cost of friction in linear solves: `python -m stickslip.workflows.lab.benchmarks.price` writes price.html.

One core, threads fixed, CPU seconds. Every measurement is a process of its own, which also measures the linear
reference: prices are ratios within one process. A measurement that exists is not repeated; remove DIR to begin anew.
Other programs on the same meshes (`peers/`) stand beside our default, and are named if they are not installed;
`--methods peers` measures them alone.
"""

from __future__ import annotations

import base64
import io
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import matplotlib
import numpy as np
import typer
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from rich.progress import Progress

from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.formats.templates import render
from stickslip.workflows.lab.benchmarks.own_process import Run, child, kept
from stickslip.workflows.lab.benchmarks.peers.programs import PROGRAMS, measured
from stickslip.workflows.lab.benchmarks.price_run import COUNTED, OURS, PEERS, REFERENCE, Case

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


def expected(case: Case, known: list[Run]) -> float:
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


def run(case: Case, limit: float) -> Run:
    """Measure in a child process; the result of a run that fails or takes ten times the limit says why.

    The memory of the linear reference is that of another child, which knows the fastest solver and tries no other.
    """
    found = _child(case, limit)
    if case.method == REFERENCE and found["status"] == "converged":
        alone = _child(case, limit, found["reference"]["fastest"])
        found["memory"] = alone.get("memory", found["memory"])
    return found


def _child(case: Case, limit: float, *solver: str) -> Run:
    polls = {"OMPI_MCA_mpi_yield_when_idle": "0"}  # to yield at each of MUMPS' polls costs a fifth of a step in 2D
    command = [sys.executable, "-m", "stickslip.workflows.lab.benchmarks.price_run", json.dumps(asdict(case)), *solver]
    return {"case": asdict(case)} | child(command, limit, **polls)


def main(
    output: Annotated[Path, typer.Option("-o", "--output", help="where the page goes")] = Path("results/price"),
    limit: Annotated[float, typer.Option(help="seconds that a single run may be expected to take")] = 300.0,
    plane: Annotated[str, typer.Option(help="cells over the height of the block")] = ",".join(map(str, PLANE)),
    space: Annotated[str, typer.Option(help="cells over the height of the cube")] = ",".join(map(str, SPACE)),
    methods: Annotated[str, typer.Option(help=f"of {ALL}; {PEERS}: other programs")] = ALL,
) -> None:
    """Measure what is missing, then write the page."""
    folder, known = output / "runs", list[Run]()
    folder.mkdir(parents=True, exist_ok=True)
    sizes = [tuple(int(n) for n in text.split(",") if n) for text in (plane, space)]
    chosen = tuple(methods.split(","))
    todo = list(cases(sizes[0], sizes[1], chosen))
    with Progress() as progress:
        task = progress.add_task("measuring", total=len(todo))
        for case in todo:
            progress.update(task, description=case.name)
            path = folder / f"{case.name}.json"
            if not path.exists() and (seconds := expected(case, known)) > limit:
                known.append({"case": asdict(case), "status": f"not run: {seconds:.0f} s expected"})
            else:
                known.append(kept(path, partial(run, case, limit)))
            progress.advance(task)
    asked = zip((2, 3), sizes, strict=True) if PEERS in chosen else ()
    peers = [run for dim, ns in asked for run in measured(output, dim, ns, limit)]
    print(write_page(output, known, peers))


matplotlib.use("Agg")

COLOURS = {
    "auto": "black", "condensed-newton": "tab:blue", "surface-uzawa": "tab:red", "uzawa": "tab:orange",
    "regularised": "tab:green",
}  # fmt: skip
LINES = {1e-4: "--", 1e-8: "-"}
BARS = {(2, 1e-8): ((64, 512), 1.5), (3, 1e-4): ((24, 64), 2.0), (3, 1e-8): ((24, 64), 2.5)}  # targets
LIKE = ("dim", "n", "cells", "bodies")  # what a case must have in common with its linear reference


def write_page(folder: Path, runs: list[Run], peers: Sequence[Run] = ()) -> Path:
    """Write DIR/price.html and DIR/price.png, with the rows of other programs; the path of the page."""
    rows = [_row(run, runs) for run in runs if run["case"]["method"] != REFERENCE]
    png = io.BytesIO()
    picture(rows).savefig(png, dpi=110)
    write_aside(folder / "price.png", png.getvalue())
    sections = [_section(dim, rows, peers) for dim in (2, 3)]
    shown = base64.b64encode(png.getvalue()).decode()
    page = render("lab/benchmarks/templates/price.html", picture=shown, sections=sections, programs=PROGRAMS)
    write_aside(folder / "price.html", page.encode())
    return folder / "price.html"


def _section(dim: int, rows: list[Run], peers: Sequence[Run]) -> Run:
    """What is known of one dimension: growth of the counts, every run, and the other programs."""
    own, others = ([row for row in found if row["dim"] == dim] for found in (rows, peers))
    grown = growth([row for row in own if _plain(row)])
    return {"dim": dim, "growth": grown, "rows": own, "peers": [row(run, others) for run in others]}


def growth(rows: list[Run]) -> dict[tuple[str, str, float], float]:
    """Slope of log(solves) against log(n), by method, form of the bodies and tolerance; of one dimension.

    Volume solves stand for them where no iterations are counted.
    """
    counts: dict[tuple[str, str, float], dict[int, float]] = {}
    for row in rows:
        count = row["price"] and (row.get("solves") or row["volume_solves"])
        if count:
            counts.setdefault((row["method"], row["surface"], row["tolerance"]), {})[row["n"]] = count
    return {
        kind: float(np.polyfit(np.log(list(known)), np.log(list(known.values())), 1)[0])
        for kind, known in counts.items()
        if len(known) > 1
    }


def _plain(row: Run) -> bool:
    """Whether it is of one body of quadrilaterals or hexahedra: what curves and growth are made of."""
    return bool(row["cells"] == "tensor" and row["bodies"] == 1)


def _row(run: Run, runs: list[Run]) -> Run:
    """One row of the table."""
    case = run["case"]
    row = dict(case) | {"status": run["status"], "dofs": run.get("dofs", ""), "price": None}
    if run.get("price") is None:
        return row
    steps = run["steps"][:2]
    alone = [
        r["memory"]
        for r in runs
        if r["case"]["method"] == REFERENCE and "memory" in r and all(r["case"][k] == case[k] for k in LIKE)
    ]
    cycles = sum(step["linear_iterations"] for step in steps)

    def solves(reference: Run | None) -> float | None:
        count = reference and (reference.get("solvers", {}).get(COUNTED) or {}).get("iterations")
        return cycles / count if cycles and count else None

    return row | {
        "solves": solves(run["reference"]),
        "own_solves": solves(run.get("own")),
        "price": run["price"],
        "further": run["further_price"],
        "seconds": run["two_steps"],
        "reference": run["reference_seconds"],
        "memory": run["memory"] / alone[0] if alone else None,
        "residual": max(step["residual"] for step in steps),
        **{key: sum(step[key] for step in steps) for key in ("iterations", "volume_solves", "linear_iterations")},
    }


def picture(rows: list[Run]) -> Figure:
    """Price, further step, volume solves, linear iterations and memory against n, log-log; 2D above, 3D below."""
    figure = Figure(figsize=(17, 8), layout="constrained")
    kinds: tuple[tuple[str, Callable[[Run], Any]], ...] = (
        ("price of two steps", lambda r: r["price"]),
        ("price of a further step", lambda r: r["further"]),
        ("volume solves", lambda r: r["volume_solves"]),
        ("linear iterations", lambda r: r["linear_iterations"] or None),
        ("memory", lambda r: r["memory"]),
    )
    axes = figure.subplots(2, len(kinds))
    for line, dim in zip(axes, (2, 3), strict=True):
        for axis, (title, value) in zip(line, kinds, strict=True):
            for method, colour in COLOURS.items():
                for tolerance, style in LINES.items():
                    chosen = [
                        (r["n"], value(r))
                        for r in filter(_plain, rows)
                        if (r["dim"], r["method"], r["tolerance"]) == (dim, method, tolerance) and r["price"]
                    ]
                    chosen = [(n, v) for n, v in chosen if v]
                    if chosen:
                        wide = 2.5 if method == "auto" else 1.5
                        axis.loglog(
                            *zip(*chosen, strict=True), style, marker="o", ms=4, lw=wide, color=colour,
                            label=f"{method}, {tolerance:g}",
                        )  # fmt: skip
            for (of, tolerance), (reach, bar) in BARS.items():
                if of == dim and title == "price of two steps":
                    axis.plot(reach, [bar, bar], LINES[tolerance], color="grey", lw=6, alpha=0.4)
            sizes = sorted({r["n"] for r in rows if r["dim"] == dim})
            axis.set(title=f"{dim}D: {title}", xlabel="n, cells over the height")
            axis.set_xticks(sizes, [str(n) for n in sizes])
            if axis.has_data():
                axis.set_yscale("log")
                axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
                axis.yaxis.set_major_formatter("{x:g}")
            axis.minorticks_off()
            axis.grid(alpha=0.3)
    known = {label: line for axis in axes[:, 0] for line, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    if known:
        figure.legend(known.values(), known.keys(), loc="outside lower center", ncols=5)
    return figure


def row(run: Run, runs: Sequence[Run]) -> Run:
    """One row: price and errors relative to our run on the same mesh, None without one."""
    found = {"n": run["n"], "name": run["name"], "status": run["status"]}
    if "steps" not in run:
        return found
    last = run["steps"][-1]
    found |= {
        "version": run["version"],
        "dofs": run["dofs"],
        "seconds": run["seconds"],
        "iterations": sum(step["iterations"] for step in run["steps"]),
        "memory [GB]": run["memory"],
        "penetration [m]": last["penetration"],
    }
    exact = next((r for r in runs if r["name"] == OURS and r["n"] == run["n"] and "steps" in r), None)
    if exact is None:
        return found
    found["price"] = run["seconds"] / exact["unit"]
    if run["name"] != OURS:
        for column, key in (("error of N", "normal_force"), ("error of T", "tangential_force")):
            found[column] = last[key] / exact["steps"][-1][key] - 1
    return found


if __name__ == "__main__":
    typer.run(main)
