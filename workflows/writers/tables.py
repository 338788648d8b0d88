"""CSV tables for spreadsheets and scripts, in columns with names: of steps, contacts, probes and iterations.

A step's rows are written before its file: whatever a crash leaves beyond the last step's file is then surplus, and
`resume` takes it away.
"""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property

import numpy as np

from stickslip.geometry.amplitude import value_at
from stickslip.geometry.arrays import Array
from stickslip.solvers.results.step_result import (
    ContactState,
    Errors,
    StepResult,
    numbers_shown,
    slope_columns,
    total_errors,
    values,
)
from stickslip.solvers.scene.record import Batch, ContactNumbers, Event, ProbeValue, flat_names, numbers_of
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.stepping.history import HistoryTuple
from stickslip.workflows.formats.contact_line import walk
from stickslip.workflows.formats.csv_tables import (
    STEPS,
    Table,
    append_tables,
    column,
    is_prescribed,
    python_numbers,
    write_tables_again,
)
from stickslip.workflows.formats.files import disk_errors
from stickslip.workflows.writers.writer import Ended, Turn, Writer

PROBES, HISTORY, EVENTS, CYCLES = "probes.csv", "history.csv", "events.csv", "cycles.csv"
OF_HISTORY = ("step", "time", "iteration", "residual", "volume_solves", "seconds", "method")  # see `HistoryRow`


class TableWriter(Writer):
    """Base of the writers of tables."""

    turn = Turn.BEFORE
    reader, files = "scripts", ("*.csv",)

    @abstractmethod
    def names(self) -> Sequence[str]:
        """Return the names of all tables that it may write."""

    @abstractmethod
    def tables(self, index: int, result: StepResult) -> Iterable[Table]:
        """Return what a step adds to them; needs no displacement and no stress."""

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
    """contact_NAME.csv: the points of a contact surface, one row a step and point."""

    def names(self) -> list[str]:
        return [contact_table(name) for name in self.job.scene.pairs]

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
    """history.csv: the iterations of every step, one row each; those of a step that failed too."""

    def names(self) -> list[str]:
        return [HISTORY]

    def tables(self, index: int, result: StepResult) -> Iterator[Table]:
        yield history_table(index, result.history)

    def failed(self, index: int, history: Sequence[HistoryTuple]) -> None:
        append_tables(self.job.folder, [history_table(index, history)])


def history_table(index: int, history: Iterable[HistoryTuple]) -> Table:
    """Rows of the iterations of a step."""
    return Table(HISTORY, OF_HISTORY, [(int(index), *python_numbers(row)) for row in history])


class ProbeTable(TableWriter):
    """probes.csv: one row a step and probe; none where the scene has no probes."""

    def names(self) -> list[str]:
        return [PROBES]

    def tables(self, index: int, result: StepResult) -> Iterator[Table]:
        numbers, dim = numbers_of(ProbeValue).items(), self.job.mesh.points.shape[1]
        header = ["time", "probe", *(f"{key}_{axis}" for key, number in numbers for axis in number.axes(dim))]
        rows = [
            (
                float(result.time),
                name,
                *(x for key, n in numbers for x in np.ravel(n.value(getattr(probe, key))).tolist()),
            )
            for name, probe in result.probes.items()
        ]
        if rows:
            yield Table(PROBES, header, rows)


class EventsTable(TableWriter):
    """events.csv: one row an event that a clock has found, when it is over."""

    @classmethod
    def wanted(cls, scene: Scene) -> bool:
        return scene.steps.clock is not None

    def names(self) -> list[str]:
        return [EVENTS]

    def tables(self, index: int, result: StepResult) -> Iterator[Table]:
        axes = [f"place_{axis}" for axis in "xyz"[: self.job.mesh.points.shape[1]]]
        yield Table(EVENTS, [*Event._fields[:-1], *axes], [(*event[:-1], *event.place) for event in result.events])


