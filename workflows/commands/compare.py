"""`stickslip compare`: two results side by side, on the terminal or as a page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stickslip.workflows.commands.process import complain, speaks


def compare(
    a: Annotated[Path, typer.Argument(metavar="A", help="results of a run")],
    b: Annotated[Path, typer.Argument(metavar="B", help="results of another one")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.html", help="write them as a page too")
    ] = None,
) -> None:
    """Lay the results of two runs side by side: what was asked differently, numbers with ±, prices."""
    from stickslip.workflows.formats.files import write_output
    from stickslip.workflows.formats.marker import refuse_place
    from stickslip.workflows.pictures import report_compare
    from stickslip.workflows.run.stored_results import found
    from stickslip.workflows.run.terminal import console, print_table, table_of

    if output is not None:
        refuse_place(output, "page")
    first, second = found(a, complain), found(b, complain)
    out = console(160, quiet=not speaks())
    out.print(f"A: {a}, {first.title}\nB: {b}, {second.title}")
    for one in report_compare.compare(first, second):
        table = table_of(one.head, one.rows, one.head[: one.words])
        table.title, table.title_justify = one.title, "left"
        if len(one.head) > 3:
            print_table(table, out)
        else:
            out.print(table)  # words are folded
    out.print("\n".join(report_compare.notes(first, second)), soft_wrap=True)
    if output is not None and speaks():
        write_output(output, report_compare.compare_page(first, second).encode())
        out.print(f"wrote {output}")
