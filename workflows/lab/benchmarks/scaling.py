"""Scaling measured on few ranks, a model, and what it says of many.

`python -m stickslip.workflows.lab.benchmarks.scaling` writes docs/scaling.md; ten minutes on two cores. Each run is a
process of its own, and made twice: the smaller seconds count. Existing measurements in the folder are kept.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

import typer

from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.lab.benchmarks.scaling_messages import build
from stickslip.workflows.lab.benchmarks.scaling_page import page
from stickslip.workflows.lab.benchmarks.scaling_run import Case

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
