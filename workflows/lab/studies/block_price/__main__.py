"""The page: `python -m stickslip.workflows.lab.studies.block_price [-o DIR] [--page FILE] [--small]`, on one thread.

Every measurement is saved in DIR/rows when it ends; one that exists is not repeated, unless it was stopped by a shorter
--limit. Remove DIR to begin anew.
"""

from __future__ import annotations

import logging
import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from stickslip.workflows.cost.measure import ONE_THREAD
from stickslip.workflows.lab.studies.block_price.measure import SMALL, Case, Sizes, row_of, tables
from stickslip.workflows.lab.studies.block_price.page import NAME, write_page
from stickslip.workflows.lab.studies.finding import Measurement, Rows, collected

LIMIT, FEW = 60.0, 5.0  # s


def measured(folder: Path, sizes: Sizes, limit: float) -> Rows:
    """The rows of every table: those of an earlier run are read, the missing ones are measured."""

    def measurement(table: str, case: Case) -> Measurement:
        name = f"{table}: {case.dim}D n = {case.n}, {case.method}"
        return table, name, lambda rows: [row_of(case, rows, limit)]

    wanted = tables(sizes)
    return collected(folder, wanted, [measurement(table, case) for table in wanted for case in wanted[table]])


def main(
    output: Annotated[Path, typer.Option("-o", "--output", help="where the measurements are kept")] = Path(
        "results/block_price"
    ),
    page: Annotated[Path | None, typer.Option("--page", help=f"the page [DIR/{NAME}]")] = None,
    small: Annotated[bool, typer.Option("--small", help="coarse meshes, in a minute")] = False,
    limit: Annotated[float, typer.Option("--limit", help="seconds of CPU time for one measurement")] = LIMIT,
) -> None:
    """Measure block-uzawa and the condensed methods side by side, and write the page."""
    logging.getLogger("stickslip.solvers").setLevel(logging.ERROR)  # a method that fails is a row, not a warning
    rows = measured(output, SMALL if small else Sizes(), min(limit, FEW) if small else limit)
    print(write_page(page or output / NAME, rows))


def one_thread() -> None:
    """Start this process again on one thread, unless it is; libraries read the number when they are loaded."""
    if not ONE_THREAD.items() <= os.environ.items():
        words = [sys.executable, "-m", "stickslip.workflows.lab.studies.block_price", *sys.argv[1:]]
        os.execve(sys.executable, words, {**os.environ, **ONE_THREAD})


if __name__ == "__main__":
    one_thread()
    typer.run(main)
