"""Rows that are measured once, verdicts on claims by them, and the rows as Markdown tables and as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress

from stickslip.workflows.formats.files import make_folder

Row = dict[str, Any]
Rows = Mapping[str, list[Row]]  # by study
Measurement = tuple[str, str, Callable[[Path], list[Row]]]  # study, name, and what measures or reads its rows
HOLDS, HOLDS_NOT, UNKNOWN = "holds", "does not hold", "not measured"
FREE_OF_H = 0.1  # log-log slope below which a quantity counts as independent of h
GROWS = 0.5  # log-log slope above which a quantity counts as growing with 1/h
AS_MANY = 1.1  # ratio up to which two numbers of iterations count as equal


@dataclass(frozen=True)
class Finding:
    """Cases in which a claim was tested, each true or false, and the numbers behind it."""

    cases: Mapping[str, bool]
    figure: str

    @property
    def verdict(self) -> str:
        """
        >>> Finding({"2D": True, "3D": False}, "").verdict
        'holds only for 2D'
        """
        held = [case for case, true in self.cases.items() if true]
        if not self.cases:
            return UNKNOWN
        if len(held) == len(self.cases):
            return HOLDS
        return f"holds only for {'; '.join(held)}" if held else HOLDS_NOT


def collected(folder: Path, names: Iterable[str], todo: Sequence[Measurement]) -> Rows:
    """Return the rows of every study; each measurement keeps its answer in a folder of rows, and begins with it.

    Args:
        names: of all studies.
    """
    make_folder(folder)
    make_folder(folder / "rows")
    rows: Rows = {name: [] for name in names}
    with Progress(console=Console(stderr=True)) as progress:
        task = progress.add_task("measuring", total=len(todo))
        for study, name, measure in todo:
            progress.update(task, description=name)
            rows[study].extend(measure(folder / "rows"))
            progress.advance(task)
    return rows


def chosen(rows: Iterable[Row], **keys: Any) -> list[Row]:
    """Rows with these values."""
    return [row for row in rows if all(row.get(key) == value for key, value in keys.items())]


def different(rows: Iterable[Row], key: str) -> list[Any]:
    """Different values of a key, in the order of the rows."""
    return list(dict.fromkeys(row[key] for row in rows))


def grouped(rows: Iterable[Row], name: Callable[[Row], Any]) -> dict[Any, list[Row]]:
    """Return the rows of each name, in their order."""
    found: dict[Any, list[Row]] = {}
    for row in rows:
        found.setdefault(name(row), []).append(row)
    return found


def mesh_of(row: Row) -> str:
    """
    >>> mesh_of({"dim": 2, "n": 8})
    '2D n = 8'
    """
    return f"{row['dim']}D n = {row['n']}"


def alike(rows: list[Row], key: str) -> list[Row]:
    """Return rows in which only the key varies, by rising key; mesh, mu and omega have their most frequent values."""
    others = [k for k in ("dim", "n", "mu", "omega_factor") if k != key]
    kinds = grouped(rows, lambda row: tuple(row[k] for k in others))
    best = max(kinds.values(), key=lambda found: len({row[key] for row in found}), default=[])
    return sorted(best, key=lambda row: float(row[key]))


def slope(rows: Iterable[Row], x: str, y: str) -> float | None:
    """Of log y against log x, over rows that have both; None of fewer than two.

    >>> slope([{"n": 2, "count": 8}, {"n": 4, "count": 64}, {"n": 8}], "n", "count")
    3.0
    """
    points = np.array([(row[x], row[y]) for row in rows if row.get(y)], float).reshape(-1, 2)
    if len(np.unique(points[:, 0])) < 2:
        return None
    at, value = np.log(points).T
    return round(float(np.polyfit(at, value, 1)[0]), 9) + 0.0  # no -0


def slopes(rows: list[Row], y: str, **keys: Any) -> dict[str, float]:
    """Against n between the two finest meshes that have both, by dimension: "2D", "3D"."""
    found: dict[str, float] = {}
    for dim in sorted(set(different(rows, "dim"))):
        last = sorted((row for row in chosen(rows, dim=dim, **keys) if row.get(y)), key=lambda row: int(row["n"]))[-2:]
        value = slope(last, "n", y)
        if value is not None:
            found[f"{dim}D"] = value
    return found


def free_of_h(found: Mapping[str, float], figure: str) -> Finding:
    """Judge whether slopes against n are near zero."""
    return Finding({name: abs(value) < FREE_OF_H for name, value in found.items()}, figure)


def grows(found: Mapping[str, float], figure: str) -> Finding:
    """Judge whether slopes against n are far above zero."""
    return Finding({name: value > GROWS for name, value in found.items()}, figure)


def done(row: Row) -> bool:
    """Whether the run converged."""
    return bool(row["status"] == "converged")


def beside(rows: Iterable[Row], method: str, other: str, key: str) -> dict[str, float]:
    """Return what a method takes of something over what another one takes, by mesh, where both converge."""
    own, others = (
        {mesh_of(row): row[key] for row in rows if row["method"] == m and done(row)} for m in (method, other)
    )
    return {mesh: value / others[mesh] for mesh, value in own.items() if mesh in others}


def enough(rows: Sequence[Row], name: str) -> Finding:
    """Judge whether all runs with a step size below the bound converge; the figure says which do beyond it.

    Args:
        name: of a case, a format.
    """
    cases = {name.format(**row): done(row) for row in rows if row["part"] < 1}
    beyond = [f"{row['part']:g}" for row in rows if row["part"] > 1 and done(row)]
    return Finding(cases, f"beyond the bound it still converges at αλ₁/2 = {', '.join(beyond) or 'none'}")


def between(values: Iterable[float], form: str = ".2g") -> str:
    """
    >>> between([0.5, 2.0, 1.0])
    '0.5 to 2'
    """
    known = list(values)
    return f"{min(known):{form}} to {max(known):{form}}" if known else "none"


def said(figures: Mapping[str, float], form: str = ".2g") -> str:
    """Join the cases in one sentence.

    >>> said({"2D": 1.04, "3D": 0.5})
    '2D 1; 3D 0.5'
    """
    return "; ".join(f"{name} {value:{form}}" for name, value in figures.items())


LONG = ("history", "values")  # lists: kept in the rows' own files, not in the CSV


def escaped(cell: str) -> str:
    """Return the text of a cell of a table on one line."""
    return cell.replace("|", "\\|").replace("\n", " ")


def markdown(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """
    >>> print(markdown(["n", "a|b"], [["4", "x"]]))
    | n | a\\|b |
    |---|---|
    | 4 | x |
    """
    rows = [heads, ["---"] * len(heads), *lines]
    cells = [[escaped(cell) for cell in row] for row in rows]
    return "\n".join(f"|{'|'.join(row)}|" if row[0] == "---" else f"| {' | '.join(row)} |" for row in cells)


def judged(found: Finding, verdict: str) -> str:
    """Return the last two cells of a claim's line: the verdict, and the numbers behind it."""
    return f"{escaped(f'**{verdict}**')} | {escaped(found.figure)}"


