"""Scaling measured on few ranks, a model, and what it says of many, as a page.

`python -m stickslip.workflows.lab.benchmarks.scaling` writes docs/scaling.md; ten minutes on two cores. Each run is a
process of its own, and made twice: the smaller seconds count. Existing measurements in the folder are kept.
"""

from __future__ import annotations

import json
import re
import sys
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.formats.templates import render
from stickslip.workflows.lab.benchmarks.own_process import child, kept
from stickslip.workflows.lab.benchmarks.scaling_model import (
    EACH,
    ONCE,
    PHASES,
    THICK,
    Costs,
    Machine,
    Memory,
    Run,
    Size,
    Traffic,
    fit,
    predicted,
    seconds_of,
    size_of,
)
from stickslip.workflows.lab.benchmarks.scaling_run import Case, build

PAGE = Path(__file__).resolve().parents[3] / "docs" / "scaling.md"
REPEATS = 2
LIMIT = 18.0  # of a run [s], a tenth of what ends it
FITTED = (Case(24), Case(32), Case(38), Case(48), Case(48, 8), Case(64, 8), Case(96, 2), Case(128, 2))  # on one rank
CHECKED = {  # ranks: cases
    2: (Case(24), Case(30), Case(32), Case(38), Case(48), Case(48, 8), Case(64, 8), Case(96, 2), Case(128, 2)),
    4: (Case(24), Case(32, 8), Case(128, 2)),  # for their counts and memory alone: more ranks than cores
    8: (Case(24), Case(128, 2)),
}
DRAWN = tuple(Case(n, steps=0) for n in (48, 64, 96, 128))
LARGE = (1e8, 1e6)  # unknowns and contact points
RANKS = (64, 256, 1024, 4096)
LEAST, MOST = 0.5, 1.6  # ratio of an iteration, predicted over measured
STEPS, ITERATIONS = 2, 36  # of a run; measured: 15 to 25 a step
WIDTH = 120  # of a line of the page
PARAGRAPH = re.compile(r"^(\d\. )?(?![|#]).+(?:\n(?!\d\. ).+)*", re.MULTILINE)  # no table or heading
CHECKS = ("iteration", *ONCE, "step")  # held against the measurements on two ranks


def filled(text: str) -> str:
    """Return a page whose paragraphs and items of lists are in lines of its width."""

    def lines(found: re.Match[str]) -> str:
        hang = " " * len(found[1] or "")
        return textwrap.fill(" ".join(found[0].split()), WIDTH, subsequent_indent=hang, break_long_words=False)

    return PARAGRAPH.sub(lines, text)


