"""A run tells where its seconds go, and light steps take few of them."""

import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_array_equal

import stickslip
from shared.command import Call, ended, result
from shared.histories import SMALL, Stop, leaves, rows
from stickslip.geometry.errors import FolderError, MachineError
from stickslip.solvers.parallel.counters import PHASES
from stickslip.solvers.results.audit import Audit, Auditor
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.results.stored_fields import Record
from stickslip.workflows.commands import start
from stickslip.workflows.formats.results import profile_lines, read_results
from stickslip.workflows.formats.steps import light_files, step_files
from stickslip.workflows.pictures.report_page import page
from stickslip.workflows.pictures.report_view import model
from stickslip.workflows.run.folder import BEGUN, work_of
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

ROUNDING = 1e-9  # of sums of a few dozen numbers, relative
BETWEEN = 0.3  # largest share of what is in no phase; it takes a fiftieth of that
CHOSEN = {"OMPI_MCA_pml": "cm"}  # by the user
LEARNS = ("solver.method=tangent-cg", "solver.surface=matrix-free")


def of_run(folder: Path, *more: str, **keys: Any) -> dict[str, Any]:
    return run(read("block", [*SMALL, *more]), folder, **keys)[1]


def assert_adds_up(content: dict[str, Any]) -> None:
    seconds = content["seconds"]
    parts = [value for name, value in seconds.items() if name != "total" and value is not None]
    assert min(parts) >= 0
    assert sum(parts) == pytest.approx(seconds["total"], rel=ROUNDING)
    assert sum(row["seconds"] for row in content["profile"]) == pytest.approx(seconds["total"], rel=ROUNDING)
    assert {row["phase"] for row in content["profile"]} <= set(PHASES) <= set(seconds)
    counted = content["counters"]["volume_solves"] + content["counters"]["error_solves"]
    assert sum(row["volume_solves"] for row in content["profile"]) == counted


def row(content: dict[str, Any], phase: str, part: str = "") -> dict[str, Any]:
    (found,) = (row for row in content["profile"] if (row["phase"], row["part"]) == (phase, part))
    return dict(found)