class CyclesTable(TableWriter):
    """cycles.csv: one row a contact and batch of load cycles: how it wears from cycle to cycle."""

    @classmethod
    def wanted(cls, scene: Scene) -> bool:
        return scene.steps.cycle is not None

    def names(self) -> list[str]:
        return [CYCLES]

    def tables(self, index: int, result: StepResult) -> Iterator[Table]:
        yield Table(CYCLES, [*Batch._fields], [*result.batches])


class StepsTable(TableWriter):
    """steps.csv: what the scene prescribes at the time of each step, and its resultants, energies and cost, in a row.

    What has no value then is an empty cell.
    """

    def names(self) -> list[str]:
        return [STEPS]

    def tables(self, index: int, result: StepResult) -> Iterator[Table]:
        yield _table(steps_row(index, self.job.scene, result))

    def finish(self, ended: Ended) -> None:
        """Write it anew with a column for the total error of each number, where errors were estimated."""
        if ended.errors is not None:
            rows = (
                steps_row(index, self.job.scene, step) | errors_row(step, errors)
                for index, (step, errors) in enumerate(zip(ended.steps, ended.errors, strict=True), start=1)
            )
            write_tables_again(self.job.folder, ([_table(row)] for row in rows), self.names())
        super().finish(ended)


def _table(row: dict[str, float]) -> Table:
    """A row; an empty cell for NaN."""
    return Table(STEPS, list(row), [["" if np.isnan(n) else n for n in row.values()]])


def errors_row(step: StepResult, errors: Errors) -> dict[str, float]:
    """Total errors of one step's numbers by column; NaN: not known."""
    return {f"{name}.error": value for name, value in total_errors(step, errors).items()}


def steps_row(index: int, scene: Scene, step: StepResult) -> dict[str, float]:
    """By column, in SI units; NaN: the mean slip where nothing touches.

    Resultants act on the side that the scene calls `surface`, and slips are its own.
    """
    found: dict[str, float] = {"step": index, "time": step.time}
    for place, amplitude in scene.drives().items():
        if is_prescribed(place):
            found[column(place)] = value_at(amplitude, step.time, scene.steps.end)
    numbers = values(step)
    for name, contact in step.contacts.items():
        found |= {f"{name}.{key}": numbers.pop(f"{name}.{key}") for key in numbers_shown(contact)}
        found |= _vectors(name, contact, scene.axisymmetric)
    for name, whole in step.sums.items():
        found |= _columns(name, {"force": whole.force, "moment": whole.moment})
    effort = {key: getattr(step, key) for key in numbers_of(StepResult) if key != "time"}
    every = found | dict(step.columns) | numbers | effort | slope_columns(step)
    return {name: float(n) if isinstance(n, float) else int(n) for name, n in every.items()}


def _vectors(name: str, contact: ContactState, axisymmetric: bool) -> dict[str, float]:
    """Components of the resultant, its moment and tangential part, and of the mean slip, weighted by pressure."""
    tangential = contact.weight @ contact.traction
    pressing = contact.weight * np.abs(contact.pressure)
    touches = contact.contact_area > 0 and pressing.sum() > 0
    slip = pressing @ contact.slip / (pressing.sum() if touches else np.nan)
    if axisymmetric:  # over the full circle the radial parts balance
        tangential = tangential * [0, 1]
    vectors = {"force": contact.force, "tangential_force": tangential, "slip": slip, "moment": contact.moment}
    return _columns(name, vectors)


def _columns(name: str, vectors: Mapping[str, Array]) -> dict[str, float]:
    """Components of vectors of a contact, by column."""
    shapes = {key: numbers_of(ContactNumbers)["moment" if key == "moment" else "force"] for key in vectors}
    return {
        column: float(x)
        for key, vector in vectors.items()
        for column, x in zip(flat_names("contacts", name, key, shapes[key], len(vector)), vector, strict=True)
    }
