"""Claims and measured values: `python -m stickslip.workflows.lab.studies.published [-o DIR]` writes DIR/published.md.

Every measurement is saved when it ends; one that exists is not repeated. Remove DIR to begin anew.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import typer

from stickslip.workflows.lab.studies.finding import Rows, collected
from stickslip.workflows.lab.studies.published.measurements import MEASURED, SMALL, Sizes, measurements
from stickslip.workflows.lab.studies.published.page import write_page


def measured(output: Path, sizes: Sizes) -> Rows:
    """All rows: those of an earlier run are read, the missing ones are measured."""
    return collected(output, MEASURED, [(each.study, each.name, each.rows) for each in measurements(sizes)])


def main(
    output: Annotated[Path, typer.Option("-o", "--output", help="where the page goes")] = Path("results/published"),
    small: Annotated[bool, typer.Option("--small", help="coarse meshes, in a minute")] = False,
) -> None:
    """Measure the published methods and write the page."""
    logging.getLogger("stickslip.solvers").setLevel(logging.ERROR)  # a method that fails is a row, not a warning
    print(write_page(output, measured(output, SMALL if small else Sizes())))


if __name__ == "__main__":
    typer.run(main)
