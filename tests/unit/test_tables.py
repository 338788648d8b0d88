"""Tables of steps and runs tell what was prescribed and what came of it."""

from __future__ import annotations

import csv
import dataclasses
import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from rich.console import Console
from rich.table import Table

import stickslip
from shared.synthetic import job_of, mesh_of, result_of
from stickslip.geometry.errors import MachineError
from stickslip.solvers.results.step_result import PARTS, MeshData, StepResult, values
from stickslip.workflows.formats.csv_tables import read_steps_table
from stickslip.workflows.formats.marker import MARKER, mark
from stickslip.workflows.formats.results import legend
from stickslip.workflows.run.terminal import console, contact_cells, print_table
from stickslip.workflows.writers.tables import ContactTables, HistoryTable, ProbeTable, StepsTable, steps_row
from stickslip.workflows.writers.writer import Ended, Writer


@pytest.fixture(scope="module")
def scene() -> stickslip.Scene:
    """The block's two steps, pressed by a load too, with a plane that turns away underneath what does not touch it."""
    block = stickslip.read("block", ["geometry.mesh_size=1.0", "geometry.contact_mesh_size=0.5"])
    far = stickslip.Plane(
        point=(0.0, -9.0), normal=(0.0, 1.0), rotation=stickslip.Rotation(angle=((2.0, 0.1),), point=(0.0, -9.0))
    )
    loads = {
        "wind": stickslip.Load(boundary="block.left", traction=(((1.0, 1e-3),), 0.0)),
        "rain": stickslip.Load(boundary="block.right", pressure=((2.0, 1e-3),)),
    }
    return replace(block, obstacles={**block.obstacles, "far": far}, loads=loads)


@pytest.fixture(scope="module")
def steps(scene: stickslip.Scene) -> list[StepResult]:
    return list(stickslip.steps(scene))


def table_of(folder: Path, scene: stickslip.Scene) -> StepsTable:
    return StepsTable(replace(job_of(folder, mesh_of("triangle")), scene=scene))


def test_a_row_tells_what_is_prescribed_and_what_comes_of_it(
    scene: stickslip.Scene, steps: list[StepResult], tmp_path: Path
) -> None:
    for index, step in enumerate(steps, start=1):
        table_of(tmp_path, scene).step(index, step)
    found = read_steps_table(tmp_path)
    assert list(found)[:2] == ["step", "time"]
    assert_array_equal(found["step"], [1, 2])
    assert_array_equal(found["time"], [1.0, 2.0])
    assert_array_equal(found["support.top.displacement.x"], [0.0, 0.05])
    assert_array_equal(found["support.top.displacement.y"], [-0.1, -0.1])
    assert_array_equal(found["load.wind.traction.x"], [1e-3, 1e-3])
    assert_array_equal(found["load.wind.traction.y"], [0.0, 0.0])
    assert_array_equal(found["load.rain.pressure"], [5e-4, 1e-3])
    assert_array_equal(found["obstacle.far.rotation.angle"], [0.05, 0.1])
    for k, step in enumerate(steps):  # the same bits as in result.json
        assert {name: found[name][k] for name in values(step)} == values(step)
        assert_array_equal([found[f"base.force.{a}"][k] for a in "xy"], step.contacts["base"].force)
        assert found["support.top.moment.z"][k] == step.supports["top"][1][0]
        assert found["iterations"][k] == step.iterations
    # of a flat side all the tangential force is the resultant's, with its sign: the top is pushed to the right
    # 1e-13: where one is the sum of what the other is the length of, rounding differs from machine to machine
    assert_allclose(np.abs(found["base.tangential_force.x"]), found["base.tangential_force"], rtol=1e-13)
    assert_allclose(found["base.tangential_force.x"], found["base.force.x"], rtol=1e-12)
    assert found["base.tangential_force.x"][1] < 0 < found["base.slip.x"][1] < 0.05


def test_gravity_and_a_given_bound_are_prescribed_too(scene: stickslip.Scene, steps: list[StepResult]) -> None:
    heavy = stickslip.Material(E=1.0, nu=0.3, density=1.0)
    bounded = replace(scene.contacts["base"], friction=stickslip.Tresca(bound=((0.0, 0.4), (2.0, 0.2))))
    other = replace(
        scene,
        bodies={"block": heavy},
        contacts={"base": bounded},
        sections={"gravity": stickslip.Gravity(acceleration=(0.0, ((2.0, -1.0),)))},
    )
    row = steps_row(1, other, steps[0])
    assert row["contact.base.friction.bound"] == pytest.approx(0.3, rel=1e-14)
    assert (row["gravity.acceleration.x"], row["gravity.acceleration.y"]) == (0.0, -0.5)


