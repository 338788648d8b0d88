"""Whatever fails on one rank ends all of them."""

from __future__ import annotations

import os
import re
import signal
from pathlib import Path

import pytest

from shared.command import COARSE, LIMIT, result
from shared.drawn import write_long
from shared.histories import RUN_FOUR, SMALL
from shared.processes import children, gmsh_child, is_there, wait_for
from shared.ranks import mpirun, started
from stickslip.workflows.formats.steps import step_name
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import read

# one rank is told to stop

TOLD = """
import importlib, os, signal, sys

from stickslip.workflows.commands import process, start

process.SHORT = 1.0  # s; the other rank does not come
rank, at = sys.argv.pop(1), sys.argv.pop(1)
if os.environ["OMPI_COMM_WORLD_RANK"] == rank:
    if at[0].isdigit():
        signal.signal(signal.SIGALRM, lambda *rest: os.kill(os.getpid(), signal.SIGTERM))
        signal.setitimer(signal.ITIMER_REAL, float(at))
    else:
        place, _, name = at.rpartition(".")
        module = importlib.import_module(place)
        called = getattr(module, name)
        setattr(module, name, lambda *rest: (os.kill(os.getpid(), signal.SIGTERM), called(*rest))[1])
start.main()
"""


@pytest.mark.parametrize(
    ("rank", "at"),
    [
        pytest.param(1, "0.7", marks=pytest.mark.slow),  # s: within the imports
        (1, "stickslip.workflows.run.run.wanted"),  # the other waits for it already
        pytest.param(0, "stickslip.workflows.run.resume.find_earlier_run", marks=pytest.mark.slow),
        pytest.param(1, "stickslip.workflows.scene_file.read.read", marks=pytest.mark.slow),
    ],
)
def test_rank_that_is_told_to_stop_while_they_start_ends_the_others(rank: int, at: str, tmp_path: Path) -> None:
    done = mpirun(2, [str(rank), at, *RUN_FOUR, "--resume"], tmp_path, ("-c", TOLD), limit=LIMIT)
    assert done.returncode not in (0, 124, 137), done.stderr
    assert "Traceback" not in done.stderr
    assert "stickslip: interrupted" in done.stderr or at == "0.7"  # before MPI began: mpirun ends them
    assert not list(tmp_path.iterdir())


# all are told, or killed


@pytest.mark.parametrize(
    ("number", "rank"),
    [
        (signal.SIGUSR1, None),  # as a queue does before its time limit: mpirun passes it on
        # as a machine without memory does; test_killed does it to one rank
        pytest.param(signal.SIGKILL, 1, marks=pytest.mark.slow),
        pytest.param(signal.SIGTERM, None, marks=pytest.mark.slow),  # mpirun leaves them little time
        pytest.param(signal.SIGINT, None, marks=pytest.mark.slow),
    ],
)
def test_run_that_is_ended_on_two_ranks_goes_on(number: signal.Signals, rank: int | None, tmp_path: Path) -> None:
    scene = [*SMALL, "steps.count=40", "output.error=false"]
    words = ["run", "block", "-q", "-o", "out", *(f"--set={word}" for word in scene)]
    process = started(2, words, tmp_path, limit=LIMIT)
    wait_for((tmp_path / ".out.running" / step_name(1)).exists, "a step", process.pid)
    (launcher,) = children(process.pid)
    ranks = children(launcher)
    os.kill(launcher if rank is None else ranks[rank], number)
    _, err = process.communicate()
    wait_for(lambda: not any(is_there(each) for each in ranks), "the end of all ranks")  # mpirun does not
    assert process.returncode not in (0, 124), err
    assert "Traceback" not in err
    if number == signal.SIGUSR1:
        assert (process.returncode, result(tmp_path / "out")["status"]) == (130, "interrupted")
    outcome, _ = run(read("block", scene), tmp_path / "out", resume=True)
    assert outcome.status == "converged"
    (done,) = re.findall(r"resumed after step (\d+),", (tmp_path / "out" / "run.log").read_text())
    assert 1 <= int(done) < 40


