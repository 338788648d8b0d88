"""Scaling measured on few ranks, a model, and what it says of many, as a page.

`python -m stickslip.workflows.lab.benchmarks.scaling` writes docs/scaling.md; ten minutes on two cores. Each run is a
process of its own, and made twice: the smaller seconds count. Existing measurements in the folder are kept.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from stickslip.workflows.formats.files import write_aside
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

LARGE = (1e8, 1e6)  # unknowns and contact points
RANKS = (64, 256, 1024, 4096)
LEAST, MOST = 0.5, 1.6  # ratio of an iteration, predicted over measured
STEPS, ITERATIONS = 2, 36  # of a run; measured: 15 to 25 a step
WIDTH = 120  # of a line of the page
INTRODUCTION = """# Scaling: one, two and four thousand ranks

`python -m stickslip.workflows.lab.benchmarks.scaling` measures `tangent-cg` on the ready scene `cube`, or on a slab
of it, to 1e-8, on one and two ranks, fits a model to one rank, holds it against two, and asks it for 10⁸ unknowns
with 10⁶ contact points. PETSc under MPI is the engine; how to run on a cluster is in [clusters](howto/clusters.md).

**Firm** are counts: iterations, messages, their bytes, calls, bytes of objects. **Not firm** are seconds: CPU
seconds, the least of two runs, on two cores that others used too. On two ranks they include waiting,
which keeps a core busy. Nothing here was measured on more than two cores, nor beyond {largest} unknowns: what is
said of 64 ranks and more is the model's. Errors of the mesh, results and files are not in it. Unknowns include the
prescribed ones.
"""
STRONG = """
The same problem on one and on two ranks. `surface` and `coordinates` are rows of contacts and supports, and the
basis in which contact is decided; a part of both is the same work on every rank. An iteration: product with the
stiffness, multigrid cycle, products with the columns of slave nodes, contact points, and the rest (vectors).
"""
COUNTS = """
In one iteration, of the rank that sends most; firm. Those of hypre are counted by a library that is loaded before
MPI (LD_PRELOAD), those of PETSc stand in its log (VecScatterBegin). *Gathered* is what each rank receives by
collectives in a step, by contact point. *Neighbours* are the model's, summed over the levels of multigrid. On 4 and 8
ranks, more than there are cores, only counts are of use.
"""
GATHERED = """
{gathered:.0f} bytes a contact point reach every rank in a step: the tractions and relative displacements of its end,
and of each time that the natural residual is looked at. Other iterations gather numbers alone.
"""
MEMORY = """
The model, fitted to peaks on one rank and on several: {base:.0f} MB of program, {unknown:.0f} bytes an unknown of the
rank's share, {own:.0f} bytes a contact point of its share, and {point:.0f} bytes a contact point, of all, on **every**
rank. Python holds {objects:.0f} of the last when the steps are solved; the rest is needed on the way there.
Replicated at the contact are: the sides (`gather_surface`: nodes, coordinates, facets), rows N and weights, gaps,
tractions, and the state of the step. Divided are: what supports prescribe and springs resist, the coordinates T and
their inverse, the points' laws, and everything of an iteration.