def test_mean_slip_is_that_of_what_presses(scene: stickslip.Scene, steps: list[StepResult], tmp_path: Path) -> None:
    base = steps[1].contacts["base"]
    half = replace(
        base, pressure=np.where(base.slip[:, 0] > 1e-3, 2.0, 0.0), slip=np.tile([0.01, 0.0], (len(base.slip), 1))
    )
    row = steps_row(1, scene, replace(steps[1], contacts={"base": half}))
    assert row["base.slip.x"] == pytest.approx(0.01, rel=1e-14)
    force = base.weight * np.arange(1.0, 1 + len(base.weight))  # pressures by 1, 2, ...: ends count for half a facet
    uneven = replace(half, pressure=force / base.weight, slip=base.points - base.points.mean(axis=0))
    row = steps_row(1, scene, replace(steps[1], contacts={"base": uneven}))
    assert row["base.slip.x"] == pytest.approx(float(force @ uneven.slip[:, 0] / force.sum()), rel=1e-12)
    lifted = replace(half, pressure=0 * half.pressure)
    touching_by_rounding = replace(half, pressure=1e-20 * half.pressure, contact_area=0.0)
    for index, open_one in enumerate((lifted, touching_by_rounding), start=1):  # no slip: not one of 0
        table_of(tmp_path, scene).step(index, replace(steps[1], contacts={"base": open_one}))
    header, *rows = list(csv.reader((tmp_path / "steps.csv").read_text().splitlines()))
    assert [(row[header.index("base.slip.x")], row[header.index("base.slip.y")]) for row in rows] == [("", "")] * 2
    found = read_steps_table(tmp_path)
    empty = {name for name, values in found.items() if np.isnan(values).any()}
    assert empty == {"base.slip.x", "base.slip.y"}
    assert_array_equal(read_steps_table(tmp_path)["base.slip.x"], [np.nan, np.nan])


def test_a_table_that_is_missing_or_damaged_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match=r"steps\.csv: cannot be read"):
        read_steps_table(tmp_path)
    (tmp_path / "steps.csv").write_text("step,time\n1,0.5\n2\n")
    with pytest.raises(MachineError, match=r"steps\.csv: cannot be read"):
        read_steps_table(tmp_path)


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


HEADS = ("contact", "normal force [N]", "touching [m²]", "max penetration [m]")
ROW = ("base", "-1.2346e-10", "1.2346e-06", "-6.9389e-17")


def printed(width: int) -> str:
    table = Table()
    for head in HEADS:
        table.add_column(head)
    table.add_row(*ROW)
    out = Console(file=io.StringIO(), width=width, highlight=False, markup=False)
    print_table(table, out)
    return out.file.getvalue()


def test_units_are_no_markup(capsys: pytest.CaptureFixture[str]) -> None:
    console(100).print("touching [m²], gap [m]")
    assert capsys.readouterr().out == "touching [m²], gap [m]\n"


@pytest.mark.parametrize("width", range(10, 90, 5))
def test_a_narrow_window_leaves_columns_out_and_cuts_no_number(width: int) -> None:
    text = printed(width)
    shown = [number for number in ROW if number in text]
    assert shown == list(ROW[: len(shown)])
    assert len(shown) == text.splitlines()[0].count("┳") + 1
    if width >= 15:
        assert "…" not in text
        assert max(map(len, text.splitlines())) <= width
    assert len(shown) == 4 or width < 60


def test_a_wide_window_keeps_heads_on_one_line() -> None:
    assert all(head in printed(90) for head in HEADS)


def test_a_penetration_of_rounding_is_zero() -> None:
    contact = {"max_penetration": 1e-17, "error": {"max_penetration": {"mesh": 2e-17, "converges": True}}}
    assert contact_cells(contact, ["max_penetration"], moved=0.1) == ["0"]
    assert contact_cells(contact, ["max_penetration"], moved=1e-6) == ["(1 ± ≥2)e-17"]


WHOLE = dict.fromkeys(PARTS, 0.0) | {"converges": True}
STOPPED = WHOLE | {"mesh": None, "lacking": {"mesh": 3.0}}  # as of an interrupted run


@pytest.mark.parametrize(
    ("error", "asked", "cell", "said"),
    [
        (WHOLE, True, "4", None),
        (WHOLE | {"mesh": 0.02}, True, "4.00 ± 0.02", None),
        (STOPPED, True, "4 ± ?", "± ≥, ± ?: without the error of the mesh (3 times the run)"),
        (STOPPED | {"law": 0.02}, "rough", "4.00 ± ≥0.02", "± ≥, ± ?: without the error of the mesh (3 times the run)"),
        (STOPPED | {"lacking": {}}, True, "4 ± ?", "± ?: not estimated, the mesh's part cannot be told"),
        (WHOLE | {"mesh": None, "converges": False}, True, "4 (grows)", "grows: has no limit on ever finer meshes"),
        (None, False, "4 ± ?", "± ?: not estimated, output.error = false"),
        (None, True, "4 ± ?", "± ?: not estimated, the run has left no estimates"),
    ],
)
def test_a_number_alone_is_exact_and_else_a_line_says_why_it_has_no_error(
    error: dict[str, Any] | None, asked: bool | str, cell: str, said: str | None
) -> None:
    contact = {"normal_force": 4.0, "error": error and {"normal_force": error}}
    assert contact_cells(contact, ["normal_force"]) == [cell]
    step = {"contacts": {"base": contact, "open": None}, "energy": {"stored": 1.0, "error": {"stored": WHOLE}}}
    one = step if error else {"contacts": {"base": contact}}
    found = legend({"scene": {"output": {"error": asked}}, "steps": [one]})
    assert found.startswith("without ±: exact in the digits shown")
    assert found.count(";") == (said is not None)
    assert (said or "") in found
