"""A run that was stopped goes on to the result, bit for bit, of one that was not."""

from __future__ import annotations

import errno
import json
import os
import shlex
import shutil
import signal
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stickslip
from shared.command import Call, assert_said, result
from shared.histories import LEARNS, PUSHED, SMALL, Stop, assert_same, names_in, rows, unchanged
from stickslip import load
from stickslip.geometry.errors import DamagedError, FolderError, SceneError
from stickslip.solvers.accuracy.budget import Estimates
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Solution
from stickslip.solvers.methods.condensed_newton import CondensedNewton
from stickslip.solvers.methods.surface_uzawa import LearningIteration
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.accuracy.rounds import Rounds, aiming
from stickslip.workflows.formats.files import read_regular
from stickslip.workflows.formats.hdf5 import read_arrays, write_arrays
from stickslip.workflows.formats.marker import MARKER, mark
from stickslip.workflows.formats.steps import step_name
from stickslip.workflows.run.folder import BEGUN, ResultsFolder
from stickslip.workflows.run.resume import VERSIONS
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import READY, from_dict, read

CUBE = ["geometry.mesh_size=0.34", "output.pictures=false", "steps.count=4"]
SLIDING = ["geometry.mesh_size=0.25", "geometry.lower_mesh_size=0.2", "output.pictures=false", "steps.end=1.5"]
CUT = ["geometry.mesh_size=0.25", "geometry.contact_mesh_size=0.04", "output.pictures=false", *PUSHED, "steps.count=5"]
LEARNING = [*SMALL, *LEARNS, "output.error=false"]
TANGENT = ["solver={method='tangent-cg',surface='matrix-free',tolerance=1e-6}"]
HYSTERESIS = ["geometry.mesh_size=0.1", "steps.end=5", "steps.count=5", "output.pictures=false"]
SECONDS = "steps.seconds=true"
STOP = "springs.stop={at='block.right',stiffness=0.3,direction=[-1.0,0.0],acts='compression',gap=0.01}"
CLOCK = [
    "contacts.base.friction={law='rate_and_state',f0=0.3,a=0.01,b=0.005,Dc=0.02,V0=0.1}",
    "supports.top.displacement.x=[[0,0],[1,0],[1.2,0.01],[1.4,0.02],[1.7,0.03],[2,0.05]]",
    "steps={end=2.0,clock={error=1e-5,smallest=1e-9,largest=0.1}}",
]
CYCLE = [
    "contacts.base.wear.k=0.05",
    "supports.top.displacement={x=[[0,0],[1,0.01],[1.5,-0.01],[2,0.01]],y=[[0,0],[1,-0.1]]}",
    "steps={end=2.0,count=4,cycle={from=1.0,to=2.0,repeat=8,error=0.1}}",
]
HISTORIES = {
    "hysteresis": ("hysteresis", HYSTERESIS),
    "condensed-newton": ("block", [*SMALL, "solver.method=condensed-newton"]),
    "uzawa": ("block", [*SMALL, "solver.method=uzawa"]),
    "surface-uzawa": ("cube", [*CUBE, *LEARNS]),
    "tangent-cg": ("cube", [*CUBE, *TANGENT, "contacts.base.friction.mu=0.05"]),  # multigrid holds less when all slides
    "tangent-cg, sliding": ("sliding", [*SLIDING, *TANGENT]),
    "tangent-cg, floating": ("stack", ["geometry.mesh_size=0.25", "output.pictures=false", "steps.count=4", *TANGENT]),
    "inexact-uzawa": ("block", [*SMALL, "solver.method=inexact-uzawa"]),
    "nonlinear-uzawa": ("raous", ["output.pictures=false", "solver.method=nonlinear-uzawa", "steps.count=4"]),
    "perturbed-lagrangian": ("block", [*SMALL, "solver.method=perturbed-lagrangian"]),
    "regularised": ("block", [*SMALL, "solver.method=regularised"]),
    "gram-uzawa": ("block", [*SMALL, "solver.method=gram-uzawa"]),
    "block-uzawa": ("block", [*SMALL, "solver.method=block-uzawa", "solver.rates=true"]),
    "block-uzawa, inexact": ("block", [*SMALL, "solver.method=block-uzawa", "solver.inner_solves=inexact"]),
    "block-uzawa, sliding": ("sliding", [*SLIDING, "solver.method=block-uzawa"]),
    "block-uzawa, compliance": (
        "foundation",
        ["geometry.mesh_size=0.4", "output.pictures=false", "steps.count=4", "solver.method=block-uzawa"],
    ),
    "block-uzawa, nest": ("block", [*SMALL, "solver.method=block-uzawa", "solver.outer=ksp"]),
    "substeps": ("half_disc", [*CUT, "solver.method=condensed-newton", "solver.max_iterations=3"]),
    "sliding": ("sliding", SLIDING),
    "sliding, iterative": ("sliding", [*SLIDING, *LEARNS]),
    "compliance": ("foundation", ["geometry.mesh_size=0.4", "output.pictures=false", "steps.count=4"]),
    "friction by slip rate": ("block", [*SMALL, "contacts.base.friction={law='rate_dependent',mu='0.2+V'}", SECONDS]),
    "friction by rate and state": (
        "block",
        [*SMALL, "contacts.base.friction={law='rate_and_state',f0=0.3,a=0.01,b=0.005,Dc=0.02,V0=0.1}", SECONDS],
    ),
    "clock": ("block", [*SMALL, *CLOCK]),
    "friction by slip": ("stick_slip", ["geometry.mesh_size=0.025", "output.pictures=false", "steps.count=6"]),
    "wear": ("block", [*SMALL, "contacts.base.wear.k=0.05", "contacts.base.slide=[[0,0],[1,0],[2,0.01]]"]),
    "cycle": ("block", [*SMALL, *CYCLE]),
    "orthotropic": ("spruce", ["geometry.mesh_size=0.012", "output.pictures=false", "steps.count=6"]),
    "springs of one way": ("block", [*SMALL, STOP, "solver.method=condensed-newton"]),
    "floating": ("stack", ["geometry.mesh_size=0.25", "output.pictures=false", "steps.count=4"]),
}
QUICK = (
    *("springs of one way", "substeps", "friction by slip", "friction by slip rate", "tangent-cg"),
    *("surface-uzawa", "sliding", "block-uzawa, compliance", "wear", "clock", "cycle"),
)
WITHOUT_ERRORS = ("springs of one way", "friction by slip")  # others are resumed with them
EACH = [pytest.param(name, marks=[] if name in QUICK else pytest.mark.slow) for name in HISTORIES]


