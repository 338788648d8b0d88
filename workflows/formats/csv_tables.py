"""CSV tables that grow by the rows of each step, steps.csv among them; numbers read back to the same bits."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import MachineError
from stickslip.solvers.scene.timeline import Place
from stickslip.workflows.formats.files import disk_errors, make_folder
from stickslip.workflows.formats.marker import read_checked

STEPS = "steps.csv"
PRESCRIBED = {  # by table; the displacement of an obstacle is among the results: a force may drive it
    "supports": ("displacement",),
    "loads": ("pressure", "traction", "force"),
    "obstacles": ("rotation",),
    "contacts": ("friction", "gap_offset"),
}
Row = Sequence[object]


class Table(NamedTuple):
    """Rows that a step adds to a table."""

    name: str  # of the file
    header: Sequence[str]  # the same at every step
    rows: Sequence[Row]


def append_tables(folder: Path, tables: Iterable[Table]) -> None:
    """Append rows to every table; a new one begins with its header.

    Raises:
        MachineError: the disk is full.
    """
    make_folder(folder)
    for name, header, rows in tables:
        _append(folder / name, header, rows)


def write_tables_again(folder: Path, steps: Iterable[Iterable[Table]], names: Iterable[str]) -> None:
    """Write tables anew, from the rows of each step.

    Args:
        names: of the tables; one that has no rows is removed.

    Raises:
        MachineError: the disk is full; the tables are then as they were.
    """
    aside: dict[str, Path] = {}
    for tables in steps:
        for name, header, rows in tables:
            aside[name] = folder / f".{name}.part"
            _append(aside[name], header, rows)
    with disk_errors(folder):
        for name in names:
            if name in aside:
                aside[name].replace(folder / name)
            else:
                (folder / name).unlink(missing_ok=True)


def read_table(path: Path) -> tuple[list[str], Iterator[list[str]]]:
    """Return header and rows, which are taken apart as they are asked for.

    Raises:
        MachineError: it is missing or not a table; see `read_checked`.
    """
    try:
        rows = csv.reader(io.StringIO(read_checked(path).decode(), newline=""))
        return next(rows), rows
    except (ValueError, StopIteration) as error:
        raise MachineError(f"{path}: cannot be read: {error or 'it is empty'}") from error


def is_prescribed(place: Place) -> bool:
    """Whether a value in time has a column of its own; of the tables that effects own, all have."""
    return place.table not in PRESCRIBED or place.quantity in PRESCRIBED[place.table]


def column(place: Place) -> str:
    """Name of the column of a prescribed value.

    >>> column(Place("contacts", "base", "friction", "bound"))
    'contact.base.friction.bound'
    """
    return str(place).replace("s.", ".", 1) if place.name else str(place)


def read_steps_table(folder: Path) -> dict[str, Array]:
    """The columns of steps.csv, each with a value a step; an empty cell is NaN.

    Raises:
        MachineError: it is missing or damaged.
    """
    header, rows = read_table(folder / STEPS)
    try:
        cells = [[cell or "nan" for cell in row] for row in rows]
        table = np.array(cells, float).reshape(len(cells), len(header))
    except (ValueError, csv.Error) as error:
        raise MachineError(f"{folder / STEPS}: cannot be read: {error}") from error
    return dict(zip(header, table.T, strict=True))


def csv_text(rows: Iterable[Row]) -> str:
    """Lines of a table.

    >>> csv_text([["time", "note"], [0.5, "a, b"]])
    'time,note\\n0.5,"a, b"\\n'
    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def python_numbers(numbers: Iterable[object]) -> list[object]:
    """numpy's numbers as Python's, whose repr is the shortest that reads back the same."""
    return [n.item() if isinstance(n, np.generic) else n for n in numbers]


def _append(path: Path, header: Sequence[str], rows: Iterable[Row]) -> None:
    with disk_errors(path), path.open("ab") as file:
        first = [header] if file.tell() == 0 else []
        file.write(csv_text([*first, *rows]).encode())
