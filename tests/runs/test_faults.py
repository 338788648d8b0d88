"""Faults of the environment and false claims of the files: one line that is true, and the exit code that README has."""

from __future__ import annotations

import errno
import io
import os
import pickle
import shutil
import signal
import subprocess
import sys
import time as clock
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from petsc4py import PETSc

import stickslip
from geometry.arrays import Array
from geometry.errors import MachineError, SceneError
from shared.command import COARSE, Call, result
from shared.histories import SMALL, Stop, assert_same, names_in
from shared.ranks import mpirun
from solvers.interface import factorised
from solvers.parallel.counters import Counters
from solvers.results.step_result import StepResult
from workflows.commands.cli import LONGEST, shortened
from workflows.formats.steps import step_name
from workflows.run.folder import BEGUN, RESULT
from workflows.run.run import run
from workflows.run.watch import Watch
from workflows.scene_file.read import read

SCENE = [*SMALL, "steps.count=4"]
WORDS = ["run", "block", "-q", "-o", "out", *(f"--set={word}" for word in SCENE)]
SPEAKS = ["run", "block", "-o", "out", *COARSE]
LIMIT = 60  # s


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole") / "out"
    run(read("block", SCENE), folder)
    return folder


@pytest.fixture(scope="module")
def stopped_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stopped") / "out"
    run(read("block", SCENE), folder, Watch(on_step=Stop(2)))
    return folder


@pytest.fixture
def stopped(folder: Path, stopped_once: Path) -> Path:
    """Results of a run that was stopped after two steps."""
    return Path(shutil.copytree(stopped_once, folder / "out"))


Start = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def start(folder: Path, command: list[str], environment: dict[str, str]) -> Start:
    """Run `stickslip WORDS` as a process, with other variables and streams."""

    def act(*words: str, variables: dict[str, str | None] | None = None, **options: Any) -> Any:
        found = {key: value for key, value in (environment | (variables or {})).items() if value is not None}
        streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | options
        return subprocess.run(
            [*command, *words], **{"cwd": folder, "env": found, "text": True, "timeout": LIMIT, **streams}, check=False
        )

    return act


def assert_one_line(err: str) -> None:
    assert (err.count("\n"), "Traceback" in err, len(err) < 300) == (1, False, True), err


# where nothing can be written


@pytest.mark.parametrize(
    "variables",
    [
        {"HOME": "/proc/1/nohome"},
        {"HOME": "/dev/null"},
        {"HOME": ""},
        {"XDG_CACHE_HOME": "/dev/null"},
        {"XDG_CONFIG_HOME": "/dev/null"},
        {"HOME": "/dev/null", "XDG_CACHE_HOME": "relative"},
    ],
)
def test_home_that_cannot_be_written_is_no_obstacle(
    variables: dict[str, str | None], start: Start, folder: Path
) -> None:
    kept = {"TMPDIR": str(folder), "XDG_CACHE_HOME": None, "MPLCONFIGDIR": None}
    done = start("run", "block", "-q", "-o", "out", *COARSE[:2], variables=kept | variables)
    assert done.returncode == 0, done.stderr
    if variables not in (
        {"XDG_CONFIG_HOME": "/dev/null"},
        {"HOME": ""},
        {"HOME": "/dev/null", "XDG_CACHE_HOME": "relative"},
    ):
        assert "stickslip: compiled forms are kept in" in done.stderr
        assert "compiled forms are kept in" in (folder / "out" / "run.log").read_text()


def test_no_place_for_compiled_forms_ends_with_4(start: Start) -> None:
    nowhere = {"HOME": "/dev/null", "XDG_CACHE_HOME": "/dev/null"}
    broken = "import tempfile, sys; tempfile.gettempdir = lambda: '/dev/null'; import runpy; sys.argv = sys.argv[1:]; "
    program = broken + "runpy.run_module('workflows.commands.start', run_name='__main__', alter_sys=False)"
    done = subprocess.run(
        [sys.executable, "-c", program, "stickslip", *SPEAKS],
        env={**os.environ, **nowhere},
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )
    assert done.returncode == 4, done.stderr
    assert_one_line(done.stderr)
    assert "compiled forms can be kept nowhere" in done.stderr