def learning(*more: str) -> Any:
    """A scene whose method learns from step to step."""
    return read("block", [*LEARNING, *more])


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a run that was not stopped."""
    folder = tmp_path_factory.mktemp("whole") / "out"
    run(learning(), folder)
    return folder


@pytest.fixture(scope="module")
def stopped_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stopped") / "out"
    run(learning(), folder, Watch(on_step=Stop(3)))
    return folder


@pytest.fixture
def stopped(folder: Path, stopped_once: Path) -> Path:
    """The results of the same run, stopped after three steps."""
    return Path(shutil.copytree(stopped_once, folder / "out"))


WORDS = ["run", "block", "-q", "-o", "out", *(f"--set={word}" for word in LEARNING)]


@pytest.mark.parametrize("name", EACH)
def test_every_method_goes_on_to_the_same_bits(name: str, tmp_path: Path) -> None:
    ready, words = HISTORIES[name]
    scene = read(ready, [*words, f"output.error={'false' if name in WITHOUT_ERRORS else 'full'}"])
    _, content = run(scene, tmp_path / "whole")
    assert (max(step["substeps"] for step in content["steps"]) > 1) == (name in ("substeps", "clock", "cycle"))
    outcome, _ = run(scene, tmp_path / "out", Watch(on_step=Stop(3)))
    assert (outcome.status, len(result(tmp_path / "out")["steps"])) == ("interrupted", 3)
    outcome, _ = run(scene, tmp_path / "out", resume=True)
    assert outcome.status == "converged"
    assert_same(tmp_path / "out", tmp_path / "whole")


@pytest.mark.parametrize("name", ["cube", pytest.param("sliding", marks=pytest.mark.slow)])
def test_methods_that_were_given_up_stay_so(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever would be chosen with the memory that is free when the run goes on."""
    solve, few = LearningIteration.__call__, 2
    monkeypatch.setattr(LearningIteration, "__call__", lambda self, *rest: solve(replace(self, max_it=few), *rest))
    monkeypatch.setattr("stickslip.solvers.methods.tangent_cg.PATIENCE", few)
    scene = read(name, [*(CUBE if name == "cube" else SLIDING), "solver.surface=matrix-free", "output.error=false"])
    run(scene, tmp_path / "whole")
    run(scene, tmp_path / "out", Watch(on_step=Stop(2)))
    with monkeypatch.context() as patched:
        patched.setattr("stickslip.solvers.stepping.choice.available", lambda: 0)
        run(scene, tmp_path / "out", resume=True)
    done = result(tmp_path / "out")
    assert [switch["after"] for switch in done["switches"]][-1] == "condensed-newton (condensed)"
    assert_same(tmp_path / "out", tmp_path / "whole")


