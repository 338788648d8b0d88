"""Columns of steps.csv: which values in time it lists, under which names, and how it is read back."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import MachineError
from stickslip.solvers.scene.timeline import Place
from stickslip.workflows.formats.csv_tables import read_table

NAME = "steps.csv"
PRESCRIBED = {  # by table; the displacement of an obstacle is among the results: a force may drive it
    "supports": ("displacement",),
    "loads": ("pressure", "traction", "force"),
    "obstacles": ("rotation",),
    "contacts": ("friction",),
}


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
    header, rows = read_table(folder / NAME)
    try:
        table = np.array([[cell or "nan" for cell in row] for row in rows], float).reshape(len(rows), len(header))
    except ValueError as error:
        raise MachineError(f"{folder / NAME}: cannot be read: {error}") from error
    return dict(zip(header, table.T, strict=True))
