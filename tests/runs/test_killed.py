"""Killed at any moment, a run goes on to the result, bit for bit, of one that was left alone."""

from __future__ import annotations

import os
import random
import re
import resource
import signal
import subprocess
import time as clock
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from shared.command import Call
from shared.histories import LEARNS, SMALL, assert_same, names_in
from stickslip.solvers.results.step_result import StepResult
from stickslip.workflows.formats.steps import step_name
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

SCENE = [*SMALL, *LEARNS, "steps.count=4"]
BY_TIME, SPARE = 12, 4  # steps of a run that is killed by the clock, and those after the last moment: it must still run
LONGER = [*SMALL, *LEARNS, f"steps.count={BY_TIME}"]
WORDS = ["run", "block", "-q", "-o", "out", *(f"--set={word}" for word in LONGER)]
SEED = "STICKSLIP_SEED"  # in the environment: the moments of an earlier test again
DISK = ("fsync", "replace", "rename", "unlink", "mkdir")  # of the module os: what outlives a process
LONG = 3600  # s, for hundreds of runs on a busy machine
TORN = 5  # bytes of a last row that a crash keeps from the disk


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a run that was left alone."""
    folder = tmp_path_factory.mktemp("whole") / "out"
    run(read("block", SCENE), folder)
    return folder


def in_a_process_of_its_own(act: Callable[[], object]) -> int:
    """Start it; the process number. What C libraries have set up is there already."""
    process = os.fork()
    if process:
        return process
    try:
        act()
    finally:
        os._exit(1)


def ended_by(process: int) -> int:
    """The signal that ended it, or 0."""
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


class Disk:
    """Counts what is asked of the disk for results; at the n-th time the process is killed, before it is done."""

    def __init__(self, folder: Path, killed_at: int = 0) -> None:
        self.below, self.killed_at, self.count = f"{folder.parent}/", killed_at, 0

    def watch(self, patch: pytest.MonkeyPatch) -> None:
        for name in DISK:
            patch.setattr(os, name, self._counted(name, getattr(os, name)))

    def _counted(self, name: str, act: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*arguments: Any, **options: Any) -> Any:
            if not _place(arguments[0]).startswith(self.below):  # the cache of compiled forms
                return act(*arguments, **options)
            self.count += 1
            if self.count == self.killed_at:
                if name == "fsync" and os.fstat(arguments[0]).st_size > TORN and _place(arguments[0]).endswith(".csv"):
                    os.truncate(arguments[0], os.fstat(arguments[0]).st_size - TORN)
                os.kill(os.getpid(), signal.SIGKILL)
            return act(*arguments, **options)

        return counted


def _place(path: Any) -> str:
    """Of a path, or of an open file."""
    return os.readlink(f"/proc/self/fd/{path}") if isinstance(path, int) else str(path)


def operations(folder: Path) -> int:
    """How many times a run asks the disk for something."""
    with pytest.MonkeyPatch.context() as patch:
        disk = Disk(folder)
        disk.watch(patch)
        run(read("block", SCENE), folder)
    return disk.count


def killed_at(operation: int, folder: Path, resume: bool) -> bool:
    """Whether the run got so far that it was."""

    def act() -> None:
        with pytest.MonkeyPatch.context() as patch:
            Disk(folder, operation).watch(patch)
            run(read("block", SCENE), folder, resume=resume)

    return ended_by(in_a_process_of_its_own(act)) == -signal.SIGKILL


def _moments(count: int) -> list[float]:
    seed = int(os.environ.get(SEED, random.SystemRandom().randrange(10**6)))
    print(f"{SEED}={seed}")
    lots = random.Random(seed)
    return [lots.random() for _ in range(count)]


def test_killed_at_moments_of_writing_it_goes_on(tmp_path: Path, whole: Path) -> None:
    """The last one too, when all is solved and the files of what was learnt are gone."""
    last = operations(tmp_path / "counted")
    for operation in {*(1 + int(part * last) for part in _moments(1)), last}:
        folder = tmp_path / f"{operation}" / "out"
        assert killed_at(operation, folder, resume=False)
        run(read("block", SCENE), folder, resume=True)
        assert_same(folder, whole)
        assert names_in(folder.parent) == {f"out/{name}" for name in names_in(whole)}


@pytest.mark.slow
@pytest.mark.timeout(LONG)
def test_killed_at_every_moment_of_writing_it_goes_on(tmp_path: Path, whole: Path) -> None:
    """And killed again while it resumes, at a moment as early."""
    for operation in range(1, operations(tmp_path / "counted") + 1):
        folder = tmp_path / f"{operation}" / "out"
        assert killed_at(operation, folder, resume=False)
        killed_at(operation // 2, folder, resume=True)
        run(read("block", SCENE), folder, resume=True)
        assert_same(folder, whole)


# by the clock


class Lot:
    """A moment between the first steps' files: how long start-up and mesh take does not count."""

    def __init__(self, part: float) -> None:
        whole, self.rest = divmod(part * (BY_TIME - SPARE), 1.0)
        self.step = 1 + int(whole)

    def kill(self, process: int, folder: Path, pace: float) -> None:
        """A part of a step's time after that step's file has appeared."""
        wait_for(self.step, folder, process)
        clock.sleep(self.rest * pace)
        os.kill(process, signal.SIGKILL)
        assert ended_by(process) == -signal.SIGKILL  # it had not ended by itself

    def check(self, folder: Path) -> None:
        """The run went on from there, or from a step that came between."""
        (done,) = re.findall(r"resumed after step (\d+),", (folder / "run.log").read_text())
        assert self.step <= int(done) <= BY_TIME