def test_signal_while_gmsh_meshes_ends_all_ranks_at_once(tmp_path: Path) -> None:
    """Rank 0 waits for gmsh's process, rank 1 for rank 0."""
    scene = write_long(tmp_path, "meshing")
    process = started(2, ["run", str(scene), "-q", "-o", "out"], tmp_path, limit=LIMIT)
    (launcher,) = wait_for(lambda: children(process.pid), "mpirun", process.pid)
    first = wait_for(lambda: children(launcher), "ranks", process.pid)[0]
    child = gmsh_child(first, "meshing")
    os.kill(launcher, signal.SIGUSR1)
    _, err = process.communicate()
    assert (process.returncode, "Traceback" in err, is_there(child)) == (130, False, False), err
    assert err.count("stickslip: interrupted") == 1


# disks, folders, files, clocks

FAULTS_ON_RANKS = """
import os, resource, shutil, signal, sys
from pathlib import Path

import pytest
from mpi4py import MPI

from stickslip.geometry.errors import StickslipError
from shared.disks import make_read_only
from shared.drawn import write_long
from shared.histories import Stop, assert_same
from stickslip.workflows.formats.steps import step_name
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

comm, scene = MPI.COMM_WORLD, read(sys.argv[1], sys.argv[2:])
processes = comm.allgather(os.getpid())


def on_rank_0(act):
    comm.Barrier()
    if comm.rank == 0:
        act()
    comm.Barrier()


def spoil(name, how):
    path = Path("out", name)
    on_rank_0(lambda: (shutil.copy(path, "saved"), path.unlink(), how(path)))


def restore(name):
    path = Path("out", name)
    on_rank_0(lambda: (path.unlink(missing_ok=True), shutil.copy("saved", path)))


def refused(said, code, place="out", watch=None, **options):
    try:
        run(scene, place, watch, **options)
    except StickslipError as error:
        assert said in str(error) and "\\n" not in str(error) and error.exit_code == code, (comm.rank, error)
    else:
        raise AssertionError(f"rank {comm.rank} goes on")


run(scene, "whole")
run(scene, "out", Watch(on_step=Stop(2)))
for name, how, said, code in (
    (step_name(1), os.mkfifo, "000001.h5: is a link, or no file or folder", 2),
    (step_name(1), lambda path: path.write_bytes(Path("saved").read_bytes()[:-1]), "000001.h5: damaged", 4),
    ("begun.json", lambda path: path.symlink_to("/dev/zero"), "is a link, or no file or folder", 2),
    ("begun.json", lambda path: path.write_text("[" * 100_000), "begun.json: damaged", 4),
    ("begun.json", lambda path: None, "begun.json: is lost", 4),
    (".stickslip", lambda path: None, "an earlier version of stickslip made it", 2),
):
    spoil(name, how)
    refused(said, code, resume=True)
    restore(name)
with pytest.MonkeyPatch.context() as patch:
    make_read_only(Path("out").absolute(), patch)
    refused("out: cannot be written: Read-only file system", 4, resume=True)
refused("is gone, and with it the steps so far", 4, "lost", Watch(on_step=lambda step: shutil.rmtree(".lost.running")))

soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
fill = Watch(on_step=lambda step: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard)))
refused("cannot be written: File too large; 1 steps are kept, go on with --resume", 4, "full", fill)
resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
told = run(scene, "full", Watch(on_step=lambda step: os.kill(processes[1], signal.SIGTERM)), resume=True)[0]
assert told.status == "interrupted", (comm.rank, told)

spoil("result.json", lambda path: path.write_text('{"status": "converged"}'))
with pytest.MonkeyPatch.context() as patch:
    if comm.rank == 1:  # its clock goes back
        for name in ("time", "perf_counter", "monotonic"):
            patch.setattr(f"time.{name}", lambda now=[2e9]: now.append(now[-1] - 3600.0) or now[-1])
    for place in ("out", "full"):
        run(scene, place, resume=True)
on_rank_0(lambda: [assert_same(Path(place), Path("whole")) for place in ("out", "full")])
on_rank_0(lambda: Path("out", "notes.txt").write_text("mine"))
run(scene, "out")
run(scene, "out")
assert [path.read_text() for path in Path().glob("out.*/notes.txt")] == ["mine"]
"""


