"""The command line says what it does, in one line where it refuses, and ends with the code that it documents."""

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import stickslip.workflows.run.run
from shared.command import BUILT, COARSE, READY_NAMES, Call, assert_said, ended, output_of, result, table
from shared.disks import make_full
from shared.histories import SMALL
from shared.processes import running
from stickslip import VERSION
from stickslip.geometry.errors import SolverError, StickslipError
from stickslip.geometry.user_files.child_process import child_environment
from stickslip.geometry.user_files.user_file import UserFile
from stickslip.solvers.simulation.simulation import Simulation, prepare
from stickslip.workflows import commands as rooms
from stickslip.workflows.commands.cli import FIRST, app, commands, guarded
from stickslip.workflows.formats.steps import write_step
from stickslip.workflows.scene_file.read import READY, read

# --- what it says about itself


def test_help_names_what_is_built_and_each_command_explains_itself(call: Call) -> None:
    out = output_of(call("--help"))
    listed = re.findall(r"^  ([a-z]+) +\w", out.partition("Commands:")[2], re.MULTILINE)
    assert set(listed) == BUILT
    for name in listed:
        out = output_of(call(name, "--help"))
        assert ("--resume" in out) == (name in ("run", "cost", "verify"))


def test_a_command_is_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A function with the name of its file; it is listed behind the usual ones."""
    (tmp_path / "greeted.py").write_text("def greeted() -> None:\n    pass\n\n\ndef other() -> None:\n    pass\n")
    monkeypatch.setattr(rooms, "__path__", [*rooms.__path__, str(tmp_path)])
    assert list(commands()) == [*FIRST.split(), "extract", "greeted"]


@pytest.mark.parametrize("name", sorted(BUILT))
def test_every_command_of_the_help_has_its_code(name: str, call: Call) -> None:
    """Commands import what they need when they are called, so a missing module shows only then."""
    words = {
        "run": ["block", "-q", *COARSE],
        "plan": ["block"],
        "mesh": ["block"],
        "contacts": ["block"],
        "cost": ["block", "--budget", "0"],
        "sweep": ["block", "steps.count=[0]"],
        "verify": ["no such case"],
        "new": ["block"],
    }
    code, _, err = call(name, *words.get(name, []))
    lacking = ("contacts", "cost", "sweep", "fclib", "report", "compare", "extract", "sensitivity", "fit")
    refused = dict.fromkeys(lacking, (2,))
    assert code in {"verify": (1, 2), **refused}.get(name, (0,))
    assert "Traceback" not in err


def test_no_command_shows_the_help(call: Call) -> None:
    assert call()[:2] == (0, call("--help")[1])


def test_version(call: Call) -> None:
    assert call("--version") == (0, f"{VERSION}\n", "")


@pytest.mark.parametrize("words", [["runn", "block"], ["run"], ["run", "block", "--frob"], ["plan", "block", "more"]])
def test_wrong_words_are_refused_with_one_line(words: list[str], call: Call, folder: Path) -> None:
    code, out, err = call(*words)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("stickslip: ")
    assert not list(folder.iterdir())


# --- scenes, new


def test_scenes_lists_every_ready_scene_with_its_title(call: Call) -> None:
    out = output_of(call("scenes"))
    assert out.splitlines() == [f"{name:<12} {read(name).title}" for name in READY_NAMES]


@pytest.mark.parametrize("name", READY_NAMES)
def test_new_copies_a_ready_scene_that_reads_back_the_same(name: str, call: Call, folder: Path) -> None:
    out = output_of(call("new", name, "mine.toml"))
    assert "mine.toml" in out
    mine, ready = read(folder / "mine.toml"), read(name)
    if isinstance(ready.geometry, UserFile) and isinstance(mine.geometry, UserFile):
        moved = folder if Path(ready.geometry.file).parent == READY else Path(ready.geometry.file).parent
        assert Path(mine.geometry.file).parent == moved  # what lies beside a ready scene comes along
        mine = replace(mine, geometry=replace(mine.geometry, file=ready.geometry.file))
    assert mine == ready


def test_new_names_its_file_after_the_scene_and_never_overwrites(call: Call, folder: Path) -> None:
    assert call("new", "block")[0] == 0
    (folder / "block.toml").write_text("mine now")
    assert_said(call("new", "block"), 2, "block.toml")
    assert (folder / "block.toml").read_text() == "mine now"


def test_new_refuses_a_name_that_hides_a_ready_scene(call: Call, folder: Path) -> None:
    for words in (("block", "cube"), ("cube", "--from", "none.step")):
        code, _, err = call("new", *words)
        assert (code, err) == (
            2,
            "stickslip: cube: expected a name that ends in .toml, for the scene that is written\n",
        )
    assert not list(folder.iterdir())


def test_a_disk_that_refuses_a_new_scene_is_none_of_the_user_s_mistakes(call: Call, folder: Path) -> None:
    (folder / "file").touch()
    code, _, err = call("new", "block", "file/mine.toml")
    assert (code, err) == (4, "stickslip: file/mine.toml: cannot be written: Not a directory\n")


def test_a_full_disk_leaves_no_part_of_a_new_scene(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_full(monkeypatch)
    code, _, err = call("new", "block", "mine.toml")
    assert (code, "No space left on device" in err) == (4, True)
    assert not [*folder.iterdir()]


def test_new_refuses_an_unknown_scene(call: Call, folder: Path) -> None:
    assert call("new", "blok") == (2, "", "stickslip: blok: no such ready scene; did you mean block?\n")
    assert not list(folder.iterdir())


def test_folders_that_are_named_for_an_output_are_made(call: Call, folder: Path) -> None:
    assert call("run", "block", "-q", "-o", "a/out", *COARSE)[0] == 0
    for words, made in (
        (("new", "block", "b/mine.toml"), "b/mine.toml"),
        (("report", "a/out", "-o", "c/page.html"), "c/page.html"),
        (("compare", "a/out", "a/out", "-o", "d/both.html"), "d/both.html"),
        (("mesh", "block", "-o", "e/block.msh", *COARSE), "e/block.msh"),
    ):
        code, _, err = call(*words)
        assert (code, err, (folder / made).is_file()) == (0, "", True)


# --- plan


def test_plan_says_effects_reasons_method_and_times_and_writes_nothing(call: Call, folder: Path) -> None:
    out = output_of(call("plan", "block"))
    for said in ("contacts.base.friction", "plane strain", "method auto", "2 steps at t = 1, 2", read("block").title):
        assert said in out
    assert not list(folder.iterdir())


def test_plan_for_scripts_agrees_with_the_run(call: Call, folder: Path) -> None:
    out = output_of(call("plan", "block", "--mesh", "--json", *COARSE))
    plan = json.loads(out)
    assert call("run", "block", "-q", "-o", "out", *COARSE)[0] == 0
    done = result(folder / "out")
    assert plan["effects"] == done["plan"]
    assert plan["method"] == "auto"
    assert plan["mesh"]["method"] == done["method"]
    assert plan["mesh"]["choice"] == done["choice"]
    assert plan["times"] == [step["time"] for step in done["steps"]]
    assert plan["mesh"]["displacement_unknowns"] == done["dofs"]
    assert plan["mesh"]["contacts"]["base"]["normal_points"] == done["contact_points"]
    assert plan["mesh"]["contacts"]["base"]["area"] == pytest.approx(4.0, rel=1e-12)  # length of the block


def test_plan_counts_the_mesh(call: Call) -> None:
    override = ["--set=geometry.mesh_size=0.5", "--set=geometry.cells='tensor'"]
    plan = json.loads(call("plan", "cube", "--mesh", "--json", *override)[1])
    assert (plan["mesh"]["cells"], plan["mesh"]["nodes"]) == (8, 27)
    assert plan["mesh"]["displacement_unknowns"] == 3 * (27 - 9)  # the top is held in x, y and z
    assert plan["mesh"]["contacts"]["base"]["normal_points"] == 9


# --- run


def test_quiet_run_is_silent(call: Call, folder: Path) -> None:
    assert call("run", "block", "-q", *COARSE) == (0, "", "")
    assert result(folder / "results" / "block")["status"] == "converged"  # the default folder


def test_run_says_where_the_results_are_and_verbose_says_each_iteration(call: Call, folder: Path) -> None:
    out, err = ended(call("run", "block", "-v", "-o", "out", *COARSE))
    assert read("block").title in out
    assert "results in out" in out
    rows = table(folder / "out" / "history.csv")
    assert len(re.findall(r"iteration \d+ +residual", err)) == len(rows)
    quieter = call("run", "block", "-o", "out", *COARSE)
    assert quieter[0] == 0
    assert "iteration 1 " not in quieter[2]


def test_set_overrides_numbers_words_and_tables(call: Call, folder: Path) -> None:
    more = ["--set", "solver.method=uzawa", "--set", "contacts.base.friction.mu=0.1", "--set", "title=A new title"]
    assert call("run", "block", "-q", "-o", "out", *COARSE, *more)[0] == 0
    done = result(folder / "out")
    assert done["method"] == "uzawa"
    assert done["scene"]["contacts"]["base"]["friction"] == {"law": "coulomb", "mu": 0.1}
    assert done["scene"]["title"] == "A new title"
    assert done["steps"][-1]["contacts"]["base"]["tangential_force"] > 0  # mu = 0.1: it slips more, and still rubs


def test_wrong_scene_leaves_earlier_results_alone(call: Call, folder: Path) -> None:
    assert call("run", "block", "-q", "-o", "out", *COARSE)[0] == 0
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert call("run", "block", "-q", "-o", "out", "--set", "bodies.block.nu=0.7")[0] == 2
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_slash_at_the_end_of_the_folder_means_nothing(call: Call, folder: Path) -> None:
    assert call("run", "block", "-q", "-o", "out/", *COARSE)[0] == 0
    assert sorted(path.name for path in folder.iterdir()) == ["out"]


def test_output_here_is_refused_or_solved_but_never_lost(call: Call, folder: Path) -> None:
    (folder / "mine.toml").write_text((READY / "block.toml").read_text())
    assert_said(call("run", "mine.toml", "-q", "-o", ".", *COARSE), 2)
    assert (folder / "mine.toml").exists()


def test_every_second_step_is_shown_and_all_are_stored(call: Call, folder: Path) -> None:
    assert call("run", "block", "-q", "-o", "out", *COARSE, "--set=steps.count=5", "--set=output.every=2")[0] == 0
    shown = re.findall(r"steps/(\d+)\.h5:/displacement", (folder / "out" / "fields.xdmf").read_text())
    assert [int(index) for index in shown] == [2, 4, 6]  # t = 0.4, 0.8, (1), 1.2, 1.6, 2: six times, and the last
    assert len(list((folder / "out" / "steps").glob("*.h5"))) == 6


def test_a_run_prints_its_result_for_scripts(call: Call, folder: Path) -> None:
    out, err = ended(call("run", "block", "-o", "out", "--json", *(f"--set={word}" for word in SMALL)))
    assert json.loads(out) == result(folder / "out")
    assert "unknown displacements" in err
    code, out, _ = call("run", "block", "-o", "out", "--json", "--set=bodies.block.nu=2")
    assert (code, out) == (2, "")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("stickslip sch", {"schema"}),
        ("stickslip run hal", {"half_ball", "half_disc", "half_space"}),
        ("stickslip plan m", {"mine.toml", "models/"}),
        ("stickslip run ./m", set()),
        ("stickslip run block --re", {"--resume"}),
    ],
)
def test_a_shell_completes_commands_scenes_and_options(
    words: str, expected: set[str], folder: Path, environment: dict[str, str]
) -> None:
    (folder / "mine.toml").touch()
    (folder / "models").mkdir()
    asked = {"_STICKSLIP_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1)}
    program = "import sys; sys.argv[0] = 'stickslip'; from stickslip.workflows.commands.start import main; main()"
    line, variables = [sys.executable, "-c", program], environment | asked
    done = subprocess.run(line, cwd=folder, env=variables, capture_output=True, text=True, check=False)
    assert (set(done.stdout.split()), done.stderr) == (expected, "")


def test_run_that_does_not_converge_ends_with_3_and_says_what_to_try(call: Call, folder: Path) -> None:
    words = ["--set=solver.method=uzawa", "--set=solver.max_iterations=1"]
    assert_said(call("run", "block", "-q", "-o", "out", *COARSE, *words), 3, "not converged", "solver.max_iterations")
    done = result(folder / "out")
    assert (done["status"], done["steps"]) == ("not_converged", [])


def test_run_that_fails_late_keeps_its_good_steps(call: Call, folder: Path) -> None:
    """No load until t = 1, and none that one iteration can follow after it."""
    top = "supports.top.displacement={x=0.0,y=[[0,0],[1,0],[2,-0.1]]}"
    words = ["--set=solver.method=uzawa", "--set=solver.max_iterations=1", "--set", top]
    assert_said(call("run", "block", "-q", "-o", "out", *COARSE, *words), 3)
    done = result(folder / "out")
    assert done["status"] == "not_converged"
    assert [step["time"] for step in done["steps"]] == [1.0]
    assert max(done["audit"].values()) <= 1e-8  # what is kept is an equilibrium
    assert sorted(path.name for path in (folder / "out" / "steps").iterdir()) == ["000001.h5"]
    assert "steps/000001.h5" in (folder / "out" / "fields.xdmf").read_text()
    rows = table(folder / "out" / "history.csv")
    assert {row["step"] for row in rows} == {"1", "2"}  # the failed attempts are told as well
    assert "ERROR" in (folder / "out" / "run.log").read_text()


@pytest.mark.parametrize(
    ("error", "code"),
    [(SolverError("no"), 3), (KeyboardInterrupt(), 130), (MemoryError(), 4), (StickslipError("no"), 1)],
)
def test_every_ending_has_its_exit_code(error: BaseException, code: int, capsys: pytest.CaptureFixture[str]) -> None:
    def fail() -> None:
        raise error

    assert guarded(fail) == code
    assert capsys.readouterr().err.count("\n") == 1


def test_full_disk_ends_with_4(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*arguments: object) -> None:
        raise OSError(28, os.strerror(28), "out/history.csv")

    monkeypatch.setattr(stickslip.workflows.run.run, "write_step", full)
    code, _, err = call("run", "block", "-q", "-o", "out", *COARSE)
    assert (code, err) == (4, "stickslip: out/history.csv: No space left on device\n")
    assert not (folder / "out").exists()


def test_what_friction_dissipated_is_said_with_its_error(call: Call, folder: Path) -> None:
    _, out, _ = call("run", "block", "-o", "out", *COARSE, "--set=output.error=true")
    assert re.search(r"friction dissipated [\d.]+ ± [\d.]+\*? J/m, time remainder \S+ ± \? J/m", out)
    assert "\nwithout ±: exact in the digits shown; grows: has no limit" in out
    call("run", "block", "-q", "-o", "unknown", *COARSE, "--set=output.error=false")
    _, out, _ = call("compare", "out", "unknown")
    row = next(line for line in out.splitlines() if "base: normal force" in line)
    assert re.search(r"│ +[\d.]+ ± [\d.]+ │ +[\d.]+ ± \? │", row)
    assert re.search(r"│ time \[s\] +│ +2 │ +2 │ +0 │", out)
    assert "\nB: without ±: exact in the digits shown; ± ?: not estimated, output.error = false" in out


def test_ctrl_c_in_a_write_leaves_readable_results(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = write_step

    def press(where: Path, index: int, *rest: Any) -> Path:
        if index == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return write(where, index, *rest)

    monkeypatch.setattr(stickslip.workflows.run.run, "write_step", press)
    ended(call("run", "block", "-q", "-o", "out", *COARSE, "--set=steps.count=8", "--set=output.error=true"), 130)
    done = result(folder / "out")
    assert done["status"] == "interrupted"
    stored = sorted(path.name for path in (folder / "out" / "steps").iterdir())
    assert len(stored) == len(done["steps"]) in (2, 3)
    assert {step["audit"] for step in done["steps"]} == set(done["audit"].values()) == {None}  # there is no time
    error = done["steps"][-1]["contacts"]["base"]["error"]["normal_force"]
    assert error["mesh"] is error["time_step"] is None  # they would have been found at the end
    shown = re.findall(r"steps/\d+\.h5", (folder / "out" / "fields.xdmf").read_text())
    assert sorted({name.partition("/")[2] for name in shown}) == stored
    times = {float(row["time"]) for row in table(folder / "out" / "probes.csv")}
    assert times == {step["time"] for step in done["steps"]}


def test_ctrl_c_ends_with_130_and_keeps_steps(folder: Path, command: list[str], environment: dict[str, str]) -> None:
    words = ["run", "block", "-o", "out", *COARSE, "--set=steps.count=4000"]
    pipes = {"stderr": subprocess.PIPE, "stdout": subprocess.PIPE}
    with running([*command, *words], cwd=folder, env=environment, **pipes) as process:
        for line in process.stderr:
            if line.startswith("t = "):
                break
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=100)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    done = result(folder / "out")
    assert done["status"] == "interrupted"
    assert 1 <= len(done["steps"]) == len(list((folder / "out" / "steps").iterdir())) < 4000
    assert sorted(path.name for path in folder.iterdir()) == ["out"]


def test_whoever_stops_listening_ends_the_run_and_the_steps_so_far_are_kept(
    folder: Path, command: list[str], environment: dict[str, str]
) -> None:
    """As `2>&1 | head` does; it must not end in PETSc's handler of the signal, which knows nothing of other ranks."""
    words = ["run", "block", "-o", "out", *COARSE, "--set=steps.count=4000"]
    with running([*command, *words], cwd=folder, env=environment, stderr=subprocess.PIPE) as process:
        for line in process.stderr:
            if line.startswith("t = "):
                break
        process.stderr.close()
        assert process.wait(timeout=100) == 1
    assert list((folder / ".out.running" / "steps").iterdir())


