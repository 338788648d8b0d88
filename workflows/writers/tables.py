"""Tables for spreadsheets and scripts: contact_NAME.csv by step and point, probes.csv, history.csv by iteration.

A step's rows are written before its file: whatever a crash leaves beyond the last step's file is then surplus, and
`resume` takes it away.
"""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.record import STRESSES
from stickslip.solvers.stepping.history import HistoryTuple
from stickslip.workflows.formats.contact_line import walk
from stickslip.workflows.formats.csv_tables import Row, Table, append_tables, python_numbers, write_tables_again
from stickslip.workflows.formats.files import disk_errors
from stickslip.workflows.writers.writer import Ended, Turn, Writer

HISTORY = "history.csv"
HEADER = ("step", "time", "iteration", "residual", "volume_solves", "seconds", "method")  # see `HistoryRow`
PROBES = "probes.csv"


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


class ContactTables(TableWriter):
    """A table a contact."""

    def names(self) -> list[str]:
        return [contact_table(name) for name in self.job.scene.contacts]

    def tables(self, index: int, result: StepResult) -> Iterator[Table]:
        for name, contact in result.contacts.items():
            columns = contact.columns() | self._arcs.get(name, {})
            rows = [(float(result.time), *row) for row in zip(*(c.tolist() for c in columns.values()), strict=True)]
            yield Table(contact_table(name), ["time", *columns], rows)

    @cached_property
    def _arcs(self) -> dict[str, dict[str, Array]]:
        """In plane models the length along each side, to sort its points by; the rows keep their order."""
        found = {}
        for name, (points, facets, shape) in self.job.mesh.surfaces.items():
            if shape == "interval":
                line, arc = walk(points, facets), np.zeros(len(points))
                arc[line.nodes[::-1]] = line.arc[::-1]  # a closed line comes back to its first node
                found[name] = {"arc": arc}
        return found


def contact_table(contact: str) -> str:
    """Name of its table.

    >>> contact_table("base")
    'contact_base.csv'
    """
    return f"contact_{contact}.csv"


class HistoryTable(TableWriter):
    """One row an iteration."""

    def names(self) -> list[str]:
        return [HISTORY]

    def tables(self, index: int, result: StepResult) -> Iterator[Table]:
        yield history_table(index, result.history)

    def failed(self, index: int, history: Sequence[HistoryTuple]) -> None:
        append_tables(self.job.folder, [history_table(index, history)])


def history_table(index: int, history: Iterable[HistoryTuple]) -> Table:
    """Rows of the iterations of a step."""
    return Table(HISTORY, HEADER, [(int(index), *python_numbers(row)) for row in history])


class ProbeTable(TableWriter):
    """One table for all probes; none where the scene has none."""

    def names(self) -> list[str]:
        return [PROBES]

    def tables(self, index: int, result: StepResult) -> Iterator[Table]:
        if result.probes:
            yield Table(PROBES, probe_header(self.job.mesh.points.shape[1]), probe_rows(result))


def probe_header(dim: int) -> list[str]:
    """Names of the columns."""
    return ["time", "probe", *(f"displacement_{a}" for a in "xyz"[:dim]), *(f"stress_{ij}" for ij in STRESSES)]


def probe_rows(result: StepResult) -> list[Row]:
    """One row a probe."""
    return [
        (float(result.time), name, *python_numbers(displacement), *(float(stress[ij]) for ij in STRESSES.values()))
        for name, (displacement, stress) in result.probes.items()
    ]