def test_settings_of_other_programs_in_the_working_folder_are_not_read(start: Start, folder: Path) -> None:
    """A run has the same bits wherever it is started."""
    for name in ("dolfinx_jit_parameters.json", "ffcx_parameters.json"):
        (folder / name).write_text("{")
    assert start(*SPEAKS).returncode == 0


@pytest.mark.parametrize("words", [SPEAKS, ["scenes"], ["plan", "block"]])
def test_working_folder_that_is_gone_is_said(words: list[str], start: Start, folder: Path, tmp_path: Path) -> None:
    gone = folder / "gone"
    gone.mkdir()
    done = start(*words, preexec_fn=lambda: (os.chdir(gone), os.rmdir(gone)), cwd=None)
    assert done.returncode == 4
    assert_one_line(done.stderr)
    assert "the working folder is gone" in done.stderr


# streams


@pytest.mark.parametrize("words", [SPEAKS, ["scenes"], ["mesh", "block", *COARSE[:2]]])
@pytest.mark.parametrize("closed", [(1,), (2,), (0, 1, 2)])
def test_closed_streams_change_nothing(words: list[str], closed: tuple[int, ...], start: Start, folder: Path) -> None:
    done = start(*words, preexec_fn=lambda: [os.close(number) for number in closed])
    assert done.returncode == 0, done.stderr
    if words == SPEAKS:
        assert result(folder / "out")["status"] == "converged"


@pytest.mark.parametrize("words", [SPEAKS, ["scenes"], ["mesh", "block", *COARSE[:2]]])
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


@pytest.mark.parametrize("words", [SPEAKS, ["scenes"], ["mesh", "block", *COARSE[:2]], ["--help"]])
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
@pytest.mark.parametrize("name", ["ü ²", "a\nb", os.fsdecode(b"\xff"), "-v", "%s{}", "'\""])
def test_odd_names_and_plain_terminals(locale: dict[str, str | None], name: str, start: Start, folder: Path) -> None:
    done = start("run", "block", f"-o{name}", *COARSE, variables=locale)
    assert done.returncode == 0, done.stderr
    assert result(folder / name)["status"] == "converged"


@pytest.mark.parametrize("name", ["x" * 250, "x" * 5000, "y/" * 3000])
def test_names_that_no_disk_has_are_refused(name: str, call: Call) -> None:
    code, _, err = call("run", "block", "-q", "-o", name, *COARSE)
    assert code == 2
    assert_one_line(err)
    assert "-o" in err
    assert "File name too long" in err


# signals


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGUSR1])
@pytest.mark.parametrize("part", [0.1, 0.3, 0.8, 1.5])
def test_signal_while_it_starts_ends_with_130(
    number: signal.Signals, part: float, folder: Path, command: list[str], environment: dict[str, str]
) -> None:
    """From the first line of our own on; Python itself needs some hundredths of a second to get there."""
    words = [*WORDS, "--set=steps.count=4000"]
    with subprocess.Popen(
        [*command, *words], cwd=folder, env=environment, stderr=subprocess.PIPE, text=True
    ) as process:
        clock.sleep(part)
        process.send_signal(number)
        _, err = process.communicate(timeout=LIMIT)
    assert process.returncode == 130, err
    assert_one_line(err)
    assert "interrupted" in err


def test_signal_on_two_ranks_while_they_start(folder: Path) -> None:
    """The rank that is told ends the others."""
    program = "import os, signal, sys; from workflows.commands import start; "
    program += "os.environ['OMPI_COMM_WORLD_RANK'] == '1' and signal.setitimer(signal.ITIMER_REAL, .7); "
    program += "signal.signal(signal.SIGALRM, lambda *rest: os.kill(os.getpid(), signal.SIGTERM)); start.main()"
    done = mpirun(2, WORDS, folder, ("-c", program), limit=LIMIT)
    assert done.returncode not in (0, 124), done.stderr
    assert "Traceback" not in done.stderr
    assert not (folder / "out").exists()


