"""What is on the contact surface is shared out among ranks, and the answer is that of one rank."""

from itertools import product
from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_allclose

from shared.cases import slow
from shared.ranks import each_told, told

TANGENT = """
import json
import numpy as np
from mpi4py import MPI
import stickslip
from stickslip.solvers.interface.prepare import prepare_surface
from stickslip.solvers.tangent.coordinates import ContactCoordinates
simulation = stickslip.prepare(stickslip.read(SCENE, WORDS))
steps = [*simulation.steps()]
found = []
for step in steps:
    found += [step.energy.stored, *(c.normal_force for c in step.contacts.values())]
    found += [value for force, moment in step.supports.values() for value in (*force, *moment)]
system = simulation.system
surface = prepare_surface(system, simulation.stepper.chain.volume)
coordinates = ContactCoordinates.of(system, surface)
u, v, again = (system.K_B.createVecRight() for _ in range(3))
low, high = u.getOwnershipRange()
u.array[:] = np.sin(np.arange(low, high))
coordinates.inverse.mult(u, v)
coordinates.T.mult(v, again)
own = np.flatnonzero((coordinates.at >= low) & (coordinates.at < high))
w = (surface.N @ surface.volume.contact.read(u))[own]
wrong = float(max(abs((again - u).array).max(), abs(w - v.array[coordinates.at[own] - low]).max(initial=0.0)))
comm = MPI.COMM_WORLD
rows = comm.allreduce(len(own))
assert rows == np.count_nonzero(coordinates.at >= 0), "a row belongs to no rank, or to several"
everywhere = comm.gather(found), comm.gather(wrong), comm.gather(len(own)), rows
if comm.rank == 0:
    print(json.dumps(everywhere))
"""
ALWAYS = ["solver.tolerance=1e-11", "output.error=false", 'solver.method="tangent-cg"']
SLAB = ["geometry.mesh_size=0.125", "geometry.height=0.25"]
BALLS = ["geometry.order=1", "geometry.contact_mesh_size=0.1"]
SOFT = ['contacts.base.normal={ law = "compliance", c_n = 20.0, m_n = 1.0 }']
BLOCKS = "length=1.0, width=1.0, height=1.0, lower_length=2.0, mesh_size=0.25, lower_mesh_size=0.3"
SEARCHED = [
    "model=3d",
    f'geometry={{ builder = "two_blocks", {BLOCKS} }}',
    "supports.base.displacement={ x = 0.0, y = 0.0, z = 0.0 }",
    "supports.top.displacement={ x = [[0, 0], [1, 0], [2, 0.4]], y = 0.0, z = [[0, 0], [1, -0.02]] }",
    "contacts.joint.sliding=true",
    "contacts.joint.friction.mu=0.1",
    "steps.count=2",
]
CASES = {
    "searched": ("two_blocks", SEARCHED),
    "rigid": ("cube", SLAB),
    "compliant": ("cube", [*SLAB, *SOFT]),
    "mortar": ("spheres", BALLS),
}


QUICK = [("searched", 2)]  # two bodies whose meshes do not match, and rows that change


def coordinates(case: str) -> str:
    scene, words = CASES[case]
    return TANGENT.replace("SCENE", repr(scene)).replace("WORDS", repr([*ALWAYS, *words]))


@pytest.mark.parametrize(
    ("case", "ranks"),
    [
        pytest.param(case, ranks, marks=[] if (case, ranks) in QUICK else pytest.mark.slow)
        for case, ranks in product(CASES, (2, 3))
    ],
)
def test_contact_coordinates_are_shared_by_slave_node(
    case: str, ranks: int, on_two: dict[str, Any], tmp_path: Path
) -> None:
    script = coordinates(case)
    (alone,), _, _, count = told(script, 1, tmp_path)
    found, wrong, shares, rows = on_two[case] if (case, ranks) in QUICK else told(script, ranks, tmp_path)
    assert rows == count == sum(shares) > 50
    assert max(wrong) < 1e-12
    assert all(one == found[0] for one in found)
    assert_allclose(found[0], alone, rtol=1e-8, atol=1e-9 * max(map(abs, alone)))


SECANTS = """
import json
import numpy as np
from mpi4py import MPI
import stickslip
from stickslip.solvers import metrics
metrics.SHARED = 0
simulation = stickslip.prepare(stickslip.read("cube", WORDS))
steps = [*simulation.steps()]
found = [value for step in steps for value in (step.energy.stored, step.contacts["base"].tangential_force)]
(ready,) = simulation.stepper.chain._ready.values()
pairs = ready.learnt["F"]._S
comm = MPI.COMM_WORLD
everywhere = comm.gather(found), comm.gather(pairs.shape), steps[-1].volume_solves
if comm.rank == 0:
    print(json.dumps(everywhere))
"""
CUBE = ["geometry.mesh_size=0.25", 'solver.method="surface-uzawa"', 'solver.surface="matrix-free"']
LEARNT = SECANTS.replace("WORDS", repr([*CUBE, "solver.tolerance=1e-10", "output.error=false"]))


@pytest.fixture(scope="module")
def on_two(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What always runs on two ranks, in one mpirun."""
    scripts = {case: coordinates(case) for case, _ in QUICK} | {"learnt": LEARNT}
    return each_told(scripts, 2, tmp_path_factory.mktemp("on_two"))


@pytest.mark.parametrize("ranks", [2, *slow(3)])
def test_secants_are_shared_by_rows(ranks: int, on_two: dict[str, Any], tmp_path: Path) -> None:
    (alone,), ((rows, pairs),), _ = told(LEARNT, 1, tmp_path)
    found, shapes, _ = on_two["learnt"] if ranks == 2 else told(LEARNT, ranks, tmp_path)
    assert sum(share for share, _ in shapes) == rows
    assert max(share for share, _ in shapes) <= rows / ranks + 1
    assert all(count == shapes[0][1] > 0 for _, count in shapes)
    assert abs(shapes[0][1] - pairs) <= pairs / 3  # multigrid differs, and with it what volume solves leave
    assert all(one == found[0] for one in found)
    assert_allclose(found[0], alone, rtol=1e-7, atol=1e-9 * max(alone))  # the shear of the first step is zero
