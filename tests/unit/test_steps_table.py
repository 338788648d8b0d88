"""steps.csv: one row a step, in columns that say what they are."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import stickslip
from shared.synthetic import job_of, mesh_of
from stickslip.geometry.errors import MachineError
from stickslip.solvers.results.step_result import StepResult, values
from stickslip.workflows.formats.steps_csv import read_steps_table
from stickslip.workflows.writers.steps_table import StepsTable, steps_row


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
