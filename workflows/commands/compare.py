"""stickslip compare: two results side by side, on the terminal or as a page."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from stickslip.geometry.errors import SceneError
from stickslip.workflows.commands.process import speaks
from stickslip.workflows.formats.aside import write_aside
from stickslip.workflows.pictures.report_compare import compare, compare_page, unlike
from stickslip.workflows.run.load import found
from stickslip.workflows.run.terminal import console, print_table

WIDE = 160  # letters


def compare_folders(a: Path, b: Path, page: Path | None) -> None:
    """Print the tables; with `page` write them there as well.

    Raises:
        FolderError: there are no results to compare.
        SceneError: a folder stands where the page is to be.
    """
    if page is not None and page.is_dir():
        raise SceneError(f"{page}: is a folder; name a file for the page with -o")
    first, second = found(a), found(b)
    out = console(WIDE, quiet=not speaks())
    out.print(f"A: {a}, {first.title}\nB: {b}, {second.title}")
    if said := unlike(first, second):
        out.print(said, soft_wrap=True)
    for one in compare(first, second):
        table = Table(title=one.title, title_justify="left")
        for place, name in enumerate(one.head):
            table.add_column(name, justify="right" if place and len(one.head) > 3 else "left")
        for row in one.rows:
            table.add_row(*row)
        if len(one.head) > 3:
            print_table(table, out)
        else:
            out.print(table)  # words are folded
    if page is not None and speaks():
        write_aside(page, compare_page(first, second).encode())
        out.print(f"wrote {page}")
