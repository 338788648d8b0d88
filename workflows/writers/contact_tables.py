"""contact_NAME.csv: the points of a contact surface, one row a step and point."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.results.step_result import StepResult
from stickslip.workflows.formats.contact_line import walk
from stickslip.workflows.formats.csv_tables import Table
from stickslip.workflows.writers.tables import TableWriter


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
