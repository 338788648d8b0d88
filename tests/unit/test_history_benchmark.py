"""The benchmark of a long history: every phase is timed, and together they are the whole."""

from pathlib import Path

import pytest

from geometry.amplitude import value_at
from workflows.benchmarks import history

STEPS, POINTS = 4 * history.CYCLES + 1, 9


def test_phases_make_up_the_whole(tmp_path: Path) -> None:
    cost = history.measure(STEPS, POINTS, "auto", tmp_path / "run")
    total = cost.seconds["total"]
    assert cost.points == POINTS
    assert sum(cost.seconds.values()) == pytest.approx(2 * total)
    assert min(cost.seconds[phase] for phase in (*history.PHASES, "mesh", "prepare", "iterate")) > 0
    assert 0 <= cost.seconds["other"] < total
    ((seconds, iterations, solves),) = cost.blocks
    assert 0 < STEPS * seconds < total
    assert iterations > 0 < solves
    lines = list(cost.lines())
    assert [line.split()[0] for line in lines[2 : 2 + len(cost.seconds)]] == [p.split()[0] for p in cost.seconds]


@pytest.mark.parametrize("steps", [STEPS, 1000])
def test_the_history_goes_to_and_fro_in_whole_steps(steps: int) -> None:
    scene = history.scene(steps, POINTS)
    assert len(scene.requested_times()) == steps
    shear = scene.supports["grip"].displacement["x"]
    values = [value_at(shear, time, scene.steps.end) for time in scene.requested_times()]
    turns = sum(abs(value) == pytest.approx(history.AMPLITUDE) for value in values)
    assert turns == 2 * history.CYCLES
