"""Killed at any moment, a run goes on to the result, bit for bit, of one that was left alone."""

from __future__ import annotations

import os
import random
import re
import resource
import signal
import subprocess
import time as clock
from pathlib import Path

import pytest

from shared.command import Call
from shared.disks import Disk, killed_at
from shared.histories import FOUR, LEARNS, RUN_FOUR, SMALL, assert_same, names_in
from shared.processes import exit_code, forked, wait_for
from stickslip.solvers.results.step_result import StepResult
from stickslip.workflows.formats.steps import step_name
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

SCENE = [*SMALL, *LEARNS, "steps.count=4"]
BY_TIME, SPARE = 20, 12  # steps of a run that is killed by the clock; those after the last moment: it still runs then
LONGER = [*SMALL, *LEARNS, f"steps.count={BY_TIME}", "output.error=false"]
WORDS = ["run", "block", "-q", "-o", "out", *(f"--set={word}" for word in LONGER)]
SEED = "STICKSLIP_SEED"  # in the environment: other moments, or those of an earlier test again
LONG = 3600  # s, for hundreds of runs on a busy machine
TORN = 5  # bytes of a last row that a crash keeps from the disk


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a run that was left alone."""
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


def test_killed_at_moments_of_writing_it_goes_on(tmp_path: Path, whole: Path) -> None:
    """The last one too, when all is solved and the files of what was learnt are gone."""
    last = changes(tmp_path / "counted" / "out")
    for change in {*(1 + int(part * last) for part in _moments(1)), last}:
        folder = tmp_path / f"{change}" / "out"
        assert killed(change, folder, resume=False)
        run(read("block", SCENE), folder, resume=True)
        assert_same(folder, whole)
        assert names_in(folder.parent) == {f"out/{name}" for name in names_in(whole)}


@pytest.mark.slow
@pytest.mark.timeout(LONG)
def test_killed_at_every_moment_of_writing_it_goes_on(tmp_path: Path, whole: Path) -> None:
    """And killed again while it resumes, at a moment as early."""
    for change in range(1, changes(tmp_path / "counted" / "out") + 1):
        folder = tmp_path / f"{change}" / "out"
        assert killed(change, folder, resume=False)
        killed(change // 2, folder, resume=True)
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


def test_killed_at_any_time_it_goes_on(tmp_path: Path) -> None:
    def start(place: Path) -> int:
        return forked(lambda: run(read("block", LONGER), place))

    alone = tmp_path / "alone"
    pace = pace_of(start(alone), alone)
    for number, lot in enumerate(map(Lot, _moments(1))):
        folder = tmp_path / f"{number}" / "out"
        lot.kill(start(folder), folder, pace)
        run(read("block", LONGER), folder, resume=True)
        lot.check(folder)
        assert_same(folder, alone)


@pytest.mark.slow
@pytest.mark.timeout(LONG)
def test_command_killed_at_twenty_random_times_goes_on(
    folder: Path, command: list[str], environment: dict[str, str]
) -> None:
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


def test_third_ctrl_c_ends_it_at_once(tmp_path: Path, whole: Path) -> None:
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
    assert_same(folder, whole)


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
