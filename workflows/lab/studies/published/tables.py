"""Rows as Markdown tables and as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Sequence

from stickslip.workflows.lab.studies.published.finding import Claim, Finding, Row, Rows

LONG = ("history", "values")  # lists: kept in the rows' own files, not in the CSV


def markdown(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """
    >>> print(markdown(["n", "a|b"], [["4", "x"]]))
    | n | a\\|b |
    |---|---|
    | 4 | x |
    """
    rows = [heads, ["---"] * len(heads), *lines]
    cells = [[cell.replace("|", "\\|").replace("\n", " ") for cell in row] for row in rows]
    return "\n".join(f"|{'|'.join(row)}|" if row[0] == "---" else f"| {' | '.join(row)} |" for row in cells)


def judged(claims: Iterable[Claim], rows: Rows, verdict: Callable[[Finding], str]) -> str:
    """Every claim with its verdict and the numbers behind it."""
    lines = []
    for claim in claims:
        found = claim.judge(rows)
        lines.append([claim.source, claim.says, f"**{verdict(found)}**", found.figure])
    return markdown(["source", "claim", "verdict", "measured"], lines)


def pivot(
    rows: Iterable[Row],
    line: Callable[[Row], Sequence[str]],
    column: Callable[[Row], str],
    cell: Callable[[Row], str],
    heads: Sequence[str],
) -> str:
    """One line for each value of `line`, one column for each value of `column`, in the order of the rows."""
    cells: dict[tuple[str, ...], dict[str, str]] = {}
    columns: dict[str, None] = {}
    for row in rows:
        cells.setdefault(tuple(line(row)), {})[column(row)] = cell(row)
        columns[column(row)] = None
    return markdown([*heads, *columns], [[*key, *(found.get(c, "") for c in columns)] for key, found in cells.items()])


def csv_of(rows: Sequence[Row]) -> str:
    """All rows of one study, a column for each key that any of them has."""
    keys = [key for key in dict.fromkeys(key for row in rows for key in row) if key not in LONG]
    text = io.StringIO()
    writer = csv.DictWriter(text, keys, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
