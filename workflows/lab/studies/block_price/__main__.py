"""The page: `python -m stickslip.workflows.lab.studies.block_price [-o DIR] [--page FILE] [--small]`, on one thread.

Every measurement is saved in DIR/rows when it ends; one that exists is not repeated, unless it was stopped by a shorter
--limit. Remove DIR to begin anew.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer

from stickslip.geometry.dolfinx_versions import DOLFINX
from stickslip.workflows.cost.measure import ONE_THREAD
from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.formats.templates import render
from stickslip.workflows.lab.studies import finding
from stickslip.workflows.lab.studies.block_price import claims
from stickslip.workflows.lab.studies.block_price.claims import verdict
from stickslip.workflows.lab.studies.block_price.measure import (
    AS_EXACT,
    EXACT,
    METHODS,
    REFERENCE,
    SMALL,
    TOLERANCE,
    Case,
    Sizes,
    row_of,
    tables,
)
from stickslip.workflows.lab.studies.finding import Measurement, Row, Rows, chosen, different, done, mesh_of, slopes

LIMIT, FEW = 60.0, 5.0  # s
NAME = "block_uzawa_price.md"
BUSY = 0.9  # share of a core below which seconds are not those of the method alone


def write_page(path: Path, rows: Rows) -> Path:
    """Write the page; its path."""
    text = render(
        "lab/studies/templates/block_price.md",
        name=NAME,
        tolerance=TOLERANCE,
        exact=EXACT,
        as_exact=AS_EXACT[1],
        reference=REFERENCE,
        conditions=conditions(rows),
        finding=finding,
        claims=claims,
        judged=lambda judge: finding.judged(judge(rows), verdict(judge(rows))),
        rows=rows,
        alpha=[row | {"base": "glued" if row["sticks"] else f"mu = {row['mu']:g}"} for row in rows["alpha"]],
        inner=[row | _inner_rule(row) for row in rows["inner"]],
        ratio=_ratio,
        in_order=_in_order,
        with_slopes=_with_slopes,
        iterations=_iterations,
    )
    write_aside(path, text.encode())
    return path


def conditions(rows: Rows) -> str:
    """Tell how the page was measured, and whether something else used the core."""
    measured = [row for table in rows.values() for row in table if done(row)]
    wall = sum(row["wall"] for row in measured)
    share = sum(row["cpu"] for row in measured) / wall if wall else 1.0
    words = (
        f"**Conditions.** dolfinx {DOLFINX}, one process, one thread; runs under half a second are the best of three."
    )
    if share < BUSY:
        words += f" The machine was busy: the runs got {share:.0%} of a core. Read seconds with care; counts are exact."
    return words


def _ratio(row: Row, beside: Sequence[Row]) -> str:
    """Seconds over those of the reference for the same problem, which is among the rows beside it."""
    same = {key: row[key] for key in ("dim", "n", "mu", "c_n", "steps", "sticks")}
    reference = [other for other in chosen(beside, method=REFERENCE, **same) if done(other)]
    return f"{row['seconds'] / reference[0]['seconds']:.3g}" if reference else ""


def _in_order(rows: Sequence[Row], key: str) -> list[Row]:
    """By method, then by the values of the key as they were measured."""
    values = different(rows, key)
    return sorted(rows, key=lambda row: (METHODS.index(row["method"]), values.index(row[key])))


def _with_slopes(rows: list[Row]) -> Iterator[Row]:
    """Columns of the iterations on each mesh, then of their slopes in each dimension."""
    for row in rows:
        yield {"method": row["method"], "column": mesh_of(row), "cell": _iterations(row)}
    for dim in different(rows, "dim"):
        for method in different(rows, "method"):
            grown = slopes(rows, "iterations", method=method).get(f"{dim}D")
            slope = "" if grown is None else f"{grown:.2f}"
            yield {"method": method, "column": f"{dim}D slope", "cell": slope}


def _inner_rule(row: Row) -> Row:
    """The rule and the tolerance of its inner solves, as they are shown."""
    inexact = "inexact" in row["method"]
    return {"rule": row["rule"] if inexact else "exact", "share": f"{row['share']:g}" if inexact else ""}


def _iterations(row: Row) -> str:
    if done(row):
        return str(row["iterations"])
    return "stopped" if row["status"].startswith("stopped") else "fails"


def measured(folder: Path, sizes: Sizes, limit: float) -> Rows:
    """The rows of every table: those of an earlier run are read, the missing ones are measured."""

    def measurement(table: str, case: Case) -> Measurement:
        name = f"{table}: {case.dim}D n = {case.n}, {case.method}"
        return table, name, lambda rows: [row_of(case, rows, limit)]

    wanted = tables(sizes)
    return finding.collected(folder, wanted, [measurement(table, case) for table in wanted for case in wanted[table]])


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
