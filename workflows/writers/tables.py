"""Tables for spreadsheets and scripts: what grows by the rows of each step, in columns with names.

Numbers are written so that they read back to the same bits. A step's rows are written before its file: whatever a
crash leaves beyond the last step's file is then surplus, and `resume` takes it away.
"""

from __future__ import annotations

import csv
import io
import os
from abc import abstractmethod
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from geometry.errors import MachineError
from solvers.results.step_result import StepResult
from workflows.writers.aside import disk_errors, make_folder
from workflows.writers.writer import Ended, Turn, Writer

Row = Sequence[object]


class Table(NamedTuple):
    """What a step adds to a table."""

    name: str  # of the file
    header: Sequence[str]  # the same at every step
    rows: Sequence[Row]


class TableWriter(Writer):
    """Base of the writers of tables."""

    turn = Turn.BEFORE
    reader, files = "scripts", ("*.csv",)

    @abstractmethod
    def names(self) -> Sequence[str]:
        """Of all tables that it may write."""

    @abstractmethod
    def tables(self, index: int, result: StepResult) -> Iterable[Table]:
        """What a step adds to them; needs no displacement and no stress."""

    def resume(self, steps: Sequence[StepResult]) -> None:
        """Write every table anew; one that has no rows is removed."""
        added = (self.tables(index, step) for index, step in enumerate(steps, start=1))
        write_tables_again(self.job.folder, added, self.names())

    def step(self, index: int, result: StepResult) -> None:
        append_tables(self.job.folder, self.tables(index, result))

    def finish(self, ended: Ended) -> None:
        """Bring them to the disk: until then the steps' files hold all that they do."""
        for path in (self.job.folder / name for name in self.names()):
            if path.exists():
                with disk_errors(path), path.open("r+b") as file:
                    os.fsync(file.fileno())


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


def python_numbers(numbers: Iterable[object]) -> list[object]:
    """numpy's numbers as Python's, whose repr is the shortest that reads back the same."""
    return [n.item() if isinstance(n, np.generic) else n for n in numbers]


def _append(path: Path, header: Sequence[str], rows: Iterable[Row]) -> None:
    with disk_errors(path), path.open("ab") as file:
        first = [header] if file.tell() == 0 else []
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([*first, *rows])
        file.write(text.getvalue().encode())