def test_what_a_method_of_single_steps_has_learnt_is_resumed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where Newton fails, surface-uzawa takes the step over; it learns of the bodies from all such steps."""
    solve = CondensedNewton.__call__
    fails = {0.5, 1.5}

    def some(self: CondensedNewton, problem: SurfaceProblem, *rest: Any) -> Solution:
        return solve(replace(self, max_it=1) if problem.cone.time in fails else self, problem, *rest)

    monkeypatch.setattr(CondensedNewton, "__call__", some)
    monkeypatch.setattr("stickslip.solvers.stepping.halving.HALVINGS", 0)  # the step is not cut first
    scene = read("cube", [*CUBE, "output.error=false"])
    run(scene, tmp_path / "whole")
    run(scene, tmp_path / "out", Watch(on_step=Stop(1)))
    run(scene, tmp_path / "out", resume=True)
    done = result(tmp_path / "out")
    assert [switch["time"] for switch in done["switches"]] == sorted(fails)
    assert done["method"] == "condensed-newton"
    assert_same(tmp_path / "out", tmp_path / "whole")


@pytest.mark.parametrize(
    "number", [signal.SIGUSR1, *(pytest.param(n, marks=pytest.mark.slow) for n in (signal.SIGINT, signal.SIGTERM))]
)
def test_signals_end_the_run_after_the_iteration_and_it_goes_on(
    number: signal.Signals, call: Call, whole: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As often as one likes."""
    first = sum(row["step"] == "1" for row in rows(whole / "history.csv"))
    stops = [Stop(first + 2, number), Stop(2, number)]
    with monkeypatch.context() as patched:
        patched.setattr("stickslip.workflows.run.terminal.Reporter._iteration", lambda self, row: stops[0](row))
        code, _, err = call(*WORDS)
        assert (code, err.count("\n")) == (130, 1)
        assert f"stopped by {number.name} after 1 of 6 steps; go on with: stickslip run block -o out --set=" in err
        said = [*shlex.split(err.partition("go on with: stickslip ")[2]), "-q"]
        stops.pop(0)
        assert call(*said)[0] == 130
        assert len(result(folder / "out")["steps"]) == 1
    assert call(*said) == (0, "", "")
    assert_same(folder / "out", whole)
    assert names_in(folder) == {f"out/{name}" for name in names_in(whole)}