# from Python


def test_first_use_outside_the_main_thread(tmp_path: Path) -> None:
    program = (
        "import threading, stickslip\n"
        "def act():\n"
        f"    found.append(stickslip.run(stickslip.read('block', {SCENE!r}), 'out')[0].status)\n"
        "found = []\n"
        "thread = threading.Thread(target=act)\n"
        "thread.start()\n"
        "thread.join()\n"
        "assert found == ['converged'], found\n"
        f"stickslip.prepare(stickslip.read('block', {SCENE!r}))\n"  # and then in the main one
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=LIMIT, check=False
    )
    assert done.returncode == 0, done.stderr


def test_results_and_scenes_can_be_pickled() -> None:
    scene = read("block", SCENE)
    simulation = stickslip.prepare(scene)
    step = next(simulation.steps())
    for one in (scene, step, simulation.data):
        again = pickle.loads(pickle.dumps(one))
        assert type(again) is type(one)
    again = pickle.loads(pickle.dumps(step))
    assert again.contacts["base"].normal_force == step.contacts["base"].normal_force
    assert np.array_equal(again.displacement, step.displacement)
    assert pickle.loads(pickle.dumps(scene)) == scene


@pytest.mark.parametrize("end", ["1e-300", "5e-324", "1e300"])
def test_times_beyond_all_measure_are_refused(end: str, call: Call) -> None:
    code, _, err = call(*WORDS, f"--set=steps.end={end}")
    assert code == 2
    assert_one_line(err)
    assert "steps.end" in err


def test_motions_whose_squares_are_zero_are_audited(call: Call, folder: Path) -> None:
    tiny = [f"--set=supports.top.displacement.{axis}={value}" for axis, value in (("x", "1e-302"), ("y", "-1e-302"))]
    assert call(*WORDS, *tiny)[0] in (0, 1)
    assert result(folder / "out")["audit"]["dissipation"] == 0.0


@dataclass(frozen=True, kw_only=True)
class Odd(stickslip.Obstacle):
    """An obstacle whose formulas are wrong."""

    far: float
    long: float
    shape: Annotated[Literal["odd"], stickslip.Key("-", "kind of obstacle")] = "odd"

    def distance(self, x: Any, sqrt: Callable[[Any], Any]) -> Any:
        return 0.0 * x[1] + self.far

    def normals(self, points: Array) -> Array:
        return np.tile([0.0, self.long], (len(points), 1))


stickslip.Obstacle.kinds.remove(Odd)  # no other test knows it


@pytest.mark.parametrize(
    ("far", "long", "said"),
    [
        (np.nan, 1.0, "distance is nan"),
        (np.inf, 1.0, "distance is inf"),
        (0.0, np.nan, "nan long"),
        (0.0, 2.0, "2 long"),
    ],
)
def test_obstacle_without_a_distance_is_named(far: float, long: float, said: str) -> None:
    scene = replace(read("block", SCENE), obstacles={"foundation": Odd(far=far, long=long)})
    with pytest.raises(SceneError, match=rf"obstacle Odd: at \(.*\).*{said}.*expected a number, and a unit vector"):
        list(stickslip.steps(scene))


# what is said is true


