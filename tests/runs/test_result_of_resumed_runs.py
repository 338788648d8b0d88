"""What result.json and the ending of a run say where a part of it was solved before; and rounds from Python."""

from pathlib import Path

import numpy as np
import pytest

import stickslip
from shared.command import result
from shared.histories import SMALL, Stop
from stickslip.workflows.accuracy.rounds import aiming
from stickslip.workflows.run.run import Run, run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

TWO = [*SMALL, "steps.count=2"]


@pytest.mark.parametrize(("first", "then"), [(True, False), (False, True)])
def test_error_is_not_known_where_that_of_a_step_is_not(first: bool, then: bool, tmp_path: Path) -> None:
    def scene(error: bool) -> stickslip.Scene:
        return read("block", [*TWO, f"output.error={str(error).lower()}"])

    run(scene(first), tmp_path / "out", Watch(on_step=Stop(1)))
    assert run(scene(then), tmp_path / "out", resume=True)[0].status == "converged"
    found = result(tmp_path / "out")
    known = [step["error"]["energy_norm"]["mesh"] is not None for step in found["steps"]]
    assert known == [first, then]
    assert found["error"]["discretisation"] is None
    assert np.isfinite(found["error"]["iteration"])


def test_finished_run_that_is_resumed_has_its_warnings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = read("block", [*TWO, "output.error=false"])
    monkeypatch.setattr(Run, "_warnings", lambda self: ("the block is odd",))
    first, content = run(scene, tmp_path / "out")
    again, _ = run(scene, tmp_path / "out", resume=True)
    assert "the block is odd" in first.warnings
    assert list(again.warnings) == content["warnings"]
    assert "the block is odd" in again.warnings


def test_python_runs_rounds_towards_the_goals_of_a_scene(tmp_path: Path) -> None:
    lines = list[str]()
    scene = aiming(read("block", TWO), ["base.normal_force=30%"], None)
    outcome, content = stickslip.run(scene, tmp_path / "out", Watch(on_round=lines.append))
    assert outcome.status == "converged"
    assert content["accuracy"]["met"]
    assert result(tmp_path / "out")["accuracy"]["rounds"] == content["accuracy"]["rounds"]
    assert len([line for line in lines if line.startswith("round ")]) == len(content["accuracy"]["rounds"])
    again, _ = stickslip.run(scene, tmp_path / "out", resume=True)
    assert "the rounds are finished" in again.sentence


def test_without_goals_or_with_a_judge_of_ones_own_it_is_one_run(tmp_path: Path) -> None:
    scene = read("block", [*TWO, "output.error=false"])
    assert "accuracy" not in stickslip.run(scene, tmp_path / "plain")[1]
    aimed = aiming(read("block", TWO), ["base.normal_force=30%"], None)
    assert "accuracy" not in stickslip.run(aimed, tmp_path / "judged", keep=lambda *told: True)[1]
