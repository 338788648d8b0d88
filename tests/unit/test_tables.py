"""Tables read back to the same bits."""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from shared.synthetic import job_of, mesh_of, result_of
from stickslip.geometry.errors import MachineError
from stickslip.solvers.results.step_result import MeshData
from stickslip.workflows.formats.marker import MARKER, mark
from stickslip.workflows.writers.tables import ContactTables, HistoryTable, ProbeTable
from stickslip.workflows.writers.writer import Ended, Writer

NAMES = ("contact_base.csv", "probes.csv", "history.csv")


def writers_of(folder: Path, mesh: MeshData) -> list[Writer]:
    return [kind(job_of(folder, mesh)) for kind in (ContactTables, ProbeTable, HistoryTable)]


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("shape", ["quadrilateral", "tetrahedron"])
def test_tables_read_back_to_the_same_bits(tmp_path: Path, shape: str) -> None:
    mesh = mesh_of(shape)
    results = [result_of(mesh, time, seed) for seed, time in enumerate((1 / 3, 2 / 3))]
    for writer in writers_of(tmp_path, mesh):
        for index, result in enumerate(results, start=1):
            writer.step(index, result)
    axes, n = "xyz"[: mesh.points.shape[1]], len(mesh.surfaces["base"][0])
    table = rows_of(tmp_path / "contact_base.csv")
    assert len(table) == 2 * n
    for k, result in enumerate(results):
        rows, contact = table[k * n : (k + 1) * n], result.contacts["base"]
        for name in ("weight", "gap", "pressure"):
            assert_array_equal([float(row[name]) for row in rows], getattr(contact, name))
        vectors = {"traction": "traction", "slip": "slip", "slip_increment": "slip_increment", "lambda": "lam"}
        for column, name in vectors.items():
            found = [[float(row[f"{column}_{a}"]) for a in axes] for row in rows]
            assert_array_equal(found, getattr(contact, name))
        assert_array_equal([[float(row[a]) for a in axes] for row in rows], mesh.surfaces["base"][0])
        assert {float(row["time"]) for row in rows} == {result.time}
        assert [row["status"] for row in rows][:3] == ["open", "slip", "stick"]
    probe = rows_of(tmp_path / "probes.csv")[1]
    displacement, stress = results[1].probes["corner"]
    assert (float(probe["time"]), probe["probe"]) == (results[1].time, "corner")
    assert_array_equal([float(probe[f"displacement_{a}"]) for a in axes], displacement)
    assert float(probe["stress_xy"]) == stress[0, 1]
    assert float(probe["stress_zz"]) == stress[2, 2]
    history = rows_of(tmp_path / "history.csv")
    assert [row["step"] for row in history] == ["1", "1", "2", "2"]
    assert history[3] == {
        "step": "2",
        "time": repr(2 / 3),
        "iteration": "2",
        "residual": "1e-09",
        "volume_solves": "3",
        "seconds": repr(0.1 + 0.7),
        "method": "uzawa",
    }


def test_numbers_of_numpy_are_written_like_those_of_python(tmp_path: Path) -> None:
    mesh = mesh_of("triangle")
    counted: Any = ((np.float64(0.1), np.int64(2), np.float32(0.5), np.int64(3), 0.1, "uzawa"),)
    HistoryTable(job_of(tmp_path, mesh)).step(1, dataclasses.replace(result_of(mesh), history=counted))
    assert (tmp_path / "history.csv").read_text().splitlines()[1] == "1,0.1,2,0.5,3,0.1,uzawa"


def test_tables_are_written_again_from_the_steps_whatever_became_of_them(tmp_path: Path) -> None:
    mesh = mesh_of("triangle")
    mark(tmp_path)
    writers = writers_of(tmp_path, mesh)
    results = [result_of(mesh, time) for time in (1 / 3, 2 / 3)]
    for writer in writers:
        for index, result in enumerate(results, start=1):
            writer.step(index, result)
    before = {name: (tmp_path / name).read_bytes() for name in NAMES}
    for writer in writers:
        writer.step(3, result_of(mesh, 1.0))  # a step that was not kept
    (tmp_path / NAMES[0]).write_bytes(before[NAMES[0]][:99])  # with a hole
    (tmp_path / NAMES[1]).unlink()
    (tmp_path / "contact_mine.csv").write_text("a user's own")
    for writer in writers_of(tmp_path, mesh):
        writer.resume(results)
        writer.finish(Ended(status="converged", steps=results))
    assert {name: (tmp_path / name).read_bytes() for name in NAMES} == before
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*NAMES, "contact_mine.csv", MARKER])
    for writer in writers_of(tmp_path, mesh):
        writer.resume([])  # no step was kept
    assert {path.name for path in tmp_path.iterdir()} == {"contact_mine.csv", MARKER}


def test_the_iterations_of_a_step_that_failed_are_told_until_it_is_tried_again(tmp_path: Path) -> None:
    mesh = mesh_of("triangle")
    result, table = result_of(mesh), HistoryTable(job_of(tmp_path, mesh))
    table.step(1, result)
    before = (tmp_path / "history.csv").read_bytes()
    table.failed(2, [(0.7, 1, 0.5, 4, 0.1, "uzawa")])
    assert rows_of(tmp_path / "history.csv")[-1]["step"] == "2"
    HistoryTable(job_of(tmp_path, mesh)).resume([result])
    assert (tmp_path / "history.csv").read_bytes() == before


def test_a_table_that_cannot_grow_is_said(tmp_path: Path) -> None:
    mesh = mesh_of("triangle")
    (tmp_path / "contact_base.csv").mkdir()
    with pytest.raises(MachineError, match=r"contact_base\.csv: cannot be written: Is a directory"):
        ContactTables(job_of(tmp_path, mesh)).step(1, result_of(mesh))