def wait_for(step: int, folder: Path, process: int) -> float:
    """The time at which its file was there."""
    path = folder.with_name(f".{folder.name}.running") / step_name(step)
    while not path.exists():
        assert os.waitpid(process, os.WNOHANG) == (0, 0), "it ended before that step"
        clock.sleep(1e-3)
    return clock.monotonic()


def pace_of(process: int, folder: Path) -> float:
    """Seconds a step of a run that is left alone."""
    first, last = (wait_for(step, folder, process) for step in (1, BY_TIME - 1))
    ended_by(process)
    return (last - first) / (BY_TIME - 2)


@pytest.fixture(scope="module")
def longer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a longer run that was left alone."""
    folder = tmp_path_factory.mktemp("longer") / "out"
    run(read("block", LONGER), folder)
    return folder


def test_killed_at_any_time_it_goes_on(tmp_path: Path, longer: Path) -> None:
    def start(place: Path) -> int:
        return in_a_process_of_its_own(lambda: run(read("block", LONGER), place))

    pace = pace_of(start(tmp_path / "timed"), tmp_path / "timed")
    for number, lot in enumerate(map(Lot, _moments(1))):
        folder = tmp_path / f"{number}" / "out"
        lot.kill(start(folder), folder, pace)
        run(read("block", LONGER), folder, resume=True)
        lot.check(folder)
        assert_same(folder, longer)


@pytest.mark.slow
@pytest.mark.timeout(LONG)
def test_command_killed_at_twenty_random_times_goes_on(
    folder: Path, command: list[str], environment: dict[str, str], longer: Path
) -> None:
    def start(place: Path) -> int:
        place.mkdir()

        def become() -> None:
            os.chdir(place)
            os.execve(command[0], [*command, *WORDS], environment)

        return in_a_process_of_its_own(become)

    pace = pace_of(start(folder / "timed"), folder / "timed" / "out")
    for number, lot in enumerate(map(Lot, _moments(20))):
        place = folder / f"{number}"
        lot.kill(start(place), place / "out", pace)
        assert subprocess.run([*command, *WORDS, "--resume"], cwd=place, env=environment, check=False).returncode == 0
        lot.check(place / "out")
        assert_same(place / "out", longer)


def test_third_ctrl_c_ends_it_at_once(tmp_path: Path, whole: Path) -> None:
    """In the middle of an iteration, with the steps so far where `--resume` finds them."""

    def press(step: StepResult) -> None:
        if step.time == 1.0:
            for _ in range(3):
                os.kill(os.getpid(), signal.SIGINT)
            os.kill(os.getpid(), signal.SIGKILL)  # reached if it goes on

    folder = tmp_path / "out"
    process = in_a_process_of_its_own(lambda: run(read("block", SCENE), folder, Watch(on_step=press)))
    assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 130
    assert not folder.exists()
    run(read("block", SCENE), folder, resume=True)
    assert "resumed after step 2," in (folder / "run.log").read_text()
    assert_same(folder, whole)


# a full disk


@pytest.mark.parametrize(("room", "name"), [(1_000, "contact_base.csv"), (20_000, "steps/000003.h5")])
def test_full_disk_loses_no_step_and_the_run_goes_on_when_there_is_room(
    room: int, name: str, call: Call, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After two steps no file can grow beyond `room` bytes: a table, or the next step."""
    scene, words = [*SMALL, "steps.count=4"], ["run", "block", "-q", "-o", "out"]
    words += [f"--set={word}" for word in scene]
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)

    def fill(self: object, step: StepResult) -> None:
        if step.time == 1.0:
            resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))

    with monkeypatch.context() as patch:
        patch.setattr("stickslip.workflows.run.terminal.Reporter._step", fill)
        try:
            code, _, err = call(*words)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert (code, err.count("\n")) == (4, 1)
    assert f"{name}: cannot be written: File too large; 2 steps are kept, go on with --resume" in err
    assert sorted(path.name for path in (folder / ".out.running" / "steps").iterdir()) == ["000001.h5", "000002.h5"]
    assert call(*words, "--resume") == (0, "", "")
    run(read("block", scene), folder / "whole")
    assert_same(folder / "out", folder / "whole")
