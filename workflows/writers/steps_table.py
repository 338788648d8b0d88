"""steps.csv: one row a reported step: what the scene prescribes at that time, and the resultants, energies and cost."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stickslip.geometry.amplitude import value_at
from stickslip.solvers.results.step_result import ContactState, Errors, StepResult, total_errors, values
from stickslip.solvers.scene.record import CONTACT_NUMBERS, ContactNumbers, flat_names, numbers_of
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.formats.csv_tables import STEPS_TABLE, Table, column, is_prescribed, write_tables_again
from stickslip.workflows.writers.tables import TableWriter
from stickslip.workflows.writers.writer import Ended


class StepsTable(TableWriter):
    """One row a step; what has no value then is an empty cell."""

    def names(self) -> list[str]:
        return [STEPS_TABLE]

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
    return Table(STEPS_TABLE, list(row), [["" if np.isnan(n) else n for n in row.values()]])


def errors_row(step: StepResult, errors: Errors) -> dict[str, float]:
    """Total errors of one step's numbers by column; NaN: not known."""
    return {f"{name}.error": value for name, value in total_errors(step, errors).items()}


def steps_row(index: int, scene: Scene, step: StepResult) -> dict[str, float]:
    """By column, in SI units; NaN: the mean slip where nothing touches.

    Resultants act on the side that the scene calls `surface`.
    """
    found: dict[str, float] = {"step": index, "time": step.time}
    for place, amplitude in scene.drives().items():
        if is_prescribed(place):
            found[column(place)] = value_at(amplitude, step.time, scene.steps.end)
    numbers = values(step)
    for name, contact in step.contacts.items():
        found |= {f"{name}.{key}": numbers.pop(f"{name}.{key}") for key in CONTACT_NUMBERS}
        found |= _vectors(name, contact, scene.axisymmetric)
    effort = {key: getattr(step, key) for key in numbers_of(StepResult) if key != "time"}
    every = found | dict(step.columns) | numbers | effort
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
    shapes = {key: numbers_of(ContactNumbers)["moment" if key == "moment" else "force"] for key in vectors}
    return {
        column: float(x)
        for key, vector in vectors.items()
        for column, x in zip(flat_names("contacts", name, key, shapes[key], len(vector)), vector, strict=True)
    }
