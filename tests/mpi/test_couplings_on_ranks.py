"""Springs, bolts and remote points give the same answer on any number of ranks, in both forms of the bodies."""

from pathlib import Path

from numpy.testing import assert_allclose

from shared.ranks import told

SCRIPT = """
import json
from mpi4py import MPI
import stickslip
words = [
    "springs.side={at='block.left',to='block.right',stiffness=[0.2,0.1]}",
    "springs.tip={at=[4.0,2.0],stiffness=0.3,direction=[1.0,1.0],displacement=[0.05,0.0]}",
    "springs.stop={at='block.top',stiffness=0.2,direction=[0.0,1.0],acts='compression',gap=0.005}",
    "springs.slack={at=[4.0,0.0],stiffness=0.2,direction=[1.0,0.0],acts='compression'}",
    "geometry={builder='block',length=4.0,height=2.0,mesh_size=0.5,order=ORDER}",
    "solver={method='surface-uzawa',surface='FORM',tolerance=1e-10}",
    "steps={end=2.0,count=2}",
    "supports.top={boundary='block.left',displacement={x=[[0.0,0.0],[1.0,0.01]]}}",
    "remote_points.lid={boundary='block.top',point=[1.0,5.0],coupling='rigid',force={y=-0.1,x=0.05},moment={z=0.02}}",
    "bolts.tie={head='block.right',nut='block.left',axis=[1.0,0.0],stiffness=0.05,shortening=0.02}",
    "remote_points.end={boundary='block.left',point=[0.0,1.5],coupling='distributing',moment={z=0.01}}",
]
found = []
for form, order in (("condensed", 2), ("matrix-free", 1)):
    own = [word.replace("ORDER", str(order)).replace("FORM", form) for word in words]
    simulation = stickslip.prepare(stickslip.read("block", own))
    *_, step = simulation.steps()
    numbers = [x for kind in (step.springs, step.remote_points) for each in kind.values() for x in each]
    numbers += [*step.bolts.values()]
    found.append([*(float(x) for values in numbers for x in values), step.energy.stored])
everywhere = MPI.COMM_WORLD.gather(found)
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(everywhere))
"""


def test_ranks_agree_on_forces_and_motions(tmp_path: Path) -> None:
    (alone,), (one, other) = (told(SCRIPT, ranks, tmp_path) for ranks in (1, 2))
    assert one == other
    assert_allclose(one, alone, rtol=1e-6, atol=1e-9)
