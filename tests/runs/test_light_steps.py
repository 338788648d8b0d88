"""output.step_files = "every": fields of every n-th step alone are stored; the run goes on from the last of them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_array_equal

import stickslip
from shared.command import Call, result
from shared.histories import SMALL, Stop, leaves, rows
from stickslip.geometry.errors import FolderError, MachineError
from stickslip.solvers.results.audit import Audit, Auditor
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.results.stored_fields import Record
from stickslip.workflows.formats.results import read_results
from stickslip.workflows.formats.steps import light_files, step_files
from stickslip.workflows.pictures.report_view import model
from stickslip.workflows.run.folder import BEGUN, work_of
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

LIGHT = ["output.step_files=every", "output.every=4"]  # of six steps


def scene(*more: str) -> Any:
    return read("block", [*SMALL, *more])


def files(folder: Path) -> tuple[list[int], list[int]]:
    """Steps with fields, and steps without."""
    return list(step_files(folder)), list(light_files(folder))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole") / "out"
    run(scene("output.every=4"), folder)
    return folder


@pytest.fixture(scope="module")
def light(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("light") / "out"
    outcome, _ = run(scene(*LIGHT, "output.vtu=true", "output.animation=gif"), folder)
    assert outcome.status == "converged"
    return folder


def assert_same_numbers(found: Path, expected: Path) -> None:
    """To the last bit, but for the audit, which has only the steps with fields."""
    ours, theirs = ([step | {"audit": None} for step in result(folder)["steps"]] for folder in (found, expected))
    assert dict(leaves(ours)) == dict(leaves(theirs))
    for name in ("steps.csv", "contact_base.csv", "history.csv"):
        assert rows(found / name) == rows(expected / name)


def test_fields_of_the_asked_steps_and_of_the_last_one_are_stored(light: Path, whole: Path) -> None:
    assert files(whole) == ([1, 2, 3, 4, 5, 6], [])
    assert files(light) == ([4, 6], [1, 2, 3, 5])
    size = {name: path.stat().st_size for folder in (light,) for name, path in step_files(folder).items()}
    assert max(path.stat().st_size for path in light_files(light).values()) < min(size.values()) / 2
    assert (light / "fields.xdmf").read_bytes() == (whole / "fields.xdmf").read_bytes()
    assert sorted(path.stem for path in (light / "vtu").glob("*.vtm")) == ["000004", "000006"]
    assert (light / "animation.gif").stat().st_size > 0


def test_all_numbers_are_those_of_a_run_that_stores_everything(light: Path, whole: Path) -> None:
    assert_same_numbers(light, whole)


def test_the_audit_has_the_steps_with_fields(light: Path, whole: Path) -> None:
    audits = [step["audit"] for step in result(light)["steps"]]
    assert [audit is not None for audit in audits] == [False, False, False, True, False, True]
    assert audits[3]["equilibrium"] == result(whole)["steps"][3]["audit"]["equilibrium"]
    assert result(light)["audit"]["equilibrium"] == max(audits[3]["equilibrium"], audits[5]["equilibrium"])


def test_results_are_read_back_with_and_without_fields(light: Path, whole: Path) -> None:
    ours, theirs = (stickslip.load(folder).steps for folder in (light, whole))
    assert len(ours) == len(theirs) == 6
    assert [len(step.displacement) > 0 for step in ours] == [False, False, False, True, False, True]
    for mine, other in zip(ours, theirs, strict=True):
        assert_array_equal(mine.contacts["base"].pressure, other.contacts["base"].pressure)


def test_the_report_shows_the_steps_with_fields(light: Path) -> None:
    assert [frame["index"] for frame in (model(read_results(light)) or {})["frames"]] == [4, 6]


def test_a_run_that_is_stopped_stores_its_last_step(tmp_path: Path, whole: Path) -> None:
    outcome, _ = run(scene(*LIGHT), tmp_path / "out", Watch(on_step=Stop(5)))
    assert outcome.status == "interrupted"
    assert files(tmp_path / "out") == ([4, 5], [1, 2, 3])
    outcome, _ = run(scene(*LIGHT), tmp_path / "out", resume=True)
    assert outcome.status == "converged"
    assert files(tmp_path / "out") == ([4, 5, 6], [1, 2, 3])
    assert_same_numbers(tmp_path / "out", whole)


def test_a_run_that_is_killed_goes_on_from_the_last_step_with_fields(tmp_path: Path, whole: Path) -> None:
    done = list[float]()

    def kill(step: StepResult) -> None:
        done.append(step.time)
        if len(done) == 5:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run(scene(*LIGHT), tmp_path / "out", Watch(on_step=kill))
    assert files(work_of(tmp_path / "out")) == ([4], [1, 2, 3, 5])
    resumed, seen = list[tuple[int, float]](), list[float]()
    watch = Watch(on_resume=lambda count, time: resumed.append((count, time)), on_step=lambda s: seen.append(s.time))
    outcome, _ = run(scene("output.every=4"), tmp_path / "out", watch, resume=True)  # all are stored from here on
    assert (outcome.status, resumed) == ("converged", [(4, done[3])])
    assert seen[0] == done[4]
    assert files(tmp_path / "out") == ([4, 5, 6], [1, 2, 3])
    assert_same_numbers(tmp_path / "out", whole)


@pytest.mark.parametrize(("last", "said"), [(2, "none has its fields"), (5, "go on with --resume")])
def test_steps_without_fields_are_not_overwritten_without_a_word(last: int, said: str, folder: Path) -> None:
    done, place = list[float](), Path("out")

    def kill(step: StepResult) -> None:
        done.append(step.time)
        if len(done) == last:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run(scene(*LIGHT), place, Watch(on_step=kill))
    before = files(work_of(place))
    with pytest.raises(FolderError, match=f"has left {last} steps in .out.running; {said}"):
        run(scene(*LIGHT), place)
    assert files(work_of(place)) == before
    (work_of(place) / BEGUN).unlink()
    with pytest.raises(MachineError, match=f"is lost, so its {last} steps belong to no scene"):
        run(scene(*LIGHT), place, resume=True)


def test_the_audit_names_the_number_of_the_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps 4 and 6 are judged."""
    times, judge = scene().requested_times(), Auditor.__call__

    def worse(self: Auditor, record: Record, before: Record | None = None) -> Audit:
        return replace(judge(self, record, before), cone=float(record.time > times[-2]))

    monkeypatch.setattr(Auditor, "__call__", worse)
    outcome, _ = run(scene(*LIGHT, "output.error=false"), tmp_path / "out")
    assert outcome.status == "doubtful"
    assert f"in step 6 (t = {times[-1]:g})" in outcome.sentence


def test_a_viewer_is_shown_what_is_stored(tmp_path: Path) -> None:
    run(scene(*LIGHT), tmp_path / "out", Watch(on_step=Stop(5)))
    run(scene("output.vtu=true"), tmp_path / "out", resume=True)  # asks for every step now
    assert sorted(path.stem for path in (tmp_path / "out" / "vtu").glob("*.vtm")) == ["000004", "000005", "000006"]


def test_a_step_that_fails_leaves_the_last_good_one(tmp_path: Path) -> None:
    pushed = "loads.top={boundary='block.top',force=[[[0, 0], [1, 0], [2, 0.5]], -1.0]}"
    outcome, content = run(scene(*LIGHT, "supports={}", pushed), tmp_path / "out")
    assert outcome.status == "no_equilibrium"
    assert len(content["steps"]) == 5
    assert files(tmp_path / "out") == ([4, 5], [1, 2, 3])


def test_another_word_is_refused(call: Call) -> None:
    code, _, err = call("run", "block", "--set=output.step_files=some")
    assert code == 2
    assert len(err.splitlines()) == 1
    assert "output.step_files" in err
