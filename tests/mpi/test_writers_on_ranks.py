"""A writer is called on rank 0, or on every rank if it says so; all ranks fail or none."""

from __future__ import annotations

from pathlib import Path

from shared.histories import SMALL
from shared.ranks import mpirun

ON_RANKS = """
import sys
from pathlib import Path

from stickslip.geometry.errors import MachineError
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import read
from stickslip.workflows.writers.writer import Writer


class Alone(Writer):
    def resume(self, steps):
        pass

    def step(self, index, result):
        Path(f"alone.{self.job.comm.rank}").touch()


class Together(Writer):
    collective = True
    full = False

    def resume(self, steps):
        pass

    def step(self, index, result):
        assert self.job.comm.allreduce(1) == 2
        Path(f"together.{self.job.comm.rank}").touch()
        if self.full and self.job.comm.rank == 1:
            raise MachineError("no room on rank 1")


scene = read("block", sys.argv[1:])
run(scene, "out")
Together.full = True
try:
    run(scene, "other")
except MachineError as error:
    assert "no room on rank 1; 1 steps are kept" in str(error), error
else:
    raise AssertionError("goes on")
"""


def test_a_writer_is_called_on_the_ranks_that_it_asks_for(tmp_path: Path) -> None:
    done = mpirun(2, [*SMALL, "steps.count=2", "output.error=false"], tmp_path, ("-c", ON_RANKS))
    assert done.returncode == 0, done.stderr
    names = {path.name for path in tmp_path.iterdir() if path.is_file()}
    assert names == {"alone.0", "together.0", "together.1"}