def test_steps_that_are_gone_are_not_said_to_be_kept(call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def lose(self: object, step: StepResult) -> None:
        if step.time == 1.0:
            shutil.rmtree(folder / ".out.running")

    monkeypatch.setattr("workflows.run.terminal.Reporter._step", lose)
    code, _, err = call(*WORDS)
    assert code == 4
    assert_one_line(err)
    assert ".out.running: is gone, and with it the steps so far" in err
    assert "kept" not in err
    assert "--resume" not in err


def test_lost_beginning_does_not_send_in_a_circle(call: Call, stopped: Path) -> None:
    (stopped / BEGUN).unlink()
    before = {name: (stopped / name).read_bytes() for name in names_in(stopped)}
    code, _, err = call(*WORDS)
    assert (code, "--resume" in err, f"without its {BEGUN}" in err) == (2, False, True)
    assert_one_line(err)
    code, _, err = call(*WORDS, "--resume")
    assert (code, f"{BEGUN}: is lost" in err) == (4, True)
    assert_one_line(err)
    assert {name: (stopped / name).read_bytes() for name in names_in(stopped)} == before


@pytest.mark.parametrize("content", [None, "", "{", "[]", "[" * 100_000, "\0" * 100])
def test_result_that_is_lost_or_damaged_does_not_block_sound_steps(
    content: str | None, call: Call, stopped: Path, whole: Path
) -> None:
    (stopped / RESULT).unlink()
    if content is not None:
        (stopped / RESULT).write_text(content)
    assert call(*WORDS, "--resume")[0] == 0
    assert_same(stopped, whole)


@pytest.mark.parametrize("status", ["converged", "doubtful"])
def test_result_that_was_edited_is_not_believed(status: str, call: Call, stopped: Path, whole: Path) -> None:
    text = (stopped / RESULT).read_text()
    (stopped / RESULT).write_text(text.replace('"status": "interrupted"', f'"status": "{status}"'))
    code, _, err = call(*WORDS, "--resume")
    assert code == 0
    assert "out/result.json: was changed after the run; the steps decide" in err
    assert_same(stopped, whole)


def test_edited_result_without_steps_is_left_alone(call: Call, stopped: Path) -> None:
    (stopped / RESULT).write_text('{"status": "converged"}')
    shutil.rmtree(stopped / "steps")
    before = {name: (stopped / name).read_bytes() for name in names_in(stopped)}
    code, _, err = call(*WORDS, "--resume")
    assert code == 4
    assert_one_line(err)
    assert "was changed after the run, and its steps are gone" in err
    assert {name: (stopped / name).read_bytes() for name in names_in(stopped)} == before


@pytest.mark.parametrize("content", ["[" * 100_000, '{"a":' * 100_000, "1" * 10_000, '{"scene": ' + "[" * 5000])
def test_beginning_that_is_nested_or_endless_is_refused(content: str, call: Call, stopped: Path) -> None:
    (stopped / BEGUN).write_text(content)
    code, _, err = call(*WORDS, "--resume")
    assert code == 4
    assert_one_line(err)
    assert f"out/{BEGUN}" in err


@pytest.mark.parametrize("name", [step_name(1), step_name(2), BEGUN, RESULT, "run.log", "fields.h5", "history.csv"])
@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
def test_what_is_no_file_is_not_read_for_ever(name: str, kind: str, start: Start, stopped: Path, folder: Path) -> None:
    path = stopped / name
    path.unlink()
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        path.mkdir()
    for words in (["--resume"], []):
        done = start(*WORDS, *words)
        assert done.returncode in (0, 2, 4), done.stderr
        assert "Traceback" not in done.stderr
        if done.returncode:
            assert_one_line(done.stderr)
        assert os.path.lexists(path)


def test_refusals_are_short_lines_that_keep_beginning_and_end() -> None:
    text = "bodies.block.E = " + "9" * 100_000 + ": must be positive"
    assert len(shortened(text, LONGEST)) == LONGEST < 300
    assert shortened(text).startswith("bodies.block.E = ")
    assert shortened(text).endswith(": must be positive")
    assert shortened("short") == "short"


@pytest.mark.parametrize(
    "words",
    [
        ["run", "x" * 100_000],
        ["run", "block", f"--set=title={'x' * 100_000}", "--set=nothing=1"],
        ["run", "block", f"--set={'x' * 100_000}=1"],
        ["x" * 100_000],
        ["new", "x" * 100_000],
        ["verify", "x" * 100_000],
        ["fclib", "x" * 100_000],
        ["cost", "block", "--quantity", "x" * 100_000],
        ["mesh", "block", "-o", "x" * 100_000],
    ],
)
def test_endless_words_are_not_echoed(words: list[str], call: Call) -> None:
    code, _, err = call(*words)
    assert code in (2, 4)
    assert_one_line(err)


def _factorised(*pivots: float) -> None:
    K = PETSc.Mat().createAIJ((len(pivots), len(pivots)), nnz=1)
    K.setUp()
    for row, pivot in enumerate(pivots):
        K.setValue(row, row, pivot)
    K.assemble()
    factorised.FactorisedVolume(K, np.zeros(0, np.int32), Counters())


def test_mechanism_is_not_reported_as_too_little_memory() -> None:
    with pytest.raises(SceneError, match="stiffness of the bodies is singular: part of a body moves") as found:
        _factorised(1.0, 0.0, 1.0)
    assert (found.value.exit_code, "memory" in str(found.value)) == (2, False)
    _factorised(1.0, 1.0, 1.0)


def test_too_little_memory_is_called_so(monkeypatch: pytest.MonkeyPatch) -> None:
    for word, numbers in (("SINGULAR", ()), ("NO_MEMORY", (-10, -40))):
        monkeypatch.setattr(factorised, word, numbers)
    with pytest.raises(MachineError, match="too little memory to factorise the bodies") as found:
        _factorised(0.0)
    assert found.value.exit_code == 4


# read-only results, and clocks


def make_read_only(place: Path, patch: pytest.MonkeyPatch) -> None:
    """As a disk is that is mounted for reading; the one who tests may be root, whom no permission stops."""

    def refuse(act: Callable[..., Any], writes: Callable[..., bool]) -> Callable[..., Any]:
        def acted(path: Any, *rest: Any, **options: Any) -> Any:
            if (
                isinstance(path, str | Path)
                and Path(path).absolute().is_relative_to(place)
                and writes(*rest, **options)
            ):
                raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
            return act(path, *rest, **options)

        return acted

    def by_mode(mode: str = "r", *rest: Any, **options: Any) -> bool:
        return bool(set("wax+") & set(mode))

    def by_flags(flags: int, *rest: Any, **options: Any) -> bool:
        return bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))

    patch.setattr(io, "open", refuse(io.open, by_mode))
    patch.setattr(os, "open", refuse(os.open, by_flags))
    for name in ("rename", "replace", "unlink", "mkdir", "rmdir", "truncate"):
        patch.setattr(os, name, refuse(getattr(os, name), lambda *rest, **options: True))


