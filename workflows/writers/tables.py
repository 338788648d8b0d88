"""Tables for spreadsheets and scripts: what grows by the rows of each step, in columns with names.

Numbers are written so that they read back to the same bits. Write a step's tables before its step file: whatever a
crash leaves beyond the last step file is then surplus, and `write_again` takes it away.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from geometry.arrays import Array
from solvers.results.step_result import OPEN, SLIP, STICK, ContactState, MeshData, StepResult
from solvers.scene.quantities import STRESSES
from solvers.stepping.history import HistoryTuple
from workflows.writers.aside import disk_errors, make_folder

STATUS = {OPEN: "open", SLIP: "slip", STICK: "stick"}
HISTORY = ("step", "time", "iteration", "residual", "volume_solves", "seconds", "method")
OTHERS = ("probes.csv", "history.csv", "steps.csv")
Row = Sequence[object]
Table = tuple[str, Sequence[str], Sequence[Row]]  # name, header, rows to add


def write_tables(folder: Path, tables: Iterable[Table]) -> None:
    """Append the rows of one step to every table.

    Raises:
        MachineError: the disk is full.
    """
    make_folder(folder)
    for name, header, rows in tables:
        append_rows(folder / name, header, rows)


def write_again(folder: Path, steps: Iterable[Iterable[Table]], known: Iterable[str]) -> None:
    """Write every table anew, from the rows of each step, before a run is resumed.

    Args:
        known: names of all tables; one that has no rows is removed.

    Raises:
        MachineError: the disk is full; the tables are then as they were.
    """
    aside: dict[str, Path] = {}
    for tables in steps:
        for name, header, rows in tables:
            aside[name] = folder / f".{name}.part"
            append_rows(aside[name], header, rows)
    with disk_errors(folder):
        for name in known:
            if name in aside:
                aside[name].replace(folder / name)
            else:
                (folder / name).unlink(missing_ok=True)


def tables_of(index: int, mesh: MeshData, result: StepResult) -> Iterator[Table]:
    """What a step adds to the tables of contacts, probes and iterations."""
    dim = mesh.points.shape[1]
    for name, contact in result.contacts.items():
        rows = contact_rows(result.time, mesh.surfaces[name][0], contact)
        yield contact_table(name), contact_header(dim), rows
    if result.probes:
        yield "probes.csv", probe_header(dim), probe_rows(result)
    yield history_of(index, result.history)


def history_of(index: int, history: Iterable[HistoryTuple]) -> Table:
    """Rows of history.csv; those of a step that failed too.

    Args:
        history: see `HistoryRow`.
    """
    return "history.csv", HISTORY, [(int(index), *_plain(row)) for row in history]


def contact_table(contact: str) -> str:
    """Name of its table.

    >>> contact_table("base")
    'contact_base.csv'
    """
    return f"contact_{contact}.csv"


def contact_header(dim: int) -> list[str]:
    """Columns of contact_NAME.csv."""
    vectors = [f"{name}_{a}" for name in ("traction", "slip", "slip_increment", "lambda") for a in "xyz"[:dim]]
    return ["time", *"xyz"[:dim], "weight", "gap", "pressure", *vectors, "status"]


def contact_rows(time: float, points: Array, contact: ContactState) -> list[Row]:
    """One row a point; points (n, d) [m]."""
    scalars = np.column_stack([contact.weight, contact.gap, contact.pressure])
    vectors = np.hstack([contact.traction, contact.slip, contact.slip_increment, contact.lam])
    numbers = np.hstack([points, scalars, vectors]).tolist()
    words = [STATUS[int(s)] for s in contact.status]
    return [(float(time), *row, word) for row, word in zip(numbers, words, strict=True)]


def probe_header(dim: int) -> list[str]:
    """Columns of probes.csv."""
    return ["time", "probe", *(f"displacement_{a}" for a in "xyz"[:dim]), *(f"stress_{ij}" for ij in STRESSES)]


def probe_rows(result: StepResult) -> list[Row]:
    """One row a probe."""
    return [
        (float(result.time), name, *_plain(displacement), *(float(stress[ij]) for ij in STRESSES.values()))
        for name, (displacement, stress) in result.probes.items()
    ]


def append_rows(path: Path, header: Sequence[str], rows: Iterable[Row]) -> None:
    """Add rows at the end of a table, which begins with its header.

    Raises:
        MachineError: the disk is full.
    """
    with disk_errors(path), path.open("ab") as file:
        first = [header] if file.tell() == 0 else []
        file.write(_text([*first, *rows]).encode())


def bring_to_disk(folder: Path, names: Iterable[str]) -> None:
    """At the end: until then step files hold all that a table does, and `write_again` has it from there.

    Raises:
        MachineError: the disk is full.
    """
    for path in (folder / name for name in names):
        if path.exists():
            with disk_errors(path), path.open("r+b") as file:
                os.fsync(file.fileno())


def _text(rows: Iterable[Row]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def _plain(numbers: Iterable[object]) -> list[object]:
    """numpy's numbers as Python's, whose repr is the shortest that reads back the same."""
    return [n.item() if isinstance(n, np.generic) else n for n in numbers]
