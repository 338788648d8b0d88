"""probes.csv: displacement and stress at points of the bodies, one row a step and probe."""

from __future__ import annotations

from collections.abc import Iterator

from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.record import STRESSES
from stickslip.workflows.formats.csv_tables import Row, Table, python_numbers
from stickslip.workflows.writers.tables import TableWriter

NAME = "probes.csv"


class ProbeTable(TableWriter):
    """One table for all probes; none where the scene has none."""

    def names(self) -> list[str]:
        return [NAME]

    def tables(self, index: int, result: StepResult) -> Iterator[Table]:
        if result.probes:
            yield Table(NAME, probe_header(self.job.mesh.points.shape[1]), probe_rows(result))


def probe_header(dim: int) -> list[str]:
    """Names of the columns."""
    return ["time", "probe", *(f"displacement_{a}" for a in "xyz"[:dim]), *(f"stress_{ij}" for ij in STRESSES)]


def probe_rows(result: StepResult) -> list[Row]:
    """One row a probe."""
    return [
        (float(result.time), name, *python_numbers(displacement), *(float(stress[ij]) for ij in STRESSES.values()))
        for name, (displacement, stress) in result.probes.items()
    ]
