"""With order 2, the error of the mesh is the same on any number of ranks."""

from pathlib import Path

import numpy as np
from numpy.testing import assert_allclose

from shared.ranks import told

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


def test_ranks_find_the_errors_of_one(tmp_path: Path) -> None:
    (alone,), (one, other) = (told(SCRIPT, ranks, tmp_path) for ranks in (1, 2))
    assert one == other
    assert np.shape(alone) == np.shape(one) == (2, len(alone[0]))
    assert np.min(alone) >= 0
    assert_allclose(one, alone, rtol=1e-6, atol=1e-9 * np.max(alone))