def pivot(
    rows: Iterable[Row], line: Sequence[str], column: str, cell: str | Callable[[Row], str], heads: Sequence[str] = ()
) -> str:
    """One line for each value of the keys `line`, one column for each text of `column`, in the order of the rows.

    Args:
        column: a format, filled from a row.
        cell: the same, or a function of the row.
        heads: names of the keys, if these are not shown.

    >>> print(pivot([{"method": "a", "n": 4, "count": 7}], ["method"], "n = {n}", "{count:.1f}"))
    | method | n = 4 |
    |---|---|
    | a | 7.0 |
    """
    cells: dict[tuple[str, ...], dict[str, str]] = {}
    columns: dict[str, None] = {}
    for row in rows:
        name = column.format(**row)
        text = cell.format(**row) if isinstance(cell, str) else cell(row)
        cells.setdefault(tuple(row[key] for key in line), {})[name] = text
        columns[name] = None
    lines = [[*key, *(found.get(c, "") for c in columns)] for key, found in cells.items()]
    return markdown([*(heads or line), *columns], lines)


def csv_of(rows: Sequence[Row]) -> str:
    """All rows of one study, a column for each key that any of them has."""
    keys = [key for key in dict.fromkeys(key for row in rows for key in row) if key not in LONG]
    text = io.StringIO()
    writer = csv.DictWriter(text, keys, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