gmsh and the search for parts, on rank 0 alone, by unknowns of the mesh: {drawn}: {meshed:.0f} bytes an unknown.
"""
MODEL = """
Costs, fitted to the runs on one rank by least relative errors, none negative; those of bodies alone to bodies at
least eight cells high. *By unknown* is divided by the ranks, but not on the mesh, which rank 0 makes. *By point*
is divided among the ranks that touch the surface, or is *replicated*: every rank does it for all points.
"""
ASSUMED = """
Assumed of a cluster: {latency:.1f} µs a message, {node:.0f} GB/s a node of {ranks} ranks ({rank:.0f} MB/s each),
{stage:.0f} µs for each of the log₂(ranks) stages of a collective of Python objects, and cores that are as fast as
ours with all of a node at work. Counted, from the table above: {messages:.0f} messages a neighbour and level,
{halo:.0f} bytes times (unknowns of a rank)^(2/3) and face, {collectives:.0f} collectives of libraries and
{objects:.1f} of Python objects, an iteration. Neighbours on a coarse level follow from the entries of its rows, which
BoomerAMG prints (up to 700 where 1900 rows are left): a row there reaches over hundreds of ranks.
"""
CHECK = """
The model shares work out evenly and lets no rank wait. `prepare` is mostly hypre's set-up, which gains little from a
second rank: the products that make coarse matrices take as long on each of two ranks as on one (352 947 unknowns,
hypre 2.26: .36 and .33 s of .71 and .72). A fifth of that is the search for each coarse point in the list of those
that a rank sends, which grows with the product of the two. In `mesh` rank 0 also finds a rank for each cell. Tests
hold the ratio of an iteration between {least} and {most}.
"""
ASKED = """
A slab of 1000 × 1000 × 32 cells, {steps} steps, {iterations} iterations in all (measured: {fewest} to {most} a step,
whatever the ranks). The last line divides each phase by its mean ratio on two ranks.
"""
BREAKS = """## What breaks first

1. **The mesh.** Rank 0 alone makes it: {mesh:.0f} s whatever the ranks, {share:.0f} % of the run on 64, and
{gmsh:.0f} GB in one process, where the program's own price for that many cells is 50 GB. Linear growth is assumed; it
was drawn up to {drawn:.1f} million unknowns. 32-bit numbers do not overflow yet, as far as was read, not run: 10⁸
unknowns and 2.7·10⁸ corners of cells are below 2³¹, the limit of PETSc's indices as Debian builds it and of the counts
of MPI, which 8 times as many cells pass.
2. **Memory at the contact.** Every rank needs {contact:.1f} GB for all contact points: {contact_node:.0f} GB on a node
of 32 ranks, however many nodes there are, beside {bodies_node:.0f} GB of the bodies on 2 nodes or {bodies_last:.0f} on
128. A node of 256 GB holds {fit_first} ranks of 64 and {fit_last} of 4096, fewer where rank 0 is.
3. **Preparation at the contact.** {surface:.0f} s, if every rank does all of it: `gather_surface` and the rows of the
contact. With most contact points, two ranks take {shared:.2f} of the time of one: a part is shared, of which the model
knows nothing.
4. **Collectives and messages, from 1024 ranks on.** {waits:.0f} ms of an iteration on 4096 ranks, {fixed:.0f} ms what
numpy's calls cost without any points, product and cycle {bodies:.0f} ms. From 64 ranks to 4096 an iteration gets
{gain:.0f} times as fast.

So 256 to 1024 ranks are worth asking for where many steps are solved on one mesh. In the order of what is gained for
the work: a mesh that is read in parallel, sides and rows on the ranks that own them, one collective in place of
several. Cells go to ranks by bisection of their coordinates, on rank 0: that of 328 509 cells
takes 0.2 s, where SCOTCH, which needs the graph of all cells first, takes 2 s.
"""


def words(text: str, **numbers: object) -> str:
    """Paragraphs and items of lists, each in lines of the page's width."""
    found = []
    for block in text.format(**numbers).split("\n\n"):
        for item in re.split(r"\n(?=\d\. )", block.strip("\n")):
            hang = "   " if item[:1].isdigit() and item[1:3] == ". " else ""
            found.append(textwrap.fill(" ".join(item.split()), WIDTH, subsequent_indent=hang, break_long_words=False))
        found.append("")
    return "\n".join(found)


def page(single: Sequence[Run], several: Sequence[Run], drawn: Sequence[Run]) -> str:
    """The page, in Markdown.

    Args:
        single: runs on one rank, to which the model is fitted.
        several: runs on more; those on two are held against the model, those on more are counted alone.
        drawn: meshes that were made by gmsh alone.
    """
    costs, traffic, memory = fit(single), Traffic.of(several), Memory.of(single, several, drawn)
    two = [run for run in several if run["ranks"] == 2]
    largest = max(run["unknowns"] for run in single)
    sections = (
        [words(INTRODUCTION, largest=f"{largest:,}".replace(",", " "))],
        _strong(single, two),
        _weak(single, two),
        _counts(several, traffic),
        _memory(single, two, drawn, memory),
        _model(costs, traffic),
        _check(costs, traffic, two),
        _large(costs, traffic, memory, single, two, max(run["unknowns"] for run in drawn)),
    )
    return "\n".join(line for section in sections for line in section) + "\n"