def test_a_run_that_is_stopped_behind_its_last_step_goes_on_to_the_estimate(tmp_path: Path) -> None:
    scene = read("half_disc", [*CUT, "output.error_budget=inf"])
    run(scene, tmp_path / "whole")
    stop = Stop(1)
    outcome, content = run(scene, tmp_path / "out", Watch(on_estimate=stop))
    assert (outcome.status, len(content["steps"])) == ("interrupted", len(scene.requested_times()))
    assert outcome.sentence.endswith("after 6 of 6 steps")
    assert content["steps"][-1]["energy"]["error"]["dissipated"]["time_step"] is None
    outcome, content = run(scene, tmp_path / "out", resume=True)
    assert outcome.status == "converged"
    assert content["steps"][-1]["energy"]["error"]["dissipated"]["time_step"] > 0
    assert_same(tmp_path / "out", tmp_path / "whole")


def test_ctrl_c_ends_the_estimate_with_what_is_there_and_the_rest_is_found_as_it_was_chosen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It comes while the steps are halved: all else is there, and what is not says what it would cost."""
    scene = read("half_disc", [*CUT, "output.error=full"])
    run(scene, tmp_path / "whole")
    stop = Stop(1)
    watch = Watch(on_estimate=lambda line: stop(None) if "time steps" in line else None)
    outcome, content = run(scene, tmp_path / "out", watch)
    assert (outcome.status, len(content["steps"])) == ("interrupted", 6)
    lost, chosen = content["steps"][-1]["energy"]["error"]["dissipated"], content["estimates"]
    assert lost["time_step"] is None
    assert lost["lacking"]["time_step"] == chosen["prices"]["time steps"] > 0.1
    assert {"coarser mesh", "time steps"} <= {*chosen["done"]}
    monkeypatch.setattr(Estimates, "choose", None)
    outcome, content = run(scene, tmp_path / "out", resume=True)
    assert (outcome.status, content["estimates"]) == ("converged", chosen)
    assert load(tmp_path / "out").result["estimates"] == chosen
    assert content["steps"][-1]["energy"]["error"]["dissipated"]["lacking"] == {}
    assert_same(tmp_path / "out", tmp_path / "whole")


def test_stopped_run_spends_no_time_on_audit_and_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A batch queue grants a few seconds: those of a run that goes on are spent at its end."""

    def fail(*arguments: object) -> None:
        raise AssertionError(arguments)

    words = ("true", "false")
    asks, asks_not = (learning(f"output.pictures={word}", f"output.linear_reference={word}") for word in words)
    with monkeypatch.context() as patched:
        for place in ("run.run.audit_steps", "run.run.linear_reference", "pictures.draw.draw"):
            patched.setattr(f"stickslip.workflows.{place}", fail)
        outcome, content = run(asks, tmp_path / "out", Watch(on_step=Stop(2)))
    assert (outcome.status, [step["audit"] for step in content["steps"]]) == ("interrupted", [None, None])
    assert set(content["audit"].values()) == {None}
    _, content = run(asks_not, tmp_path / "out", resume=True)
    assert all(max(step["audit"].values()) <= 1e-7 for step in content["steps"])  # those of before it was stopped too


def test_resume_without_anything_there_begins_at_the_start_and_says_so(call: Call, whole: Path, folder: Path) -> None:
    """So that a batch script can be the same for the first run and for those that follow."""
    code, out, err = call(*WORDS, "--resume")
    assert (code, out, err) == (0, "", "stickslip: nothing to resume in out: begins at the start\n")
    assert_same(folder / "out", whole)


def test_finished_run_is_left_as_it_is(call: Call, whole: Path, folder: Path) -> None:
    (folder / "out").symlink_to(whole)
    with unchanged(whole):
        assert_said(call(*WORDS, "--resume"), 0, "the run is finished; nothing was changed")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("bodies.block.nu=0.31", "bodies.block.nu was 0.3 in out, and is 0.31"),
        ("solver.tolerance=1e-9", "solver.tolerance was 1e-08 in out, and is 1e-09"),
        ("steps.count=12", "steps.count was 6 in out, and is 12"),
        ("supports.top.displacement.y=-0.1", "supports.top.displacement.y was [[0.0, 0.0], [1.0, -0.1]] in out, and"),
        ("contacts.base.search_distance=1.0", "contacts.base.search_distance was null in out, and is 1.0"),
    ],
)
def test_changed_scene_is_refused_and_the_difference_named(change: str, said: str, call: Call, stopped: Path) -> None:
    with unchanged(stopped):
        assert_said(call(*WORDS, f"--set={change}", "--resume"), 2, said)


