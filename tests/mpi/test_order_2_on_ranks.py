"""With order 2, the error of the mesh is the same on any number of ranks."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.testing import assert_allclose

from shared.ranks import mpirun

SCRIPT = """
import json
import numpy as np
from mpi4py import MPI
import stickslip
sizes = ["geometry.mesh_size=0.3", "geometry.contact_mesh_size=0.15"]
simulation = stickslip.prepare(stickslip.read("block", ["geometry.order=2", "solver.tolerance=1e-11", *sizes]))
found = simulation.mesh_errors([*simulation.steps()])
told = [[float(x) for parts in step.values() if parts.mesh is not None for x in np.ravel(parts.mesh)] for step in found]
everywhere = MPI.COMM_WORLD.gather(told)
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(everywhere))
"""


def told(ranks: int, folder: Path) -> Any:
    """The errors that each rank has found, by step."""
    (folder / "script.py").write_text(SCRIPT, encoding="utf-8")
    done = mpirun(ranks, [], folder, ("script.py",))
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


def test_ranks_find_the_errors_of_one(tmp_path: Path) -> None:
    (alone,), (one, other) = told(1, tmp_path), told(2, tmp_path)
    assert one == other
    assert np.shape(alone) == np.shape(one) == (2, len(alone[0]))
    assert np.min(alone) >= 0
    assert_allclose(one, alone, rtol=1e-6, atol=1e-9 * np.max(alone))
