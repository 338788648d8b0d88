"""Full disks, signals, kills and faults end a run by name, and leave files that go on."""

from __future__ import annotations

import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import time as clock
from functools import partial
from pathlib import Path

import pytest

from shared.cases import every_nth, slow
from shared.command import COARSE, LIMIT, Call, Start, assert_one_line, assert_said, result
from shared.disks import Disk, killed_at, make_read_only
from shared.drawn import write_long
from shared.histories import FOUR, LEARNS, RUN_FOUR, SMALL, Stop, assert_same, names_in
from shared.processes import catches, exit_code, forked, gmsh_child, is_there, running, wait_for
from stickslip.solvers.results.step_result import StepResult
from stickslip.workflows.formats.steps import step_name
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

SPEAKS = ["run", "block", "-o", "out", *COARSE]
ODD = ["ü ²", "a\nb", os.fsdecode(b"\xff"), "-v", "%s{}", "'\""]


# where nothing can be written


SILENT = ({"HOME": ""}, {"XDG_CONFIG_HOME": "/dev/null"}, {"HOME": "/dev/null", "XDG_CACHE_HOME": "relative"})


@pytest.mark.parametrize(
    "variables",
    [{"HOME": "/proc/1/nohome"}, *slow({"HOME": "/dev/null"}, {"XDG_CACHE_HOME": "/dev/null"}, *SILENT)],
)
def test_home_that_is_not_writable_is_no_obstacle(variables: dict[str, str | None], start: Start, folder: Path) -> None:
    kept = {"TMPDIR": str(folder), "XDG_CACHE_HOME": None, "MPLCONFIGDIR": None}
    few_forms = ("--set=output.error=false", "--set=output.audit=false")  # all are compiled again
    done = start("run", "block", "-q", "-o", "out", *COARSE[:2], *few_forms, variables=kept | variables)
    assert done.returncode == 0, done.stderr
    if variables not in SILENT:
        assert "stickslip: compiled forms are kept in" in done.stderr
        assert "compiled forms are kept in" in (folder / "out" / "run.log").read_text()


def test_no_place_for_compiled_forms_ends_with_4(folder: Path) -> None:
    nowhere = {"HOME": "/dev/null", "XDG_CACHE_HOME": "/dev/null"}
    broken = "import tempfile, sys; tempfile.gettempdir = lambda: '/dev/null'; import runpy; sys.argv = sys.argv[1:]; "
    program = broken + "runpy.run_module('stickslip.workflows.commands.start', run_name='__main__', alter_sys=False)"
    words, variables = [sys.executable, "-c", program, "stickslip", *SPEAKS], {**os.environ, **nowhere}
    done = subprocess.run(words, cwd=folder, env=variables, capture_output=True, text=True, timeout=LIMIT, check=False)
    assert done.returncode == 4, done.stderr
    assert_one_line(done.stderr)
    assert "compiled forms can be kept nowhere" in done.stderr


def test_settings_of_other_programs_in_the_working_folder_are_not_read(start: Start, folder: Path) -> None:
    """A run has the same bits wherever it is started."""
    for name in ("dolfinx_jit_parameters.json", "ffcx_parameters.json"):
        (folder / name).write_text("{")
    assert start(*SPEAKS).returncode == 0


@pytest.mark.parametrize("words", [SPEAKS, *slow(["scenes"], ["plan", "block"])])
def test_working_folder_that_is_gone_is_said(words: list[str], start: Start, folder: Path) -> None:
    gone = folder / "gone"
    gone.mkdir()
    done = start(*words, preexec_fn=lambda: (os.chdir(gone), os.rmdir(gone)), cwd=None)
    assert done.returncode == 4
    assert_one_line(done.stderr)
    assert "the working folder is gone" in done.stderr


# streams


@pytest.mark.parametrize(
    ("words", "closed"), every_nth(3, [SPEAKS, ["scenes"], ["mesh", "block", *COARSE[:2]]], [(0, 1, 2), (2,), (1,)])
)
def test_closed_streams_change_nothing(words: list[str], closed: tuple[int, ...], start: Start, folder: Path) -> None:
    done = start(*words, preexec_fn=lambda: [os.close(number) for number in closed])
    assert done.returncode == 0, done.stderr
    if words == SPEAKS:
        assert result(folder / "out")["status"] == "converged"


