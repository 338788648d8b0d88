"""What goes wrong on rank 0 alone ends the run on every rank: none waits for it for ever."""

from __future__ import annotations

import pytest

from shared.histories import SMALL
from shared.ranks import mpirun

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
