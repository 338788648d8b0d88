"""Slip and its rate over place and time: drawn where friction knows its rate, and a column of the tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.command import result, table
from stickslip.workflows.pictures.slip_course import _line
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import read

CLOCK = "steps={end=130,clock={error=1e-3,smallest=1e-9,largest=50.0,every=9}}"


def test_a_slider_has_its_rate_in_tables_and_its_course_drawn(tmp_path: Path) -> None:
    run(read("spring_slider", ["geometry.mesh_size=1.0", CLOCK, "output.error=false"]), tmp_path / "out")
    found = table(tmp_path / "out" / "contact_base.csv")
    steps = result(tmp_path / "out")["steps"]
    assert len(steps) >= 3
    for step in steps:
        rates = [float(row["rate"]) for row in found if float(row["time"]) == pytest.approx(step["time"], rel=1e-9)]
        assert_allclose(max(rates), step["contacts"]["base"]["slip_rate"], rtol=1e-8)
    assert (tmp_path / "out" / "slip_base.png").stat().st_size > 10_000
    assert "/contacts/base/rate" in (tmp_path / "out" / "contact_base.xdmf").read_text()


def test_friction_that_knows_no_rate_has_neither(tmp_path: Path) -> None:
    run(read("block", ["geometry.mesh_size=1.0", "output.error=false"]), tmp_path / "out")
    assert "rate" not in table(tmp_path / "out" / "contact_base.csv")[0]
    assert not list((tmp_path / "out").glob("slip_*.png"))


def test_a_strip_in_space_is_a_line_and_a_wide_surface_is_none() -> None:
    x, y = (each.ravel() for each in np.meshgrid([0.0, 1.0, 3.0], [0.0, 0.5], indexing="ij"))
    strip = np.column_stack([0 * x, y, x])
    found = _line(strip, np.zeros((0, 4), np.int64))
    assert found is not None
    place, mean, label = found
    assert label == "z [m]"
    assert_allclose(place, [0.0, 1.0, 3.0])
    assert_allclose(mean @ np.arange(6.0), [0.5, 2.5, 4.5])
    grid = np.column_stack([each.ravel() for each in np.meshgrid(np.arange(5.0), np.arange(4.0))])
    assert _line(np.pad(grid, ((0, 0), (0, 1))), np.zeros((0, 4), np.int64)) is None
