"""contact_NAME.csv: the points of a contact surface, one row a step and point."""

from __future__ import annotations

from collections.abc import Iterator

from stickslip.solvers.results.step_result import StepResult
from stickslip.workflows.formats.csv_tables import Table
from stickslip.workflows.writers.tables import TableWriter


class ContactTables(TableWriter):
    """A table a contact."""

    def names(self) -> list[str]:
        return [contact_table(name) for name in self.job.scene.contacts]

    def tables(self, index: int, result: StepResult) -> Iterator[Table]:
        for name, contact in result.contacts.items():
            columns = contact.columns()
            rows = [(float(result.time), *row) for row in zip(*(c.tolist() for c in columns.values()), strict=True)]
            yield Table(contact_table(name), ["time", *columns], rows)


def contact_table(contact: str) -> str:
    """Name of its table.

    >>> contact_table("base")
    'contact_base.csv'
    """
    return f"contact_{contact}.csv"
