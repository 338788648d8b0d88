"""`stickslip report`: a page of results that are there."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stickslip.workflows.commands.process import complain, say, speaks


def report(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="results of a run")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.html", help="[FOLDER/report.html]")
    ] = None,
) -> None:
    """Make a page of a run's results: numbers, pictures, cost, audit, the bodies in 3D; it opens without a network."""
    from stickslip.workflows.formats.marker import refuse_place
    from stickslip.workflows.pictures.report_page import NAME, write_report
    from stickslip.workflows.run.stored_results import found

    results = found(folder, complain)  # that of a run without an end is found as well
    if (page := output or results.folder / NAME) != results.folder / NAME or page.is_dir():
        refuse_place(page, "page")
    if speaks():
        say(f"wrote {write_report(results, output)}")
