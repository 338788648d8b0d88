"""Springs between places give the same answer on any number of ranks, in both forms of the bodies."""

from pathlib import Path

import numpy as np
from numpy.testing import assert_allclose

from shared.ranks import told

SCRIPT = """
import json
from mpi4py import MPI
import stickslip
words = [
    "springs.side={at='block.left',to='block.right',stiffness=[0.2,0.1]}",
    "springs.tip={at=[4.0,2.0],stiffness=0.3,direction=[1.0,1.0],displacement=[0.05,0.0]}",
    "geometry={builder='block',length=4.0,height=2.0,mesh_size=0.25,order=ORDER}",
    "solver={method='surface-uzawa',surface='FORM',tolerance=1e-10}",
    "steps={end=2.0,count=2}",
    "supports.top.displacement={y=[[0.0,0.0],[1.0,-0.1]]}",
]
found = []
for form in ("condensed", "matrix-free"):
    for order in (1, 2):
        own = [word.replace("ORDER", str(order)).replace("FORM", form) for word in words]
        simulation = stickslip.prepare(stickslip.read("block", own))
        *_, step = simulation.steps()
        found.append([*(float(x) for force, in step.springs.values() for x in force), step.energy.stored])
everywhere = MPI.COMM_WORLD.gather(found)
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(everywhere))
"""


def test_ranks_agree_on_the_forces_of_springs(tmp_path: Path) -> None:
    (alone,), (one, other) = (told(SCRIPT, ranks, tmp_path) for ranks in (1, 2))
    assert one == other
    assert np.abs(alone).min(axis=0)[:4].min() > 0
    assert_allclose(one, alone, rtol=1e-7)
    assert_allclose(one[:2], one[2:], rtol=1e-6)
