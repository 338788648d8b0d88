"""The benchmark of a long history: every phase has its line, and there is something to solve."""

from pathlib import Path

import pytest

from stickslip.geometry.amplitude import value_at
from stickslip.workflows.formats.steps_csv import read_steps_table
from stickslip.workflows.lab.benchmarks import history

STEPS, POINTS = 4 * history.CYCLES + 1, 9


def test_a_line_tells_of_each_phase_of_a_history_that_slips_to_and_fro(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(history, "CYCLES", 1)
    cost = history.measure(5, POINTS, "auto", tmp_path / "run")
    assert cost.points == POINTS
    assert set(cost.seconds) >= {*history.PHASES, "mesh", "prepare", "iterate", "other", "total"}
    lines = list(cost.lines())
    assert [line.split()[0] for line in lines[2 : 2 + len(cost.seconds)]] == [p.split()[0] for p in cost.seconds]
    slip = read_steps_table(tmp_path / "run")["base.slip.x"]
    assert min(slip) < 0 < max(slip)


@pytest.mark.parametrize("steps", [STEPS, 1000])
def test_the_history_goes_to_and_fro_in_whole_steps(steps: int) -> None:
    scene = history.scene(steps, POINTS)
    assert len(scene.requested_times()) == steps
    shear = scene.supports["grip"].displacement["x"]
    values = [value_at(shear, time, scene.steps.end) for time in scene.requested_times()]
    turns = sum(abs(value) == pytest.approx(history.AMPLITUDE) for value in values)
    assert turns == 2 * history.CYCLES
