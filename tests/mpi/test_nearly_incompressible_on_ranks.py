"""A factor with pressures as unknowns on several ranks: the same answer, and no pivot that is not counted."""

from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from shared.cases import slow
from shared.ranks import told

SCRIPT = """
import json
from mpi4py import MPI
import stickslip
words = ["bodies.block.nu=0.499", "geometry.order=2", "solver.tolerance=1e-11", 'solver.surface="condensed"']
found = []
simulation = stickslip.prepare(stickslip.read("cube", [*words, "geometry.mesh_size=SIZE", "output.error=false"]))
for step in simulation.steps():
    base = step.contacts["base"]
    found += [base.normal_force, base.stick_area, base.max_pressure, step.energy.stored]
everywhere = MPI.COMM_WORLD.gather([float(value) for value in found])
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(everywhere))
"""


@pytest.mark.parametrize("size", [0.2, *slow(0.25)])  # MUMPS divides the last front of .2 among ranks, where it may
def test_ranks_agree(size: float, tmp_path: Path) -> None:
    script = SCRIPT.replace("SIZE", str(size))
    (alone,), (one, other) = (told(script, ranks, tmp_path) for ranks in (1, 2))
    assert one == other
    assert_allclose(one, alone, rtol=1e-8)
