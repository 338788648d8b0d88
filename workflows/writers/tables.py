"""Writers of tables for spreadsheets and scripts, in columns with names.

A step's rows are written before its file: whatever a crash leaves beyond the last step's file is then surplus, and
`resume` takes it away.
"""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Iterable, Sequence

from stickslip.solvers.results.step_result import StepResult
from stickslip.workflows.formats.aside import disk_errors
from stickslip.workflows.formats.csv_tables import Table, append_tables, write_tables_again
from stickslip.workflows.writers.writer import Ended, Turn, Writer


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