def test_ctrl_c_before_the_first_step_leaves_nothing(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def press(*arguments: Any) -> Simulation:
        os.kill(os.getpid(), signal.SIGINT)
        return prepare(*arguments)

    monkeypatch.setattr(stickslip.workflows.run.run, "prepare", press)
    code, _, err = call("run", "block", "-q", "-o", "out", *COARSE)
    assert (code, "Traceback" in err) == (130, False)
    assert not list(folder.iterdir())


def test_program_error_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line is for what a user can mend; a mistake of ours keeps its traceback."""

    def wrong(*arguments: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("stickslip.workflows.scene_file.read.read", wrong)
    with pytest.raises(ZeroDivisionError):
        guarded(lambda: app(["plan", "block"], standalone_mode=False))


def limited(kilobytes: int, folder: Path) -> tuple[int, str]:
    """Exit code and standard error under `ulimit -v`, as batch queues set it."""
    words = f"ulimit -v {kilobytes}; exec {sys.executable} -P -m stickslip plan block --mesh"
    done = subprocess.run(["bash", "-c", words], cwd=folder, env=child_environment(), capture_output=True, timeout=100)
    return done.returncode, done.stderr.decode()


@pytest.mark.parametrize("kilobytes", [200_000, 500_000, 700_000, 999_999])
def test_too_little_memory_for_the_libraries_ends_in_one_line(kilobytes: int, folder: Path) -> None:
    line = f"stickslip: ulimit -v {kilobytes}: too little memory, the libraries alone take nearly 1000000 kB\n"
    assert limited(kilobytes, folder) == (4, line)


def test_library_failing_to_load_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """As the dynamic loader says it: without a number."""

    def wrong(*arguments: object) -> None:
        raise OSError("libmumps.so: failed to map segment from shared object")

    monkeypatch.setattr("stickslip.workflows.scene_file.read.read", wrong)
    assert guarded(lambda: app(["plan", "block"], standalone_mode=False)) == 4
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("shared object; a library, a file or memory is missing (see ulimit -v)")


def test_with_just_enough_memory_a_scene_is_meshed(folder: Path) -> None:
    assert limited(1_000_000, folder) == (0, "")


def test_without_dolfinx_the_line_says_where_it_comes_from(folder: Path) -> None:
    words = "import sys; sys.modules['dolfinx'] = None; from stickslip.workflows.commands.cli import main; main()"
    environment = child_environment()
    done = subprocess.run(
        [sys.executable, "-P", "-c", words, "plan", "block"], cwd=folder, env=environment, capture_output=True
    )
    (line,) = done.stderr.decode().splitlines()
    assert (done.returncode, "any.whl[wheels]'" in line) == (4, True)


def test_without_a_drawing_library_results_stand(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr("stickslip.workflows.pictures.render.OFF_SCREEN", ("libnothing.so.1",))
    code, _, err = call("run", "cube", "-q", "-o", "out", "--set=geometry.mesh_size=0.5", "--set=output.pictures=true")
    assert (code, "no pictures could be drawn" in err, "libegl1" in err) == (0, True, True)
    assert (folder / "out" / "result.json").exists()
