"""Faults where ranks matter: all of them end, or none; what is kept serves every one of them."""

from __future__ import annotations

from pathlib import Path

from shared.command import COARSE, LIMIT, result
from shared.histories import RUN_FOUR, SMALL
from shared.ranks import mpirun


def test_signal_on_two_ranks_while_they_start(tmp_path: Path) -> None:
    """The rank that is told ends the others."""
    program = "import os, signal, sys; from workflows.commands import start; "
    program += "os.environ['OMPI_COMM_WORLD_RANK'] == '1' and signal.setitimer(signal.ITIMER_REAL, .7); "
    program += "signal.signal(signal.SIGALRM, lambda *rest: os.kill(os.getpid(), signal.SIGTERM)); start.main()"
    done = mpirun(2, RUN_FOUR, tmp_path, ("-c", program), limit=LIMIT)
    assert done.returncode not in (0, 124), done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


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


def test_full_disk_behind_stdout_on_two_ranks(tmp_path: Path) -> None:
    """Rank 1 says nothing, and does not wait."""
    program = "import os, sys; os.dup2(os.open('/dev/full', os.O_WRONLY), 1); "
    program += "from workflows.commands import start; start.main()"
    done = mpirun(2, ["run", "block", "-o", "out", *COARSE], tmp_path, ("-c", program))
    assert done.returncode not in (0, 124)
    assert done.stderr.count("what is printed cannot be written") == 1
    assert result(tmp_path / "out")["status"] == "converged"
