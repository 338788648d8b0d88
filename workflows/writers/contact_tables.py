"""contact_NAME.csv: the points of a contact surface, one row a step and point."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.results.step_result import OPEN, SLIP, STICK, ContactState, StepResult
from stickslip.workflows.formats.csv_tables import Row, Table
from stickslip.workflows.writers.tables import TableWriter

STATUS = {OPEN: "open", SLIP: "slip", STICK: "stick"}


class ContactTables(TableWriter):
    """A table a contact."""

    def names(self) -> list[str]:
        return [contact_table(name) for name in self.job.scene.contacts]

    def tables(self, index: int, result: StepResult) -> Iterator[Table]:
        dim = self.job.mesh.points.shape[1]
        for name, contact in result.contacts.items():
            rows = contact_rows(result.time, self.job.mesh.surfaces[name][0], contact)
            yield Table(contact_table(name), contact_header(dim), rows)


def contact_table(contact: str) -> str:
    """Name of its table.

    >>> contact_table("base")
    'contact_base.csv'
    """
    return f"contact_{contact}.csv"


def contact_header(dim: int) -> list[str]:
    """Names of the columns."""
    vectors = [f"{name}_{a}" for name in ("traction", "slip", "slip_increment", "lambda") for a in "xyz"[:dim]]
    return ["time", *"xyz"[:dim], "weight", "gap", "pressure", *vectors, "status"]


def contact_rows(time: float, points: Array, contact: ContactState) -> list[Row]:
    """One row a point; points (n, d) [m]."""
    scalars = np.column_stack([contact.weight, contact.gap, contact.pressure])
    vectors = np.hstack([contact.traction, contact.slip, contact.slip_increment, contact.lam])
    numbers = np.hstack([points, scalars, vectors]).tolist()
    words = [STATUS[int(s)] for s in contact.status]
    return [(float(time), *row, word) for row, word in zip(numbers, words, strict=True)]
