"""steps.jsonl: a line a step, as in result.json, as soon as it is solved, and the same after an interruption."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from shared.command import result
from shared.histories import SMALL, Stop
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

TWO = [*SMALL, "steps.count=2", "output.jsonl=true"]


def lines(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "steps.jsonl").read_text(encoding="utf-8").splitlines()]


@pytest.mark.parametrize("errors", ["true", "false"])
def test_a_line_is_the_step_of_result_json(errors: str, tmp_path: Path) -> None:
    run(read("block", [*TWO, f"output.error={errors}"]), tmp_path / "out")
    steps = result(tmp_path / "out")["steps"]
    assert lines(tmp_path / "out") == [{key: value for key, value in s.items() if key != "audit"} for s in steps]
    assert (steps[0]["contacts"]["base"]["error"] is None) == (errors == "false")


def test_a_line_is_there_once_its_step_is_solved(tmp_path: Path) -> None:
    seen = list[int]()
    watch = Watch(on_step=lambda step: seen.append(len(lines(next(tmp_path.glob(".out.running"))))))
    run(read("block", TWO), tmp_path / "out", watch)
    assert seen == [1, 2]


@pytest.mark.parametrize("left", ["as it was", "lost", "with half a line more"])
def test_a_run_that_goes_on_has_the_lines_of_one_that_was_not_stopped(left: str, tmp_path: Path) -> None:
    run(read("block", TWO), tmp_path / "whole")
    run(read("block", TWO), tmp_path / "out", Watch(on_step=Stop(1)))
    file = tmp_path / "out" / "steps.jsonl"
    assert len(lines(tmp_path / "out")) == 1
    if left == "lost":
        file.unlink()
    elif left != "as it was":
        file.write_text(file.read_text() + '{"time": 3')
    run(read("block", TWO), tmp_path / "out", resume=True)
    assert file.read_bytes() == (tmp_path / "whole" / "steps.jsonl").read_bytes()


def test_a_scene_that_does_not_ask_for_it_has_none(tmp_path: Path) -> None:
    run(read("block", [*SMALL, "steps.count=1"]), tmp_path / "out")
    assert not (tmp_path / "out" / "steps.jsonl").exists()
