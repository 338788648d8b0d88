"""A scripted history on several ranks: the script reads contacts, decides on every rank alike, and goes on."""

from pathlib import Path

import numpy as np
from numpy.testing import assert_allclose

from shared.ranks import told

SCRIPT = """
import json
from mpi4py import MPI
import stickslip
scene = stickslip.read("block", ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.25", "solver.tolerance=1e-11"])
script, x, told = stickslip.prepare(scene).script(), 0.0, []
step = script.step(to=1.0)
while step.contacts["base"].slip_area < step.contacts["base"].contact_area and x < 0.2:
    x += 0.03
    step = script.step(to=script.time + 1.0, supports={"top": {"x": x}})
    base = step.contacts["base"]
    told.append([x, *base.force, base.stick_area, *step.energy.dissipation, *step.supports["top"][0]])
everywhere = MPI.COMM_WORLD.gather(told)
if MPI.COMM_WORLD.rank == 0:
    assert len(step.displacement) > 0
    print(json.dumps(everywhere))
"""


def test_ranks_decide_alike_and_have_the_answer_of_one(tmp_path: Path) -> None:
    (alone,), (one, other) = (told(SCRIPT, ranks, tmp_path) for ranks in (1, 2))
    assert one == other
    assert len(alone) == len(one) == 5  # slips as a whole at x = 0.15
    assert_allclose(one, alone, rtol=0, atol=1e-9 * np.abs(alone).max())  # two decades above the solver's tolerance