@pytest.fixture(scope="module")
def spent(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("clock") / "out"


@pytest.fixture(scope="module")
def content(spent: Path) -> dict[str, Any]:
    asked = ("output.linear_reference=true", "output.pictures=true", "output.report=true")
    return of_run(spent, *asked, began=time.perf_counter() - 50.0)


def test_seconds_add_up_to_the_total(content: dict[str, Any]) -> None:
    assert_adds_up(content)
    assert content["seconds"]["imports"] >= 50.0
    assert content["seconds"]["other"] < BETWEEN * (content["seconds"]["total"] - content["seconds"]["imports"])


def test_all_solvers_of_the_linear_reference_are_in_it(content: dict[str, Any]) -> None:
    solvers, seconds = content["linear_reference"]["solvers"].values(), content["seconds"]
    took = sum((one["setup"] or 0.0) + (one["solve"] or 0.0) for one in solvers)
    assert seconds["linear_reference"] == content["linear_reference"]["seconds"]
    assert seconds["linear_reference"] + seconds["linear_reference_others"] >= took > seconds["linear_reference"]


def test_each_phase_has_its_parts(content: dict[str, Any]) -> None:
    count = len(content["steps"])
    assert row(content, "iterate")["calls"] == count
    assert row(content, "iterate")["volume_solves"] == content["counters"]["volume_solves"]
    assert row(content, "error", "time steps")["volume_solves"] > 0
    assert row(content, "audit")["seconds"] == content["seconds"]["audit"] > 0
    assert all(row(content, "output", part)["seconds"] > 0 for part in ("results", "step files", "pictures", "report"))


def test_run_log_ends_with_the_profile(spent: Path, content: dict[str, Any]) -> None:
    lines = (spent / "run.log").read_text().splitlines()
    told = profile_lines(content["profile"])
    assert lines[-len(told) :] == told
    assert [told[0].split()[0], told[-1].split()[:2]] == ["phase", ["total", f"{content['seconds']['total']:.3f}"]]


def test_the_report_shows_the_profile(spent: Path, content: dict[str, Any]) -> None:
    text = page(read_results(spent))
    assert all(f"<td>{cell}</td>" in text for cell in ("  step files", "  pictures", "imports", "audit"))


def test_a_run_that_goes_on_adds_to_what_was_spent(tmp_path: Path) -> None:
    scene = read("block", [*SMALL, "output.error=false"])
    _, before = run(scene, tmp_path / "out", Watch(on_step=Stop(3)), began=time.perf_counter() - 50.0)
    _, after = run(scene, tmp_path / "out", resume=True)
    for content in (before, after):
        assert_adds_up(content)
    assert before["seconds"]["audit"] == 0.0  # it was told to stop
    assert after["seconds"]["imports"] >= 50.0
    assert (row(after, "iterate")["calls"], row(after, "prepare")["calls"]) == (6, 4)
    assert row(after, "iterate")["volume_solves"] == after["counters"]["volume_solves"]


def test_setting_up_the_tangent_is_told(tmp_path: Path) -> None:
    content = of_run(tmp_path / "out", *LEARNS, "output.error=false")
    assert_adds_up(content)
    assert row(content, "prepare", "tangent")["seconds"] > 0
    assert row(content, "iterate", "certificate")["calls"] > 0


@pytest.mark.parametrize("launched", [*start.LAUNCHED, ""])
def test_mpi_is_told_of_a_process_that_is_alone(launched: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "environ", {launched: "1"} | CHOSEN)
    start._stay_alone()
    assert dict(os.environ) == os.environ | CHOSEN
    assert (set(start.ALONE) <= set(os.environ)) == (not launched)


@pytest.mark.parametrize(
    ("module", "late"),
    [
        ("workflows.commands.cli", ("numpy", "mpi4py", "rich")),
        ("workflows.scene_file.read", ("gmsh", "matplotlib", "pyvista", "scipy.integrate")),
        ("workflows.pictures.draw", ("pyvista", "vtkmodules")),
    ],
)
def test_what_takes_long_to_load_is_loaded_late(module: str, late: tuple[str, ...]) -> None:
    program = f"import sys, stickslip.{module}; print(*(name for name in {late} if name in sys.modules))"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout == "\n"


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


class Kill:
    """Ends a run as a crash does, in its n-th step."""

    def __init__(self, step: int) -> None:
        self.step, self.done = step, list[float]()

    def __call__(self, step: StepResult) -> None:
        self.done.append(step.time)
        if len(self.done) == self.step:
            raise ZeroDivisionError


def test_a_run_that_is_killed_goes_on_from_the_last_step_with_fields(tmp_path: Path, whole: Path) -> None:
    kill = Kill(5)
    with pytest.raises(ZeroDivisionError):
        run(scene(*LIGHT), tmp_path / "out", Watch(on_step=kill))
    assert files(work_of(tmp_path / "out")) == ([4], [1, 2, 3, 5])
    resumed, seen = list[tuple[int, float]](), list[float]()
    watch = Watch(on_resume=lambda count, time: resumed.append((count, time)), on_step=lambda s: seen.append(s.time))
    outcome, _ = run(scene("output.every=4"), tmp_path / "out", watch, resume=True)  # all are stored from here on
    assert (outcome.status, resumed) == ("converged", [(4, kill.done[3])])
    assert seen[0] == kill.done[4]
    assert files(tmp_path / "out") == ([4, 5, 6], [1, 2, 3])
    assert_same_numbers(tmp_path / "out", whole)


@pytest.mark.parametrize(("last", "said"), [(2, "none has its fields"), (5, "go on with --resume")])
def test_steps_without_fields_are_not_overwritten_without_a_word(last: int, said: str, folder: Path) -> None:
    place = Path("out")
    with pytest.raises(ZeroDivisionError):
        run(scene(*LIGHT), place, Watch(on_step=Kill(last)))
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
    _, err = ended(call("run", "block", "--set=output.step_files=some"), 2)
    assert len(err.splitlines()) == 1
    assert "output.step_files" in err