def test_finished_results_that_may_only_be_read_are_said_to_be_finished(
    call: Call, whole: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = Path(shutil.copytree(whole, folder / "out"))
    with monkeypatch.context() as patch:
        make_read_only(place, patch)
        code, _, err = call(*WORDS, "--resume")
    assert code == 0, err
    assert "the run is finished; nothing was changed" in err


def test_stopped_results_that_may_only_be_read_are_refused_and_kept(
    call: Call, stopped: Path, whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = {name: (stopped / name).read_bytes() for name in names_in(stopped)}
    with monkeypatch.context() as patch:
        make_read_only(stopped, patch)
        code, _, err = call(*WORDS, "--resume")
    assert code == 4
    assert_one_line(err)
    assert "out: cannot be written: Read-only file system" in err
    assert {name: (stopped / name).read_bytes() for name in names_in(stopped)} == before
    assert call(*WORDS, "--resume")[0] == 0
    assert_same(stopped, whole)


def test_disk_that_becomes_read_only_while_it_works(
    call: Call, folder: Path, whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:

        def turn(self: object, step: StepResult) -> None:
            if step.time == 1.0:
                make_read_only(folder, patch)

        patch.setattr("workflows.run.terminal.Reporter._step", turn)
        code, _, err = call(*WORDS)
    assert code == 4
    assert_one_line(err)
    assert "Read-only file system; 2 steps are kept, go on with --resume" in err
    assert call(*WORDS, "--resume")[0] == 0
    assert_same(folder / "out", whole)


def test_clock_that_goes_back_changes_no_answer(
    call: Call, folder: Path, whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also files that are dated in the future."""
    now = 2e9

    def back() -> float:
        nonlocal now
        now -= 3600.0
        return now

    with monkeypatch.context() as patch:
        patch.setattr("time.time", back)
        patch.setattr(
            "workflows.run.terminal.Reporter._step", lambda self, step: Stop(1)(step) if step.time == 1.0 else None
        )
        assert call(*WORDS)[0] == 130
        for name in names_in(folder / "out"):
            os.utime(folder / "out" / name, (4e9, 4e9))
    assert call(*WORDS, "--resume")[0] == 0
    assert_same(folder / "out", whole)
    assert min(result(folder / "out")["seconds"][key] for key in ("mesh", "assemble", "iterate", "total")) >= 0


# on two ranks


FAULTS_ON_RANKS = """
import os, shutil, sys
from pathlib import Path

sys.path.append(sys.argv.pop(1))
from mpi4py import MPI

from geometry.errors import StickslipError
from shared.histories import Stop, assert_same
from workflows.formats.steps import step_name
from workflows.run.run import run
from workflows.run.watch import Watch
from workflows.scene_file.read import read

comm, scene = MPI.COMM_WORLD, read(sys.argv[1], sys.argv[2:])


def spoil(name, how):
    comm.Barrier()
    if comm.rank == 0:
        path = Path("out", name)
        shutil.copy(path, "saved")
        path.unlink()
        how(path)
    comm.Barrier()


def restore(name):
    comm.Barrier()
    if comm.rank == 0:
        path = Path("out", name)
        path.unlink(missing_ok=True)
        shutil.copy("saved", path)
    comm.Barrier()


def refused(said, code, **options):
    try:
        run(scene, "out", **options)
    except StickslipError as error:
        assert said in str(error) and "\\n" not in str(error) and error.exit_code == code, (comm.rank, error)
    else:
        raise AssertionError(f"rank {comm.rank} goes on")


run(scene, "whole")
run(scene, "out", Watch(on_step=Stop(1)))
for name, how, said, code in (
    (step_name(1), os.mkfifo, "000001.h5: is a link, or no file or folder", 2),
    ("begun.json", lambda path: path.symlink_to("/dev/zero"), "is a link, or no file or folder", 2),
    ("begun.json", lambda path: path.write_text("[" * 100_000), "begun.json: cannot be read", 4),
    ("begun.json", lambda path: None, "begun.json: is lost", 4),
    (".stickslip", lambda path: None, "an earlier version of stickslip made it", 2),
):
    spoil(name, how)
    refused(said, code, resume=True)
    restore(name)
spoil("result.json", lambda path: path.write_text('{"status": "converged"}'))
run(scene, "out", resume=True)
if comm.rank == 0:
    assert_same(Path("out"), Path("whole"))
    Path("out", "notes.txt").write_text("mine")
comm.Barrier()
run(scene, "out")
run(scene, "out")
if comm.rank == 0:
    assert Path("out", "notes.txt").read_text() == "mine"
"""


def test_faults_on_two_ranks_are_the_same_on_both(tmp_path: Path) -> None:
    tests = str(Path(__file__).parents[1])
    done = mpirun(2, [tests, "block", *SMALL, "steps.count=2"], tmp_path, ("-c", FAULTS_ON_RANKS))
    assert done.returncode == 0, done.stderr


def test_full_disk_behind_stdout_on_two_ranks(folder: Path) -> None:
    """Rank 1 says nothing, and does not wait."""
    program = "import os, sys; os.dup2(os.open('/dev/full', os.O_WRONLY), 1); "
    program += "from workflows.commands import start; start.main()"
    done = mpirun(2, SPEAKS, folder, ("-c", program))
    assert done.returncode not in (0, 124)
    assert done.stderr.count("what is printed cannot be written") == 1
    assert result(folder / "out")["status"] == "converged"
