"""history.csv: the iterations of every step, those of a step that failed too."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.stepping.history import HistoryTuple
from stickslip.workflows.formats.csv_tables import Table, append_tables, python_numbers
from stickslip.workflows.writers.tables import TableWriter

NAME = "history.csv"
HEADER = ("step", "time", "iteration", "residual", "volume_solves", "seconds", "method")  # see `HistoryRow`


class HistoryTable(TableWriter):
    """One row an iteration."""

    def names(self) -> list[str]:
        return [NAME]

    def tables(self, index: int, result: StepResult) -> Iterator[Table]:
        yield history_table(index, result.history)

    def failed(self, index: int, history: Sequence[HistoryTuple]) -> None:
        append_tables(self.job.folder, [history_table(index, history)])


def history_table(index: int, history: Iterable[HistoryTuple]) -> Table:
    """Rows of the iterations of a step."""
    return Table(NAME, HEADER, [(int(index), *python_numbers(row)) for row in history])