def ratios(costs: Costs, traffic: Traffic, runs: Sequence[Run]) -> dict[str, list[float]]:
    """Predicted over measured seconds of each run, by phase; `iteration` is that of all its parts."""
    found: dict[str, list[float]] = {}
    for run in runs:
        seconds, foreseen = seconds_of(run), predicted(costs, traffic, size_of(run), Machine())
        for name in ONCE:
            found.setdefault(name, []).append(foreseen.once[name] / seconds[name])
        each = sum(seconds[name] for name in EACH)
        found.setdefault("iteration", []).append(sum(foreseen.iteration.values()) / each)
        found.setdefault("step", []).append(foreseen.step / seconds["step"])
    return found


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]


def _name(run: Run) -> str:
    """The cells of a run, in words."""
    n, layers = run["case"]["n"], run["case"]["layers"] or run["case"]["n"]
    return f"{n} × {n} × {layers}"


def _row(run: Run) -> list[str]:
    seconds = seconds_of(run)
    each = sum(seconds[name] for name in EACH)
    parts = [f"{1e3 * seconds[name]:.1f}" for name in EACH]
    return [
        _name(run),
        str(run["ranks"]),
        f"{run['unknowns']:,}".replace(",", " "),
        *(f"{seconds[name]:.2f}" for name in ONCE),
        " + ".join(map(str, run["iterations"])),
        f"{1e3 * each:.1f}",
        *parts,
    ]


HEAD = ("cells", "ranks", "unknowns", *(f"{name} [s]" for name in ONCE), "iterations", "one [ms]", *EACH)


def _strong(single: Sequence[Run], two: Sequence[Run]) -> Iterator[str]:
    yield "## Strong scaling\n"
    yield words(STRONG)
    pairs = [(one, other) for one in single for other in two if _name(one) == _name(other)]
    yield from _table(HEAD, [_row(run) for pair in pairs for run in pair])
    gains = [_iteration(one) / _iteration(other) for one, other in pairs]
    yield f"\nTwo ranks make an iteration {min(gains):.2f} to {max(gains):.2f} times as fast as one.\n"


def _iteration(run: Run) -> float:
    seconds = seconds_of(run)
    return sum(seconds[name] for name in EACH)


def _weak(single: Sequence[Run], two: Sequence[Run]) -> Iterator[str]:
    yield "## Weak scaling\n"
    yield "Nearly the same number of unknowns for each rank, within 5 %.\n"
    pairs = [(a, b) for a in single for b in two if abs(b["unknowns"] / 2 / a["unknowns"] - 1) < 0.05 and _cube(a, b)]
    yield from _table(HEAD, [_row(run) for pair in pairs for run in pair])
    done = [_iteration(a) / _iteration(b) for a, b in pairs]
    yield f"\nEfficiency of an iteration: {', '.join(f'{value:.2f}' for value in done)}.\n"


def _cube(*runs: Run) -> bool:
    return all(not run["case"]["layers"] for run in runs)


