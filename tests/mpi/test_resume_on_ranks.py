"""A run goes on with another number of ranks than before."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.command import result
from shared.histories import LEARNS, SMALL, Stop
from shared.ranks import mpirun
from stickslip.workflows.formats.steps import read_step, step_name
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

EXACT = "solver.tolerance=1e-12"
SAME = 1e-10  # relative: the residual of either run is relative to p_ref, the answer's condition comes on top
SCENES = {
    "block": [*SMALL, "steps.count=4", "output.error=false"],
    "cube": ["geometry.mesh_size=0.25", "output.pictures=false", "steps.count=4", *LEARNS],
    "sliding": ["geometry.mesh_size=0.25", "geometry.lower_mesh_size=0.2", "output.pictures=false", "steps.end=1.5"],
    "stack": ["geometry.mesh_size=0.25", "output.pictures=false", "steps.count=4"],
    "stick_slip": ["geometry.mesh_size=0.0125", "output.pictures=false", "steps.count=8"],
}
TESTS = Path(__file__).parents[1]
ON_RANKS = """
import sys

sys.path.append(sys.argv.pop(1))
from shared.histories import Stop
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

outcome, _ = run(read(sys.argv[1], sys.argv[2:]), "out", Watch(on_step=Stop(2)), resume=True)
sys.exit(outcome.exit_code)
"""  # the signal comes to rank 0 alone


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n != "block")) for n in SCENES])
def test_it_goes_on_to_the_same_answer_on_two_ranks_and_on_one(name: str, tmp_path: Path) -> None:
    words = [*SCENES[name], EXACT]
    scene = read(name, words)
    times = scene.requested_times()
    run(scene, tmp_path / "whole")
    run(scene, tmp_path / "out", Watch(on_step=Stop(1)))
    done = mpirun(2, [str(TESTS), name, *words], tmp_path, ("-c", ON_RANKS))
    assert done.returncode == 128 + signal.SIGINT, done.stderr
    assert result(tmp_path / "out")["status"] == "interrupted"
    outcome, _ = run(scene, tmp_path / "out", resume=True)
    assert outcome.status == "converged"
    log = (tmp_path / "out" / "run.log").read_text()
    assert log.count("resumed after step 1,") == log.count("resumed after step 3,") == 1
    for index in range(1, len(times) + 1):
        ours, theirs = (read_step(tmp_path / folder / step_name(index)) for folder in ("out", "whole"))
        assert ours.time == theirs.time == times[index - 1]
        for key in ("displacement", "p", "w"):
            expected, found = getattr(theirs, key), getattr(ours, key)
            assert_allclose(found, expected, rtol=0, atol=SAME * np.abs(expected).max(initial=0.0), err_msg=key)
    ours, theirs = (result(tmp_path / folder) for folder in ("out", "whole"))
    totals = [[step["energy"][key] for step in steps["steps"]] for steps in (ours, theirs) for key in ("external",)]
    assert_allclose(totals[0], totals[1], rtol=SAME)


ON_THE_SAME_RANKS = """
import errno
import os
import shutil
import sys
from pathlib import Path

sys.path.append(sys.argv.pop(1))
from mpi4py import MPI

from stickslip.geometry.errors import MachineError
from shared.histories import Stop, assert_same
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read
from stickslip.workflows.formats.serialised import PlainFile

comm, scene = MPI.COMM_WORLD, read(sys.argv[1], sys.argv[2:])
run(scene, "whole")
run(scene, "out", Watch(on_step=Stop(1)))
comm.Barrier()
assert len(os.listdir("out/learnt")) == 2  # of two ranks
if comm.rank == 0:
    shutil.copytree("out", "damaged", symlinks=True)
    os.truncate("damaged/learnt/000001.1.bin", 100)
comm.Barrier()
write = PlainFile.write


def full(file, path):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


if comm.rank == 1:
    PlainFile.write = full
try:
    run(scene, "out", resume=True)
except MachineError as error:
    assert "000002.1.bin: No space left on device; 1 steps are kept" in str(error), error
else:
    raise AssertionError(f"rank {comm.rank} goes on")
PlainFile.write = write
notes = []
assert run(scene, "damaged", Watch(on_note=notes.append), resume=True)[0].status == "converged"
assert [note.partition(":")[0] for note in notes] == ["what the method had learnt is lost"] * (comm.rank == 0), notes
run(scene, "out", resume=True)
if comm.rank == 0:
    assert_same(Path("out"), Path("whole"))
"""


def test_each_rank_keeps_what_it_has_learnt_and_all_fail_or_none(tmp_path: Path) -> None:
    words = [*SMALL, *LEARNS, "steps.count=2", "output.error=false"]
    done = mpirun(2, [str(TESTS), "block", *words], tmp_path, ("-c", ON_THE_SAME_RANKS))
    assert done.returncode == 0, done.stderr
