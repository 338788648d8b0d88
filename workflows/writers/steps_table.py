"""steps.csv: one row a reported step: what the scene prescribes at that time, and the resultants, energies and cost."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from geometry.amplitude import value_at
from geometry.arrays import Array
from geometry.errors import MachineError
from solvers.results.quantities import values
from solvers.results.step_result import ContactState, StepResult
from solvers.scene.quantities import CONTACT_NUMBERS, ENERGIES
from solvers.scene.scene import Scene
from solvers.scene.timeline import Place
from workflows.writers.tables import Table, TableWriter, read_table

NAME = "steps.csv"
DRIVEN = {  # what is prescribed, by table; the displacement of an obstacle is among the results: a force may drive it
    "supports": ("displacement",),
    "loads": ("pressure", "traction", "force"),
    "obstacles": ("rotation",),
    "contacts": ("friction",),
    "gravity": ("acceleration",),
}
EFFORT = ("substeps", "iterations", "volume_solves", "residual")


class StepsTable(TableWriter):
    """One row a step; what has no value then is an empty cell."""

    def names(self) -> list[str]:
        return [NAME]

    def tables(self, index: int, result: StepResult) -> Iterator[Table]:
        row = steps_row(index, self.job.scene, result)
        yield Table(NAME, list(row), [["" if np.isnan(n) else n for n in row.values()]])


def column(place: Place) -> str:
    """Name of the column of a prescribed value.

    >>> column(Place("contacts", "base", "friction", "bound"))
    'contact.base.friction.bound'
    """
    return str(place).replace("s.", ".", 1) if place.name else str(place)


def steps_row(index: int, scene: Scene, step: StepResult) -> dict[str, float]:
    """By column: SI units; resultants act on the slave side; NaN: the mean slip where nothing touches."""
    found: dict[str, float] = {"step": index, "time": step.time}
    for place, amplitude in scene.drives().items():
        if place.table in DRIVEN and place.quantity in DRIVEN[place.table]:
            found[column(place)] = value_at(amplitude, step.time, scene.steps.end)
    numbers = values(step)
    for name, contact in step.contacts.items():
        found |= {f"{name}.{key}": numbers.pop(f"{name}.{key}") for key in CONTACT_NUMBERS}
        found |= _vectors(name, contact, scene.axisymmetric)
    energies = {key: numbers.pop(key) for key in (f"energy.{key}" for key in ENERGIES)}
    for name, (_, moment) in step.supports.items():
        numbers |= _moment(f"support.{name}", moment)
    for name, (_, _, moment) in step.obstacles.items():
        numbers |= _moment(f"obstacle.{name}", moment)
    effort = {key: getattr(step, key) for key in EFFORT}
    return {
        name: float(n) if isinstance(n, float) else int(n) for name, n in (found | numbers | energies | effort).items()
    }


def read_steps_table(folder: Path) -> dict[str, Array]:
    """The columns of steps.csv, each with a value a step; an empty cell is NaN.

    Raises:
        MachineError: it is missing or damaged.
    """
    header, rows = read_table(folder / NAME)
    try:
        table = np.array([[cell or "nan" for cell in row] for row in rows], float).reshape(len(rows), len(header))
    except ValueError as error:
        raise MachineError(f"{folder / NAME}: cannot be read: {error}") from error
    return dict(zip(header, table.T, strict=True))


def _vectors(name: str, contact: ContactState, axisymmetric: bool) -> dict[str, float]:
    """Components of the resultant, of its tangential part, and of the mean slip, weighted by pressure."""
    tangential = contact.weight @ contact.traction
    pressing = contact.weight * np.abs(contact.pressure)
    touches = contact.contact_area > 0 and pressing.sum() > 0
    slip = pressing @ contact.slip / (pressing.sum() if touches else np.nan)
    if axisymmetric:  # over the full circle the radial parts balance
        tangential = tangential * [0, 1]
    vectors = {"force": contact.force, "tangential_force": tangential, "slip": slip}
    return {
        f"{name}.{key}.{axis}": float(x)
        for key, vector in vectors.items()
        for axis, x in zip("xyz", vector, strict=False)
    }


def _moment(name: str, moment: Array) -> dict[str, float]:
    axes = "z" if len(moment) == 1 else "xyz"
    return {f"{name}.moment.{axis}": float(value) for axis, value in zip(axes, moment, strict=True)}
