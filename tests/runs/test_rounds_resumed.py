"""Rounds that were stopped go on where they were: no finished round is solved again, and the answer is the same."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import stickslip.workflows.accuracy.rounds
from stickslip.geometry.errors import FolderError, SceneError
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.accuracy.rounds import Rounds, aiming
from stickslip.workflows.run.folder import ResultsFolder
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

SIZES = ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.5", "output.pictures=false"]


def scene(goal: str = "base.normal_force=0.5%", *sets: str) -> Scene:
    return aiming(read("block", [*SIZES, *sets]), [goal], None)


def solved(folder: Path, watch: Watch | None = None, resume: bool = False, of: Scene | None = None) -> Any:
    """Rounds, outcome, and content of result.json."""
    rounds = Rounds(of or scene(), lambda line: None)
    return rounds, *rounds(folder / "out", watch or Watch(), resume)


def stopping(after: int) -> Callable[[StepResult], None]:
    """Ctrl-C after so many steps of all rounds together."""
    left = iter(range(after))

    def stop(step: StepResult) -> None:
        if next(left, None) is None:
            raise KeyboardInterrupt

    return stop


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[Scene]:
    """Scenes that are solved or gone on with, in their order."""
    found: list[Scene] = []

    def count(scene: Scene, *more: Any, **keys: Any) -> Any:
        found.append(scene)
        return run(scene, *more, **keys)

    monkeypatch.setattr(stickslip.workflows.accuracy.rounds, "run", count)
    return found


def told(content: dict[str, Any]) -> list[Any]:
    """All rounds, without their seconds."""
    return [{**one, "seconds": 0.0} for one in content["accuracy"]["rounds"]]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What rounds say that were not stopped."""
    found: dict[str, Any] = solved(tmp_path_factory.mktemp("whole"))[2]
    return found


@pytest.mark.parametrize("steps", [0, 3])  # the block has 2: in the first round, and in the second one
def test_rounds_go_on_where_they_were_stopped(
    steps: int, tmp_path: Path, counted: list[Scene], whole: dict[str, Any]
) -> None:
    assert len(whole["accuracy"]["rounds"]) == 2
    _, outcome, _ = solved(tmp_path, Watch(on_step=stopping(steps)))
    assert outcome.status == "interrupted"
    with pytest.raises(FolderError, match="go on with --resume"):
        solved(tmp_path)
    counted.clear()
    _, outcome, content = solved(tmp_path, resume=True)
    assert outcome.status == "converged"
    assert len(counted) == (1 if steps else 2)
    assert told(content) == told(whole)
    assert content["steps"][-1]["contacts"] == whole["steps"][-1]["contacts"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out"]
    counted.clear()
    _, outcome, again = solved(tmp_path, resume=True)
    assert "nothing was changed" in outcome.sentence
    assert (counted, again) == ([], content)


def test_a_crash_between_two_rounds_loses_neither(
    tmp_path: Path, counted: list[Scene], whole: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def die(folder: ResultsFolder) -> None:
        raise ZeroDivisionError  # the first round is judged, its steps still stand there

    with monkeypatch.context() as killed:
        killed.setattr(ResultsFolder, "abandon", die)
        with pytest.raises(ZeroDivisionError):
            solved(tmp_path)
    assert (tmp_path / ".out.running").exists()
    with pytest.raises(SceneError, match=r"contacts.base.friction.mu was 0.3"):
        solved(tmp_path, resume=True, of=scene("base.normal_force=0.5%", "contacts.base.friction.mu=0.4"))
    counted.clear()
    content = solved(tmp_path, resume=True)[2]
    assert len(counted) == 1
    assert told(content) == told(whole)


def test_a_larger_budget_goes_on_behind_the_last_round(tmp_path: Path, counted: list[Scene]) -> None:
    poor = aiming(scene(), [], 0.01)
    _, outcome, _ = solved(tmp_path, of=poor)
    assert outcome.status == "inaccurate"
    assert "--resume with a larger --budget" in outcome.sentence
    counted.clear()
    rounds, outcome, _ = solved(tmp_path, resume=True)
    assert (outcome.status, len(counted), len(rounds.done)) == ("converged", 1, 2)


def test_a_file_of_somebody_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / ".out.rounds").write_text("years of work")
    with pytest.raises(FolderError, match="holds no rounds"):
        solved(tmp_path)
    assert (tmp_path / ".out.rounds").read_text() == "years of work"