@pytest.mark.slow  # others of them below, and on one rank in tests/runs
def test_faults_on_two_ranks_are_the_same_on_both(tmp_path: Path) -> None:
    done = mpirun(2, ["block", *SMALL, "steps.count=3"], tmp_path, ("-c", FAULTS_ON_RANKS))
    assert done.returncode == 0, done.stderr


@pytest.mark.slow  # test_faults does it on one rank
def test_full_disk_behind_stdout_on_two_ranks(tmp_path: Path) -> None:
    """Rank 1 says nothing, and does not wait."""
    program = "import os, sys; os.dup2(os.open('/dev/full', os.O_WRONLY), 1); "
    program += "from stickslip.workflows.commands import start; start.main()"
    done = mpirun(2, ["run", "block", "-o", "out", *COARSE], tmp_path, ("-c", program))
    assert done.returncode not in (0, 124)
    assert done.stderr.count("what is printed cannot be written") == 1
    assert result(tmp_path / "out")["status"] == "converged"


FAILURES = ("step", "iteration", "mesh", "log", "audit", "rich")
ON_RANKS = """
import sys
from pathlib import Path

from mpi4py import MPI

import stickslip.workflows.run.audit
import stickslip.workflows.run.run
from stickslip.geometry.errors import MachineError, StickslipError
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

rank, scene = MPI.COMM_WORLD.rank, read("block", sys.argv[1:])


def fail(error):
    def act(*arguments):
        if rank == 0:
            raise error
        raise AssertionError("called on another rank")

    return act


piped = BrokenPipeError(32, "Broken pipe")
read_step, run_log = stickslip.workflows.run.audit.read_step, stickslip.workflows.run.run.RunLog
cases = {
    "step": lambda: Watch(on_step=fail(piped)),
    "iteration": lambda: Watch(on_iteration=fail(ValueError("a mistake"))),
    "mesh": lambda: Watch(on_mesh=fail(piped)),
    "rich": lambda: Watch(on_step=fail(SystemExit(1))),
    "log": lambda: setattr(stickslip.workflows.run.run, "RunLog", fail(piped)),
    "audit": lambda: setattr(stickslip.workflows.run.audit, "read_step", fail(MachineError("cannot be read"))),
}
for name, prepare in cases.items():
    try:
        stickslip.workflows.run.run.run(scene, name, prepare())
        said = "nothing"
    except (StickslipError, ValueError, SystemExit) as error:
        said = type(error).__name__
    stickslip.workflows.run.audit.read_step, stickslip.workflows.run.run.RunLog = read_step, run_log
    Path(f"{name}.{rank}").write_text(said)
"""


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """By failure and rank, what was raised."""
    folder = tmp_path_factory.mktemp("ranks")
    done = mpirun(2, [*SMALL, "steps.count=2", "output.error=false"], folder, ("-c", ON_RANKS))
    assert done.returncode == 0, done.stderr
    return {path.name: path.read_text() for path in folder.glob("*.[01]")}


@pytest.mark.parametrize("failure", FAILURES)
def test_every_rank_ends(failure: str, said: dict[str, str]) -> None:
    own, others = {"iteration": ("ValueError", "StickslipError"), "rich": ("SystemExit", "StickslipError")}.get(
        failure, ("MachineError", "MachineError")
    )
    assert (said[f"{failure}.0"], said[f"{failure}.1"]) == (own, others)
