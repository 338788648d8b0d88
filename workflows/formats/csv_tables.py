"""CSV tables that grow by the rows of each step; numbers are written so that they read back to the same bits."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stickslip.geometry.errors import MachineError
from stickslip.workflows.formats.files import disk_errors, make_folder

Row = Sequence[object]


class Table(NamedTuple):
    """What a step adds to a table."""

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


def read_table(path: Path) -> tuple[list[str], list[list[str]]]:
    """Header and rows.

    Raises:
        MachineError: it is missing or not a table.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            header, *rows = csv.reader(file)
    except (OSError, ValueError) as error:
        raise MachineError(f"{path}: cannot be read: {error}") from error
    return header, rows


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