def _counts(several: Sequence[Run], traffic: Traffic) -> Iterator[str]:
    yield "## Messages\n"
    yield words(COUNTS)
    rows = []
    for run in several:
        count, sent, log, size = sum(run["iterations"]), run["sent"], run["events"]["VecScatterBegin"], size_of(run)
        messages = (sent["messages"][1] + log["messages"][1]) / count
        rows.append(
            [
                _name(run),
                str(run["ranks"]),
                f"{sent['messages'][1] / count:.0f}",
                f"{sent['bytes'][1] / count / 1e3:.0f}",
                f"{log['messages'][1] / count:.0f}",
                f"{log['bytes'][1] / count / 1e3:.0f}",
                f"{sent['collectives'][1] / count:.0f}",
                f"{sum(run['calls'].values()) / count:.1f}",
                f"{sent['collective_bytes'][0] / len(run['iterations']) / size.points:.0f}",
                f"{size.neighbours:.0f}",
                f"{messages / size.neighbours:.1f}",
            ]
        )
    yield from _table(
        (
            "cells",
            "ranks",
            "hypre: messages",
            "kB",
            "PETSc: messages",
            "kB",
            "collectives",
            "of Python objects",
            "gathered in a step [bytes/point]",
            "neighbours",
            "messages each",
        ),
        rows,
    )
    yield "\n" + words(GATHERED, gathered=traffic.gathered)


def _memory(single: Sequence[Run], two: Sequence[Run], drawn: Sequence[Run], memory: Memory) -> Iterator[str]:
    yield "## Memory\n"
    rows = []
    for run in (*single, *two):
        peaks = [f"{rank['iterate'] / 1e6:.0f}" for rank in run["memory"]]
        expected = predicted_peak(memory, size_of(run)) / 1e6
        ratio = expected / (run["memory"][-1]["iterate"] / 1e6)
        objects = f"{max(run['objects']) / 1e6:.0f}"
        rows.append([_name(run), str(run["ranks"]), " + ".join(peaks), objects, f"{expected:.0f}", f"{ratio:.2f}"])
    yield from _table(
        ("cells", "ranks", "peak of each [MB]", "Python's objects", "model of the last", "over measured"), rows
    )
    made = []
    for run in drawn:
        size, seconds = run["memory"][0]["gmsh"] / 1e9, run["seconds"]["gmsh"]
        made.append(f"{run['unknowns'] / 1e6:.2g} million {size:.2f} GB and {seconds:.1f} s")
    yield "\n" + words(
        MEMORY,
        base=memory.base / 1e6,
        unknown=memory.unknown,
        point=memory.point,
        own=memory.own,
        objects=memory.objects,
        drawn=", ".join(made),
        meshed=memory.meshed,
    )


def predicted_peak(memory: Memory, size: Size) -> float:
    """Bytes of a rank other than 0."""
    found = memory.of_rank(size)
    return sum(value for name, value in found.items() if name != "mesh")


def _model(costs: Costs, traffic: Traffic) -> Iterator[str]:
    machine = Machine()
    yield "## Model\n"
    yield words(MODEL)
    rows = []
    for name, phase in PHASES.items():
        unknown, point, fixed = (1e6 * value for value in costs[name])
        how = {"rank 0": "rank 0"}.get(phase.unknowns, phase.points or "shared")
        rows.append([name, f"{unknown:.3g}", f"{point:.3g}", f"{fixed:.3g}", how])
    yield from _table(("phase", "by unknown [µs]", "by point [µs]", "fixed [µs]", "contact points are"), rows)
    yield "\n" + words(
        ASSUMED,
        latency=1e6 * machine.latency,
        node=machine.node_bandwidth / 1e9,
        ranks=machine.ranks_per_node,
        rank=machine.bandwidth / 1e6,
        stage=1e6 * machine.object_latency,
        messages=traffic.messages,
        halo=traffic.halo,
        collectives=traffic.collectives,
        objects=traffic.objects,
    )


def _check(costs: Costs, traffic: Traffic, two: Sequence[Run]) -> Iterator[str]:
    yield "## Check on two ranks\n"
    yield "Seconds of no run below were used in the fit. Predicted over measured; below 1: the model is too fast.\n"
    found = ratios(costs, traffic, two)
    rows = []
    for k, run in enumerate(two):
        foreseen = predicted(costs, traffic, size_of(run), Machine())
        measured = 1e3 * _iteration(run)
        numbers = [f"{measured:.1f}", f"{1e3 * sum(foreseen.iteration.values()):.1f}"]
        rows.append([_name(run), *numbers, *(f"{found[name][k]:.2f}" for name in ("iteration", *ONCE, "step"))])
    means = [f"{_mean(found[name]):.2f}" for name in ("iteration", *ONCE, "step")]
    yield from _table(
        ("cells", "iteration [ms]", "predicted", "ratio", *ONCE, "step"), [*rows, ["mean", "", "", *means]]
    )
    yield "\n" + words(CHECK, least=LEAST, most=MOST)