@pytest.mark.parametrize("words", [SPEAKS, *slow(["scenes"], ["mesh", "block", *COARSE[:2]])])
def test_full_disk_behind_stdout_ends_with_4(words: list[str], start: Start, folder: Path) -> None:
    with open("/dev/full", "w") as full:
        done = start(*words, stdout=full)
    assert done.returncode == 4, done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.endswith("what is printed cannot be written: No space left on device\n")
    if words == SPEAKS:
        assert result(folder / "out")["status"] == "converged"


def test_full_disk_behind_stderr_does_not_change_the_exit_code(start: Start) -> None:
    with open("/dev/full", "w") as full:
        assert start("run", "nosuchscene", stderr=full).returncode == 2
        assert start(*SPEAKS, stderr=full).returncode in (0, 4)


@pytest.mark.parametrize("words", [SPEAKS, ["--help"], *slow(["scenes"], ["mesh", "block", *COARSE[:2]])])
def test_reader_that_goes_ends_without_a_word(words: list[str], start: Start, folder: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = start(*words, stdout=writer)
    finally:
        os.close(writer)
    assert done.returncode == 1, done.stderr
    assert "PETSC" not in done.stderr
    assert "Traceback" not in done.stderr
    if words == SPEAKS:
        assert result(folder / "out")["status"] == "converged"


@pytest.mark.parametrize("locale", [{"LANG": "C", "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}])
@pytest.mark.parametrize("name", ["-ü ²\n%s{}'\"" + os.fsdecode(b"\xff"), *slow(*ODD)])
def test_odd_names_and_plain_terminals(locale: dict[str, str | None], name: str, start: Start, folder: Path) -> None:
    done = start("run", "block", f"-o{name}", *COARSE, variables=locale)
    assert done.returncode == 0, done.stderr
    assert result(folder / name)["status"] == "converged"


@pytest.mark.parametrize("name", ["x" * 250, "x" * 5000, "y/" * 3000])
def test_names_that_no_disk_has_are_refused(name: str, call: Call) -> None:
    assert_said(call("run", "block", "-q", "-o", name, *COARSE), 2, "-o", "File name too long")


# signals


@pytest.mark.parametrize(
    ("number", "part"), every_nth(4, [signal.SIGINT, signal.SIGTERM, signal.SIGUSR1], [0.0, 0.2, 0.7, 1.4])
)
def test_signal_while_it_starts_ends_with_130(
    number: signal.Signals, part: float, folder: Path, command: list[str], environment: dict[str, str]
) -> None:
    """From the first lines of our own on: that SIGUSR1 is caught shows that they were reached."""
    words = [*RUN_FOUR, "--set=steps.count=4000"]
    with running([*command, *words], cwd=folder, env=environment, stderr=subprocess.PIPE) as process:
        wait_for(lambda: catches(process.pid, signal.SIGUSR1), "the first lines", process.pid)
        clock.sleep(part)
        process.send_signal(number)
        _, err = process.communicate(timeout=LIMIT)
    assert process.returncode == 130, err
    assert_one_line(err)
    assert "interrupted" in err


@pytest.mark.parametrize("moment", ["start._stay_alone", "logging.getLogger"])
def test_signal_between_two_imports_ends_with_130(moment: str, folder: Path, environment: dict[str, str]) -> None:
    """Where neither an import nor the command looks out for it: there it was a traceback, and was met by chance."""
    kill = "lambda *_: os.kill(os.getpid(), signal.SIGTERM)"
    program = "import logging, os, signal, sys; from stickslip.workflows.commands import cli, start; "
    program += f"sys.argv += ['scenes']; {moment} = {kill}; start.main()"
    words = [sys.executable, "-c", program]
    done = subprocess.run(
        words, cwd=folder, env=environment, capture_output=True, text=True, timeout=LIMIT, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "stickslip: interrupted\n")


def test_ctrl_c_that_is_ignored_is_not_heard_but_other_signals_are(
    folder: Path, command: list[str], environment: dict[str, str]
) -> None:
    """As after nohup, and in a script's background: there Ctrl-C is for what the script waits for."""
    ignore = partial(signal.signal, signal.SIGINT, signal.SIG_IGN)
    words = [*RUN_FOUR, "--set=steps.count=4000"]
    with running([*command, *words], cwd=folder, env=environment, stderr=subprocess.PIPE, preexec_fn=ignore) as process:
        for _ in range(5):  # while it starts, and within iterations
            process.send_signal(signal.SIGINT)
            clock.sleep(0.1)
        wait_for((folder / ".out.running" / step_name(1)).exists, "a step", process.pid)
        process.send_signal(signal.SIGINT)
        wait_for((folder / ".out.running" / step_name(4)).exists, "a step after it", process.pid)
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=LIMIT)
    assert process.returncode == 130, err
    assert "stopped by SIGTERM" in err


@pytest.mark.parametrize(("doing", "number"), every_nth(3, ["meshing", "reading"], [signal.SIGTERM, signal.SIGINT]))
def test_signal_while_gmsh_works_ends_both_at_once(
    doing: str, number: signal.Signals, folder: Path, command: list[str], environment: dict[str, str]
) -> None:
    """gmsh's own process does not end by itself for minutes."""
    words = ["run", str(write_long(folder, doing)), "-q", "-o", "out"]
    with running([*command, *words], cwd=folder, env=environment, stderr=subprocess.PIPE) as process:
        child = gmsh_child(process.pid, doing)
        clock.sleep(1.0)  # for gmsh to be at work
        process.send_signal(number)
        _, err = process.communicate(timeout=LIMIT)
    assert process.returncode == 130, err
    assert_one_line(err)
    assert "interrupted" in err
    assert not is_there(child)
    assert {path.name for path in folder.iterdir()} == {"b.geo", "b.toml"}


HANGS = {  # what never comes back, and never lets Python hear a signal
    "factorisation": "solvers.simulation.simulation.MethodChain",
    "drawing": "workflows.pictures.draw.draw",
    "meshing": "solvers.simulation.simulation.build_mesh",
    "errors": "solvers.accuracy.budget.TimeStepErrors",
    "audit": "workflows.run.run.audit_steps",
}


@pytest.mark.parametrize("phase", every_nth(2, HANGS))
def test_ctrl_c_is_answered_and_obeyed_while_a_library_works(
    phase: str, folder: Path, environment: dict[str, str]
) -> None:
    place, _, name = f"stickslip.{HANGS[phase]}".rpartition(".")
    program = "import sys; from collections import deque; from itertools import repeat; from importlib import "
    program += "import_module; from stickslip.workflows.commands import start; "
    program += "hang = lambda *_, **__: (print('hangs', file=sys.stderr, flush=True), deque(repeat(0), maxlen=0)); "
    program += f"setattr(import_module({place!r}), {name!r}, hang); start.main()"
    words = [sys.executable, "-c", program, "run", "block", "-o", "out", *COARSE]
    words += [f"--set=output.{key}=true" for key in ("error", "pictures")]
    with running(words, cwd=folder, env=environment, stderr=subprocess.PIPE) as process:
        assert "hangs\n" in iter(process.stderr.readline, "")
        began = clock.monotonic()
        process.send_signal(signal.SIGINT)
        assert process.stderr.readline() == "stickslip: stopping; what does not stop in five seconds is ended\n"
        answered = clock.monotonic() - began
        process.wait(timeout=LIMIT)
        obeyed = clock.monotonic() - began
        rest = process.stderr.read()
    assert process.returncode == -signal.SIGKILL
    assert rest == "stickslip: interrupted; solved steps are kept, --resume goes on from them\n"
    assert answered < 1.0
    assert 3.9 < obeyed < 8.0  # five on a machine that is not busy
    kept = phase in ("drawing", "errors", "audit")
    assert (folder / ".out.running" / step_name(1)).exists() == kept


# read-only results, and clocks


def test_finished_results_that_may_only_be_read_are_said_to_be_finished(
    call: Call, whole: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = Path(shutil.copytree(whole, folder / "out"))
    with monkeypatch.context() as patch:
        make_read_only(place, patch)
        code, _, err = call(*RUN_FOUR, "--resume")
    assert code == 0, err
    assert "the run is finished; nothing was changed" in err


def test_stopped_results_that_may_only_be_read_are_refused_and_kept(
    call: Call, stopped: Path, whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = {name: (stopped / name).read_bytes() for name in names_in(stopped)}
    with monkeypatch.context() as patch:
        make_read_only(stopped, patch)
        code, _, err = call(*RUN_FOUR, "--resume")
    assert code == 4
    assert_one_line(err)
    assert "out: cannot be written: Read-only file system" in err
    assert {name: (stopped / name).read_bytes() for name in names_in(stopped)} == before
    assert call(*RUN_FOUR, "--resume")[0] == 0
    assert_same(stopped, whole)


def test_disk_that_becomes_read_only_while_it_works(
    call: Call, folder: Path, whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:

        def turn(self: object, step: StepResult) -> None:
            if step.time == 1.0:
                make_read_only(folder, patch)

        patch.setattr("stickslip.workflows.run.terminal.Reporter._step", turn)
        code, _, err = call(*RUN_FOUR)
    assert code == 4
    assert_one_line(err)
    assert "Read-only file system; 2 steps are kept, go on with --resume" in err
    assert call(*RUN_FOUR, "--resume")[0] == 0
    assert_same(folder / "out", whole)


def test_clock_set_back_changes_nothing(call: Call, folder: Path, whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also files that are dated in the future."""
    now = 2e9

    def back() -> float:
        nonlocal now
        now -= 3600.0
        return now

    with monkeypatch.context() as patch:
        patch.setattr("time.time", back)
        patch.setattr(
            "stickslip.workflows.run.terminal.Reporter._step",
            lambda self, step: Stop(1)(step) if step.time == 1.0 else None,
        )
        assert call(*RUN_FOUR)[0] == 130
        for name in names_in(folder / "out"):
            os.utime(folder / "out" / name, (4e9, 4e9))
    assert call(*RUN_FOUR, "--resume")[0] == 0
    assert_same(folder / "out", whole)
    assert min(result(folder / "out")["seconds"][key] for key in ("mesh", "assemble", "iterate", "total")) >= 0


SCENE = [*SMALL, *LEARNS, "steps.count=4"]
BY_TIME, SPARE = 20, 12  # steps of a run that is killed by the clock; those after the last moment: it still runs then
LONGER = [*SMALL, *LEARNS, f"steps.count={BY_TIME}", "output.error=false"]
WORDS = ["run", "block", "-q", "-o", "out", *(f"--set={word}" for word in LONGER)]
SEED = "STICKSLIP_SEED"  # in the environment: other moments, or those of an earlier test again
LONG = 3600  # s, for hundreds of runs on a busy machine
TORN = 5  # bytes of a last row that a crash keeps from the disk


@pytest.fixture(scope="module")
def learning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a run with a method that learns, which was left alone."""
    folder = tmp_path_factory.mktemp("whole") / "out"
    run(read("block", SCENE), folder)
    return folder


def killed(change: int, folder: Path, resume: bool) -> bool:
    """Whether a run got so far that it was, before this change of the disk."""
    return killed_at(change, folder.parent, lambda: run(read("block", SCENE), folder, resume=resume), TORN)


def changes(folder: Path) -> int:
    """How often a run changes the disk."""
    with pytest.MonkeyPatch.context() as patch:
        disk = Disk(folder.parent)
        disk.watch(patch)
        run(read("block", SCENE), folder)
    return disk.count


def _moments(count: int, seed: int = 0) -> list[float]:
    """Parts of a run."""
    seed = int(os.environ.get(SEED, seed))
    print(f"{SEED}={seed}")
    lots = random.Random(seed)
    return [lots.random() for _ in range(count)]


def test_killed_at_moments_of_writing_it_goes_on(tmp_path: Path, learning: Path) -> None:
    """The last one too, when all is solved and the files of what was learnt are gone."""
    last = changes(tmp_path / "counted" / "out")
    for change in {*(1 + int(part * last) for part in _moments(1)), last}:
        folder = tmp_path / f"{change}" / "out"
        assert killed(change, folder, resume=False)
        run(read("block", SCENE), folder, resume=True)
        assert_same(folder, learning)
        assert names_in(folder.parent) == {f"out/{name}" for name in names_in(learning)}


@pytest.mark.slow
@pytest.mark.timeout(LONG)
def test_killed_at_every_moment_of_writing_it_goes_on(tmp_path: Path, learning: Path) -> None:
    """And killed again while it resumes, at a moment as early."""
    for change in range(1, changes(tmp_path / "counted" / "out") + 1):
        folder = tmp_path / f"{change}" / "out"
        assert killed(change, folder, resume=False)
        killed(change // 2, folder, resume=True)
        run(read("block", SCENE), folder, resume=True)
        assert_same(folder, learning)


# by the clock


class Lot:
    """A moment between the first steps' files: how long start-up and mesh take does not count."""

    def __init__(self, part: float) -> None:
        whole, self.rest = divmod(part * (BY_TIME - SPARE), 1.0)
        self.step = 1 + int(whole)

    def kill(self, process: int, folder: Path, pace: float) -> None:
        """A part of a step's time after that step's file has appeared."""
        reached(self.step, folder, process)
        clock.sleep(self.rest * pace)
        os.kill(process, signal.SIGKILL)
        assert exit_code(process) == -signal.SIGKILL  # it had not ended by itself

    def check(self, folder: Path) -> None:
        """The run went on from there, or from a step that came between."""
        (done,) = re.findall(r"resumed after step (\d+),", (folder / "run.log").read_text())
        assert self.step <= int(done) <= BY_TIME


def reached(step: int, folder: Path, process: int) -> float:
    """The time at which its file was there."""
    path = folder.with_name(f".{folder.name}.running") / step_name(step)
    wait_for(path.exists, path.name, process)
    return clock.monotonic()


def pace_of(process: int, folder: Path) -> float:
    """Seconds a step of a run that is left alone."""
    first, last = (reached(step, folder, process) for step in (1, BY_TIME - 1))
    assert exit_code(process) == 0
    return (last - first) / (BY_TIME - 2)


@pytest.mark.slow
@pytest.mark.timeout(LONG)
def test_command_killed_at_random_times_goes_on(folder: Path, command: list[str], environment: dict[str, str]) -> None:
    def start(place: Path) -> int:
        place.mkdir()

        def become() -> None:
            os.chdir(place)
            os.execve(command[0], [*command, *WORDS], environment)

        return forked(become)

    alone = folder / "alone" / "out"
    pace = pace_of(start(alone.parent), alone)
    for number, lot in enumerate(map(Lot, _moments(20, random.SystemRandom().randrange(10**6)))):
        place = folder / f"{number}"
        lot.kill(start(place), place / "out", pace)
        assert subprocess.run([*command, *WORDS, "--resume"], cwd=place, env=environment, check=False).returncode == 0
        lot.check(place / "out")
        assert_same(place / "out", alone)


def test_third_ctrl_c_ends_it_at_once(tmp_path: Path, learning: Path) -> None:
    """In the middle of an iteration, with the steps so far where `--resume` finds them."""

    def press(step: StepResult) -> None:
        if step.time == 1.0:
            for _ in range(3):
                os.kill(os.getpid(), signal.SIGINT)
            os.kill(os.getpid(), signal.SIGKILL)  # reached if it goes on

    folder = tmp_path / "out"
    assert exit_code(forked(lambda: run(read("block", SCENE), folder, Watch(on_step=press)))) == 130
    assert not folder.exists()
    run(read("block", SCENE), folder, resume=True)
    assert "resumed after step 2," in (folder / "run.log").read_text()
    assert_same(folder, learning)


# a full disk


@pytest.mark.parametrize(("room", "name"), [(1_000, "contact_base.csv"), (20_000, "steps/000003.h5")])
def test_full_disk_loses_no_step_and_the_run_goes_on_when_there_is_room(
    room: int, name: str, call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After two steps no file can grow beyond `room` bytes: a table, or the next step."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill(self: object, step: StepResult) -> None:
        if step.time == 1.0:
            resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))

    with monkeypatch.context() as patch:
        patch.setattr("stickslip.workflows.run.terminal.Reporter._step", fill)
        try:
            code, _, err = call(*RUN_FOUR)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert (code, err.count("\n")) == (4, 1)
    assert f"{name}: cannot be written: File too large; 2 steps are kept, go on with --resume" in err
    assert sorted(path.name for path in (folder / ".out.running" / "steps").iterdir()) == ["000001.h5", "000002.h5"]
    assert call(*RUN_FOUR, "--resume") == (0, "", "")
    run(read("block", FOUR), folder / "whole")
    assert_same(folder / "out", folder / "whole")
