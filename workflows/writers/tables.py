"""Tables for spreadsheets and scripts: what grows by the rows of each step, in columns with names.

Numbers are written so that they read back to the same bits. Write a step's tables before its step file: whatever a
crash leaves beyond the last step file is then surplus, and `cut_tables` takes it away.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from geometry.errors import MachineError
from solvers.quantities import STRESSES
from solvers.step_result import OPEN, SLIP, STICK, Array, ContactState, HistoryTuple, MeshData, StepResult
from workflows.writers.aside import disk_errors, make_folder, write_aside

STATUS = {OPEN: "open", SLIP: "slip", STICK: "stick"}
HISTORY = ("step", "time", "iteration", "residual", "volume_solves", "seconds", "method")
OTHERS = ("probes.csv", "history.csv", "steps.csv")  # that `cut_tables` cuts
Row = Sequence[object]


def write_tables(folder: Path, index: int, mesh: MeshData, result: StepResult) -> None:
    """Append the rows of one step to every table.

    Raises:
        MachineError: the disk is full.
    """
    make_folder(folder)
    dim = mesh.points.shape[1]
    for name, contact in result.contacts.items():
        rows = contact_rows(result.time, mesh.surfaces[name][0], contact)
        append_rows(folder / contact_table(name), contact_header(dim), rows)
    if result.probes:
        append_rows(folder / "probes.csv", probe_header(dim), probe_rows(result))
    write_history(folder, index, result.history)


def write_history(folder: Path, index: int, history: Iterable[HistoryTuple]) -> None:
    """Append iterations to history.csv; those of a step that failed too.

    Args:
        history: see `HistoryRow`.
    """
    append_rows(folder / "history.csv", HISTORY, [(int(index), *_plain(row)) for row in history])


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


def cut_tables(folder: Path, contacts: Iterable[str], time: float) -> None:
    """Take away the rows after `time` [s] and rows cut short, before a run is resumed from there.

    Raises:
        MachineError: a table cannot be read or is not what was written, or the disk is full.
    """
    for path in (folder / name for name in (*map(contact_table, contacts), *OTHERS)):
        if path.exists():
            write_aside(path, _text(_kept(path, time)).encode())


def _kept(path: Path, time: float) -> list[list[str]]:
    """Header and rows until `time`."""
    try:
        text = path.read_bytes().decode(errors="replace")
        whole = text[: text.rfind("\n") + 1]  # a last line without its end may be half a number
        header, *rows = list(csv.reader(io.StringIO(whole))) or [[]]
        when = header.index("time") if header else 0
        kept = [row for row in rows if len(row) == len(header) and float(row[when]) <= time]
    except OSError as error:
        raise MachineError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, csv.Error) as error:
        raise MachineError(f"{path}: not as it was written: {error}") from error
    return [header, *kept] if header else []


def append_rows(path: Path, header: Sequence[str], rows: Iterable[Row]) -> None:
    """Add rows at the end of a table, which begins with its header.

    Raises:
        MachineError: the disk is full.
    """
    with disk_errors(path), path.open("ab") as file:
        first = [header] if file.tell() == 0 else []
        file.write(_text([*first, *rows]).encode())
        file.flush()
        os.fsync(file.fileno())


def _text(rows: Iterable[Row]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def _plain(numbers: Iterable[object]) -> list[object]:
    """numpy's numbers as Python's, whose repr is the shortest that reads back the same."""
    return [n.item() if isinstance(n, np.generic) else n for n in numbers]