def _mean(values: Sequence[float]) -> float:
    return float(np.exp(np.mean(np.log(values))))


def _large(
    costs: Costs, traffic: Traffic, memory: Memory, single: Sequence[Run], two: Sequence[Run], drawn: int
) -> Iterator[str]:
    machine, found = Machine(), ratios(costs, traffic, two)
    yield f"## {_power(LARGE[0])} unknowns, {_power(LARGE[1])} contact points\n"
    counts = [count for run in two if run["unknowns"] >= THICK * run["points"] for count in run["iterations"]]
    yield words(ASKED, steps=STEPS, iterations=ITERATIONS, fewest=min(counts), most=max(counts))
    runs = [predicted(costs, traffic, Size(*LARGE, ranks), machine) for ranks in RANKS]
    rows = [[f"{name} [s]", *(f"{run.once[name]:.3g}" for run in runs)] for name in ONCE]
    rows += [[f"{STEPS} steps, beside iterations [s]", *(f"{STEPS * run.step:.3g}" for run in runs)]]
    rows += [
        [f"iteration: {name} [ms]", *(f"{1e3 * run.iteration[name]:.3g}" for run in runs)] for name in runs[0].iteration
    ]
    rows += [["iteration [ms]", *(f"{1e3 * sum(run.iteration.values()):.3g}" for run in runs)]]
    rows += [[f"{ITERATIONS} iterations [s]", *(f"{ITERATIONS * sum(run.iteration.values()):.3g}" for run in runs)]]
    rows += [["**all [s]**", *(f"**{run.total(STEPS, ITERATIONS):.3g}**" for run in runs)]]
    slow = {name: 1 / min(_mean(found[name]), 1.0) for name in found}
    worse = [
        sum(slow[name] * run.once[name] for name in ONCE)
        + STEPS * slow["step"] * run.step
        + ITERATIONS * slow["iteration"] * sum(run.iteration.values())
        for run in runs
    ]
    rows += [["all, as slow beside the model as two ranks [s]", *(f"{value:.3g}" for value in worse)]]
    head = ("seconds", *(f"{ranks} ranks" for ranks in RANKS))
    yield from _table(head, rows)
    yield ""
    bytes_ = [memory.of_rank(Size(*LARGE, ranks)) for ranks in RANKS]
    names = {
        "programs": "program",
        "bodies": "bodies, its share",
        "contact": "contact, all points",
        "own": "contact, its share",
    }
    rows = [[f"{words} [GB]", *(f"{one[name] / 1e9:.2f}" for one in bytes_)] for name, words in names.items()]
    each = [sum(one[name] for name in names) for one in bytes_]
    rows += [["**a rank [GB]**", *(f"**{value / 1e9:.2f}**" for value in each)]]
    rows += [
        [
            f"a node of {machine.ranks_per_node} ranks [GB]",
            *(f"{machine.ranks_per_node * value / 1e9:.0f}" for value in each),
        ]
    ]
    rows += [["rank 0 while it meshes [GB]", *(f"{one['mesh'] / 1e9:.0f}" for one in bytes_)]]
    rows += [["sent by a rank, an iteration [MB]", *(f"{traffic.bytes(Size(*LARGE, r)) / 1e6:.2f}" for r in RANKS)]]
    rows += [["gathered on a rank, a step [MB]", *(f"{traffic.gathered * LARGE[1] / 1e6:.0f}" for _ in RANKS)]]
    yield from _table(("bytes", *(f"{ranks} ranks" for ranks in RANKS)), rows)
    yield ""
    few, many = runs[0], runs[-1]
    gain = sum(few.iteration.values()) / sum(many.iteration.values())
    yield words(
        BREAKS,
        mesh=many.once["mesh"],
        drawn=drawn / 1e6,
        share=100 * few.once["mesh"] / few.total(STEPS, ITERATIONS),
        gmsh=memory.meshed * LARGE[0] / 1e9,
        contact=memory.point * LARGE[1] / 1e9,
        contact_node=machine.ranks_per_node * memory.point * LARGE[1] / 1e9,
        bodies_node=machine.ranks_per_node * bytes_[0]["bodies"] / 1e9,
        bodies_last=machine.ranks_per_node * bytes_[-1]["bodies"] / 1e9,
        fit_first=int(256e9 // each[0]),
        fit_last=int(256e9 // each[-1]),
        surface=many.once["surface"] + many.once["coordinates"],
        shared=_at_the_contact(two) / _at_the_contact(single),
        waits=1e3 * (many.iteration["messages"] + many.iteration["collectives"]),
        fixed=1e3 * float(costs["contact"][2] + costs["vectors"][2]),
        bodies=1e3 * (many.iteration["product"] + many.iteration["cycle"]),
        gain=gain,
    )


def _at_the_contact(runs: Sequence[Run]) -> float:
    """Seconds of preparation at the contact, of the run with most contact points."""
    seconds = seconds_of(max(runs, key=lambda run: float(run["points"])))
    return seconds["surface"] + seconds["coordinates"]


def _power(value: float) -> str:
    return f"10{str(round(np.log10(value))).translate(str.maketrans('0123456789', '⁰¹²³⁴⁵⁶⁷⁸⁹'))}"


PAGE = Path(__file__).resolve().parents[3] / "docs" / "scaling.md"
REPEATS = 2
LIMIT = 180.0  # of a run [s]
FITTED = (Case(24), Case(32), Case(38), Case(48), Case(48, 8), Case(64, 8), Case(96, 2), Case(128, 2))  # on one rank
CHECKED = {  # ranks: cases
    2: (Case(24), Case(30), Case(32), Case(38), Case(48), Case(48, 8), Case(64, 8), Case(96, 2), Case(128, 2)),
    4: (Case(24), Case(32, 8), Case(128, 2)),  # for their counts and memory alone: more ranks than cores
    8: (Case(24), Case(128, 2)),
}
DRAWN = tuple(Case(n, steps=0) for n in (48, 64, 96, 128))


def run(case: Case, ranks: int, counter: Path | None) -> dict[str, Any]:
    """Measure a case on so many ranks in processes of its own.

    Raises:
        RuntimeError: it failed, or took too long.
    """
    module = "stickslip.workflows.lab.benchmarks.scaling_run"
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    preloaded = ["-x", f"LD_PRELOAD={counter}"] if counter else []
    words = ["mpirun", "-n", str(ranks), "--oversubscribe", *preloaded, sys.executable, "-m", module]
    words.append(json.dumps(asdict(case)))
    try:
        done = subprocess.run(words, capture_output=True, text=True, env=environment, timeout=LIMIT, check=False)
    except subprocess.TimeoutExpired as late:
        raise RuntimeError(f"{case} on {ranks} ranks takes more than {LIMIT:g} s") from late
    if done.returncode:
        raise RuntimeError(f"{case} on {ranks} ranks: {done.stderr[-300:]}")
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def least(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """The same run several times: the least seconds of each phase, all else from the first."""
    first, *_ = runs
    found = dict(first)
    for key in ("seconds", "parts"):
        if key in first:
            found[key] = {name: min(one[key][name] for one in runs) for name in first[key]}
    return found


def measured(case: Case, ranks: int, folder: Path, counter: Path | None) -> dict[str, Any]:
    """A case on so many ranks, from the folder if it is there."""
    n, _, layers = case.shape
    file = folder / f"{ranks}_{n}_{layers}_{case.steps}.json"
    if not file.exists():
        runs = [run(case, ranks, counter) for _ in range(REPEATS)]
        write_aside(file, json.dumps(least(runs)).encode())
        print(f"{case} on {ranks} ranks", flush=True)
    found: dict[str, Any] = json.loads(file.read_text())
    return found


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
