"""How a run ends when it does not end well."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import stickslip.workflows.run.run
from shared.command import COARSE, Call, result, table
from shared.processes import running
from stickslip.geometry.errors import SolverError, StickslipError
from stickslip.geometry.user_files.child_process import child_environment
from stickslip.solvers.simulation.simulation import Simulation, prepare
from stickslip.workflows.commands.cli import app, guarded
from stickslip.workflows.formats.steps import write_step


def test_run_that_does_not_converge_ends_with_3_and_says_what_to_try(call: Call, folder: Path) -> None:
    words = ["--set=solver.method=uzawa", "--set=solver.max_iterations=1"]
    code, out, err = call("run", "block", "-q", "-o", "out", *COARSE, *words)
    assert (code, out, err.count("\n")) == (3, "", 1)
    assert "not converged" in err
    assert "solver.max_iterations" in err
    done = result(folder / "out")
    assert (done["status"], done["steps"]) == ("not_converged", [])


def test_run_that_fails_late_keeps_its_good_steps(call: Call, folder: Path) -> None:
    """No load until t = 1, and none that one iteration can follow after it."""
    top = "supports.top.displacement={x=0.0,y=[[0,0],[1,0],[2,-0.1]]}"
    words = ["--set=solver.method=uzawa", "--set=solver.max_iterations=1", "--set", top]
    code, _, err = call("run", "block", "-q", "-o", "out", *COARSE, *words)
    assert (code, err.count("\n")) == (3, 1)
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


def test_ctrl_c_while_a_step_is_written_leaves_readable_results(
    call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = write_step

    def press(where: Path, index: int, *rest: Any) -> Path:
        if index == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return write(where, index, *rest)

    monkeypatch.setattr(stickslip.workflows.run.run, "write_step", press)
    code, _, err = call("run", "block", "-q", "-o", "out", *COARSE, "--set=steps.count=8")
    assert code == 130, err
    done = result(folder / "out")
    assert done["status"] == "interrupted"
    stored = sorted(path.name for path in (folder / "out" / "steps").iterdir())
    assert len(stored) == len(done["steps"]) in (2, 3)
    assert {step["audit"] for step in done["steps"]} == set(done["audit"].values()) == {None}  # there is no time
    shown = re.findall(r"steps/\d+\.h5", (folder / "out" / "fields.xdmf").read_text())
    assert sorted({name.partition("/")[2] for name in shown}) == stored
    times = {float(row["time"]) for row in table(folder / "out" / "probes.csv")}
    assert times == {step["time"] for step in done["steps"]}


def test_ctrl_c_ends_with_130_and_keeps_the_steps_so_far(
    folder: Path, command: list[str], environment: dict[str, str]
) -> None:
    words = ["run", "block", "-o", "out", *COARSE, "--set=steps.count=4000"]
    pipes = {"stderr": subprocess.PIPE, "stdout": subprocess.PIPE}
    with running([*command, *words], cwd=folder, env=environment, **pipes) as process:
        assert process.stderr is not None
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
        assert process.stderr is not None
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


@pytest.mark.parametrize("kilobytes", [200_000, 500_000, 700_000, 999_999])
def test_too_little_memory_for_the_libraries_ends_in_one_line(kilobytes: int, folder: Path) -> None:
    """`ulimit -v`, as batch queues set it."""
    words = f"ulimit -v {kilobytes}; exec {sys.executable} -P -m stickslip plan block --mesh"
    done = subprocess.run(["bash", "-c", words], cwd=folder, env=child_environment(), capture_output=True, timeout=100)
    assert (done.returncode, done.stdout) == (4, b"")
    (line,) = done.stderr.decode().splitlines()
    assert line == f"stickslip: ulimit -v {kilobytes}: too little memory, the libraries alone take nearly 1000000 kB"


def test_library_that_cannot_be_loaded_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As the dynamic loader says it: without a number."""

    def wrong(*arguments: object) -> None:
        raise OSError("libmumps.so: failed to map segment from shared object")

    monkeypatch.setattr("stickslip.workflows.scene_file.read.read", wrong)
    assert guarded(lambda: app(["plan", "block"], standalone_mode=False)) == 4
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("shared object; a library, a file or memory is missing (see ulimit -v)")


def test_with_just_enough_memory_a_scene_is_meshed(folder: Path) -> None:
    words = f"ulimit -v 1000000; exec {sys.executable} -P -m stickslip plan block --mesh"
    done = subprocess.run(["bash", "-c", words], cwd=folder, env=child_environment(), capture_output=True, timeout=100)
    assert (done.returncode, done.stderr) == (0, b"")


def test_without_dolfinx_the_line_says_where_it_comes_from(folder: Path) -> None:
    words = "import sys; sys.modules['dolfinx'] = None; from stickslip.workflows.commands.cli import main; main()"
    environment = child_environment()
    done = subprocess.run(
        [sys.executable, "-P", "-c", words, "plan", "block"], cwd=folder, env=environment, capture_output=True
    )
    (line,) = done.stderr.decode().splitlines()
    assert (done.returncode, "any.whl[wheels]'" in line) == (4, True)


def test_without_a_library_that_draws_the_results_stand(
    call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr("stickslip.workflows.pictures.render.OFF_SCREEN", ("libnothing.so.1",))
    code, _, err = call("run", "cube", "-q", "-o", "out", "--set=geometry.mesh_size=0.5", "--set=output.pictures=true")
    assert (code, "no pictures could be drawn" in err, "libegl1" in err) == (0, True, True)
    assert (folder / "out" / "result.json").exists()