def page(single: Sequence[Run], several: Sequence[Run], drawn: Sequence[Run]) -> str:
    """Return the page, in Markdown.

    Args:
        single: runs on one rank, to which the model is fitted.
        several: runs on more; those on two are held against the model, those on more are counted alone.
        drawn: meshes that were made by gmsh alone.
    """
    costs, traffic, memory, machine = fit(single), Traffic.of(several), Memory.of(single, several, drawn), Machine()
    two = [run for run in several if run["ranks"] == 2]
    strong = [(one, other) for one in single for other in two if _cells(one) == _cells(other)]
    cubes = [(a, b) for a in single for b in two if not (a["case"]["layers"] or b["case"]["layers"])]
    weak = [(a, b) for a, b in cubes if abs(b["unknowns"] / 2 / a["unknowns"] - 1) < 0.05]
    found = ratios(costs, traffic, two)
    means = {name: float(np.exp(np.mean(np.log(values)))) for name, values in found.items()}
    slow = {name: 1 / min(mean, 1.0) for name, mean in means.items()}
    sizes = [Size(*LARGE, ranks) for ranks in RANKS]
    runs = [predicted(costs, traffic, size, machine) for size in sizes]
    few, many = runs[0], runs[-1]
    each = [sum(run.iteration.values()) for run in runs]
    shares = [memory.of_rank(size) for size in sizes]
    whole = [_but_mesh(share) for share in shares]
    counts = [count for run in two if run["unknowns"] >= THICK * run["points"] for count in run["iterations"]]
    text = render(
        "lab/benchmarks/templates/scaling.md",
        cells=_cells,
        iteration=_iteration,
        seconds_of=seconds_of,
        size_of=size_of,
        spaced=lambda count: f"{count:,}".replace(",", " "),
        power=lambda value: f"10{str(round(np.log10(value))).translate(str.maketrans('0123456789', '⁰¹²³⁴⁵⁶⁷⁸⁹'))}",
        traffic_of=lambda run: Traffic.of([run]),
        once=ONCE,
        each=EACH,
        phases=PHASES,
        compared=CHECKS,
        costs=costs,
        traffic=traffic,
        memory=memory,
        machine=machine,
        several=several,
        drawn=drawn,
        largest=max(run["unknowns"] for run in single),
        largest_drawn=max(run["unknowns"] for run in drawn),
        strong=strong,
        gains=[_iteration(one) / _iteration(other) for one, other in strong],
        weak=weak,
        efficiency=[_iteration(one) / _iteration(other) for one, other in weak],
        peaks=[(run, _but_mesh(memory.of_rank(size_of(run)))) for run in (*single, *two)],
        checked=[(run, predicted(costs, traffic, size_of(run), machine)) for run in two],
        ratios=found,
        means=means,
        least=LEAST,
        most=MOST,
        large=LARGE,
        ranks=RANKS,
        steps=STEPS,
        iterations=ITERATIONS,
        fewest=min(counts),
        longest=max(counts),
        runs=runs,
        many=many,
        each_iteration=each,
        totals=[run.total(STEPS, ITERATIONS) for run in runs],
        slower=[run.total(STEPS, ITERATIONS, slow) for run in runs],
        shares=shares,
        whole=whole,
        sent=[traffic.bytes(size) for size in sizes],
        share=few.once["mesh"] / few.total(STEPS, ITERATIONS),
        gain=each[0] / each[-1],
        fixed=float(costs["contact"][2] + costs["vectors"][2]),
        shared=_at_the_contact(two) / _at_the_contact(single),
        fit_first=int(256e9 // whole[0]),
        fit_last=int(256e9 // whole[-1]),
    )
    return filled(text)


def ratios(costs: Costs, traffic: Traffic, runs: Sequence[Run]) -> dict[str, list[float]]:
    """Return predicted over measured seconds of each run, by phase; `iteration` is that of all its parts."""
    found: dict[str, list[float]] = {}
    for run in runs:
        seconds, foreseen = seconds_of(run), predicted(costs, traffic, size_of(run), Machine())
        for name in ONCE:
            found.setdefault(name, []).append(foreseen.once[name] / seconds[name])
        found.setdefault("iteration", []).append(sum(foreseen.iteration.values()) / _iteration(run))
        found.setdefault("step", []).append(foreseen.step / seconds["step"])
    return found


def _cells(run: Run) -> str:
    """Return the cells of a run, in words."""
    n, layers = run["case"]["n"], run["case"]["layers"] or run["case"]["n"]
    return f"{n} × {n} × {layers}"


def _iteration(run: Run) -> float:
    """Return seconds of an iteration, of all its parts."""
    seconds = seconds_of(run)
    return sum(seconds[name] for name in EACH)


def _but_mesh(share: Mapping[str, float]) -> float:
    """Return bytes of a rank other than 0."""
    return sum(value for name, value in share.items() if name != "mesh")


def _at_the_contact(runs: Sequence[Run]) -> float:
    """Return seconds of preparation at the contact, of the run with most contact points."""
    seconds = seconds_of(max(runs, key=lambda run: float(run["points"])))
    return seconds["surface"] + seconds["coordinates"]


def run(case: Case, ranks: int, counter: Path | None) -> Run:
    """Measure a case on so many ranks in processes of its own.

    Raises:
        RuntimeError: it failed, or took too long.
    """
    module = "stickslip.workflows.lab.benchmarks.scaling_run"
    preloaded = ["-x", f"LD_PRELOAD={counter}"] if counter else []
    words = ["mpirun", "-n", str(ranks), "--oversubscribe", *preloaded, sys.executable, "-m", module]
    found = child([*words, json.dumps(asdict(case))], LIMIT)
    if found["status"] != "converged":
        raise RuntimeError(f"{case} on {ranks} ranks: {found['status']}")
    return found


def least(runs: list[Run]) -> Run:
    """Return the least seconds of each phase of a run that is made several times, all else from the first."""
    first, *_ = runs
    found = dict(first)
    for key in ("seconds", "parts"):
        if key in first:
            found[key] = {name: min(one[key][name] for one in runs) for name in first[key]}
    return found


def measured(case: Case, ranks: int, folder: Path, counter: Path | None) -> Run:
    """Return a case on so many ranks, from the folder if it is there."""
    n, _, layers = case.shape

    def measure() -> Run:
        print(f"{case} on {ranks} ranks", flush=True)
        return least([run(case, ranks, counter) for _ in range(REPEATS)])

    return kept(folder / f"{ranks}_{n}_{layers}_{case.steps}.json", measure)


def main(
    folder: Annotated[Path, typer.Option(help="where measurements are kept")] = Path("results/scaling"),
    output: Annotated[Path, typer.Option("-o", "--output", help="where the page goes")] = PAGE,
) -> None:
    """Measure what is missing, and write the page."""
    folder.mkdir(parents=True, exist_ok=True)
    counter = build(folder.resolve())
    if counter is None:
        raise SystemExit("mpicc is missing, by which messages are counted")
    single = [measured(case, 1, folder, counter) for case in FITTED]
    several = chain.from_iterable(((ranks, case) for case in cases) for ranks, cases in CHECKED.items())
    checked = [measured(case, ranks, folder, counter) for ranks, case in several]
    drawn = [measured(case, 1, folder, counter) for case in DRAWN]
    write_aside(output, page(single, checked, drawn).encode())


if __name__ == "__main__":
    typer.run(main)