def test_what_is_only_shown_may_change(call: Call, stopped: Path) -> None:
    assert call(*WORDS, "--set=output.every=2", "--set=title=Another", "--set=exact.accuracy=0.1", "--resume")[0] == 0
    done = result(stopped)
    assert (done["status"], len(done["steps"]), done["scene"]["title"]) == ("converged", 6, "Another")


# damage


def damage(path: Path, part: float = 0.5) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: int(part * len(content))])


@pytest.mark.parametrize("part", [0.0, 0.9])
def test_damaged_last_step_is_solved_again_to_its_bits(part: float, call: Call, whole: Path, stopped: Path) -> None:
    damage(stopped / step_name(3), part)
    assert_said(call(*WORDS, "--resume"), 0, "steps/000003.h5: damaged", "solved again")
    assert_same(stopped, whole)


@pytest.mark.parametrize("missing", [False, True])
def test_damaged_or_missing_earlier_step_is_named_and_not_touched(missing: bool, call: Call, stopped: Path) -> None:
    path = stopped / step_name(2)
    path.unlink() if missing else damage(path)
    with unchanged(stopped):
        assert_said(call(*WORDS, "--resume"), 4, "steps/000002.h5: ")


def test_another_mesh_is_refused(call: Call, stopped: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As another version of gmsh may make of the same scene."""
    monkeypatch.setattr("stickslip.workflows.run.run.mesh_checksum", lambda mesh: "0" * 64)
    with unchanged(stopped):
        assert_said(call(*WORDS, "--resume"), 4, "gmsh meshes this scene differently now")


def test_without_what_was_learnt_the_answer_is_that_to_tolerance(call: Call, whole: Path, stopped: Path) -> None:
    for path in (stopped / "learnt").iterdir():
        damage(path)
    assert_said(call(*WORDS, "--resume"), 0, "learnt is lost")
    ours, theirs = (result(f)["steps"][-1]["contacts"]["base"] for f in (stopped, whole))
    assert ours["tangential_force"] != theirs["tangential_force"]  # else nothing had been learnt
    for key in ("normal_force", "tangential_force"):
        assert ours[key] == pytest.approx(theirs[key], rel=1e-7)  # of a tolerance of 1e-8


def test_rows_beyond_the_last_step_are_cut(call: Call, whole: Path, stopped: Path) -> None:
    """As a crash leaves them: tables are written before the step that makes them valid."""
    for name in ("contact_base.csv", "probes.csv", "history.csv"):
        beyond = (whole / name).read_text()[len((stopped / name).read_text()) :]
        with (stopped / name).open("a") as file:
            file.write(beyond[: len(beyond) // 2])
    assert call(*WORDS, "--resume")[0] == 0
    assert_same(stopped, whole)


@pytest.mark.slow
def test_run_that_failed_tries_that_step_again_and_ends_the_same(folder: Path) -> None:
    """Pushed ever harder, the block slides off: the last good substep was written, and is no step to go on from."""
    data = tomllib.loads((READY / "foundation.toml").read_text())
    del data["supports"], data["exact"], data["obstacles"]["foundation"]["displacement"]
    data["loads"] = {"side": {"boundary": "block.left", "pressure": [[0.0, 0.0], [1.0, 0.0], [2.0, 3e4]]}}
    data["geometry"]["mesh_size"], data["output"] = 0.5, {"pictures": False}
    scene = from_dict(data)
    first, content = run(scene, folder / "out")
    assert first.status == "no_equilibrium"
    assert [step["time"] for step in content["steps"]][:3] == [0.5, 1.0, 1.5]
    assert 1.5 < content["steps"][3]["time"] < 2.0
    shutil.copytree(folder / "out", folder / "before")
    again, _ = run(scene, folder / "out", resume=True)
    assert (again.status, again.sentence) == (first.status, first.sentence)
    assert_same(folder / "out", folder / "before")


# what is not damage


def content_of(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in names_in(folder)}


def assert_refused(code: int, said: str, folder: Path, call: Call) -> None:
    """In one line, and nothing is changed."""
    with unchanged(folder):
        found, _, err = call(*WORDS, "--resume")
        assert (found, err.count("\n")) == (code, 1), err
        assert said in err


@pytest.mark.parametrize(
    "number", [errno.EIO, *(pytest.param(n, marks=pytest.mark.slow) for n in (errno.EACCES, errno.ESTALE))]
)
def test_last_step_that_cannot_be_read_now_is_kept(
    number: int, call: Call, stopped: Path, whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a network disk that is away for a moment: the step may be sound."""

    def fail(path: Path, *size: int) -> bytes:
        if path.name == "000003.h5":
            raise OSError(number, os.strerror(number), str(path))
        return read_regular(path, *size)

    before = content_of(stopped)
    with monkeypatch.context() as patched:
        patched.setattr("stickslip.workflows.formats.marker.read_regular", fail)
        code, _, err = call(*WORDS, "--resume")
    assert (code, err.count("\n")) == (4, 1)
    assert f"steps/000003.h5: cannot be read: {os.strerror(number)}; nothing is resumed, nothing was changed" in err
    assert content_of(stopped) == before
    assert call(*WORDS, "--resume")[0] == 0
    assert_same(stopped, whole)


def test_sound_file_that_is_no_step_of_this_version_is_kept(call: Call, stopped: Path) -> None:
    write_arrays(stopped / step_name(3), {}, {"time": 1.0})
    assert_refused(4, "steps/000003.h5: was changed after the run, or is of another one", stopped, call)
    mark(stopped, sha256={})
    assert_refused(4, "steps/000003.h5: not a step of this version of stickslip", stopped, call)


def test_sound_file_of_another_step_is_named(call: Call, stopped: Path) -> None:
    shutil.copy(stopped / step_name(3), stopped / step_name(2))
    assert_refused(
        4, "steps/000002.h5: is not that file: it is what steps/000003.h5 was when the run ended", stopped, call
    )


@pytest.mark.parametrize("name", ["stickslip", "dolfinx"])
def test_another_version_is_refused(name: str, call: Call, stopped: Path) -> None:
    begun = json.loads((stopped / BEGUN).read_text())
    (stopped / BEGUN).write_text(json.dumps(begun | {name: "0.0.1"}))
    assert_refused(2, f"out was begun with {name} 0.0.1, this is {name} {VERSIONS[name]}", stopped, call)


ENDLESS = ["[" * 100_000, '{"a":' * 100_000, "1" * 10_000, '{"scene": ' + "[" * 5000]


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", '{"scene": 1, "mesh": ""}', *ENDLESS])
def test_beginning_that_cannot_be_known_is_said(content: str, call: Call, stopped: Path) -> None:
    (stopped / BEGUN).write_text(content)
    assert_refused(4, f"{BEGUN}: ", stopped, call)


def test_tables_that_were_damaged_or_lost_are_written_again(call: Call, stopped: Path, whole: Path) -> None:
    """The steps hold all that is in them."""
    table = stopped / "contact_base.csv"
    table.write_text(table.read_text().replace("\n0.", "\n0 s ", 1)[:-500])
    (stopped / "steps.csv").unlink()
    assert call(*WORDS, "--resume") == (0, "", "")
    assert_same(stopped, whole)


def test_a_mesh_that_was_damaged_is_written_again(call: Call, stopped: Path, whole: Path) -> None:
    damage(stopped / "fields.h5")
    with pytest.raises(DamagedError):
        read_arrays(stopped / "fields.h5")
    assert call(*WORDS, "--resume") == (0, "", "")
    assert_same(stopped, whole)
    assert read_arrays(stopped / "fields.h5")[0].keys() == read_arrays(whole / "fields.h5")[0].keys()


# other processes


@pytest.mark.parametrize("number", [errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP])
def test_disk_without_locks_is_told_and_used(number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*arguments: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("fcntl.flock", fail)
    outcome, _ = run(read("block", [*LEARNING, "steps.count=1"]), tmp_path / "out")
    assert outcome.status == "converged"
    assert "this disk has no locks" in (tmp_path / "out" / "run.log").read_text()


def test_results_of_a_stopped_run_are_not_replaced_unasked(call: Call, whole: Path, stopped: Path) -> None:
    before = content_of(stopped)
    for _ in range(2):  # the second would have deleted what the first moved aside
        assert_said(
            call(*WORDS),
            2,
            "has left 3 steps in out; go on with --resume, or remove that folder, or choose another one with -o",
        )
        assert content_of(stopped) == before
    assert [path.name for path in stopped.parent.iterdir()] == ["out"]
    assert call(*WORDS, "--resume")[0] == 0
    assert_same(stopped, whole)


def test_two_runs_do_not_write_the_same_results(call: Call, folder: Path) -> None:
    other = ResultsFolder(folder / "out")
    other.start()
    for words in (WORDS, [*WORDS, "--resume"]):
        assert_said(call(*words), 2, "process is writing it")
    assert names_in(folder) == {".out.running/run.log", f".out.running/{MARKER}"}
    other.release()
    assert call(*WORDS)[0] == 0


def test_what_a_killed_run_left_is_not_replaced_unasked(call: Call, whole: Path, stopped: Path) -> None:
    work = stopped.rename(stopped.with_name(".out.running"))  # so it stands after SIGKILL
    with unchanged(work):
        assert_said(call(*WORDS), 2, "has left 3 steps in .out.running; go on with --resume")
    assert call(*WORDS, "--resume")[0] == 0
    assert_same(stopped, whole)


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

    monkeypatch.setattr("stickslip.workflows.run.run.run", count)
    return found


def told(content: dict[str, Any]) -> list[Any]:
    """All rounds, without their seconds."""
    return [{**one, "seconds": 0.0} for one in content["accuracy"]["rounds"]]


@pytest.fixture(scope="module")
def whole_rounds(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What rounds say that were not stopped."""
    found: dict[str, Any] = solved(tmp_path_factory.mktemp("whole"))[2]
    return found


@pytest.mark.parametrize("steps", [0, 3])  # the block has 2: in the first round, and in the second one
def test_rounds_go_on_where_they_were_stopped(
    steps: int, tmp_path: Path, counted: list[Scene], whole_rounds: dict[str, Any]
) -> None:
    assert len(whole_rounds["accuracy"]["rounds"]) == 2
    _, outcome, _ = solved(tmp_path, Watch(on_step=stopping(steps)))
    assert outcome.status == "interrupted"
    with pytest.raises(FolderError, match="go on with --resume"):
        solved(tmp_path)
    counted.clear()
    _, outcome, content = solved(tmp_path, resume=True)
    assert outcome.status == "converged"
    assert len(counted) == (1 if steps else 2)
    assert told(content) == told(whole_rounds)
    assert content["steps"][-1]["contacts"] == whole_rounds["steps"][-1]["contacts"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out"]
    counted.clear()
    _, outcome, again = solved(tmp_path, resume=True)
    assert "nothing was changed" in outcome.sentence
    assert (counted, again) == ([], content)


def test_a_crash_between_two_rounds_loses_neither(
    tmp_path: Path, counted: list[Scene], whole_rounds: dict[str, Any], monkeypatch: pytest.MonkeyPatch
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
    assert told(content) == told(whole_rounds)


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
    monkeypatch.setattr("stickslip.workflows.run.run.doubts", lambda *_: ("the block is odd",))
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
