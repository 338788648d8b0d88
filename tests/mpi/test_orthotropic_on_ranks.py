"""Orthotropic bodies give the same answer, with the same errors, on any number of ranks."""

from pathlib import Path

from numpy.testing import assert_allclose

from shared.ranks import told

SCRIPT = """
import json
from mpi4py import MPI
import stickslip
from stickslip.solvers.results.error_parts import Quantity
words = ["geometry.mesh_size=0.01", "steps.count=3", "solver.tolerance=1e-11"]
found = []
for order in (1, 2):
    simulation = stickslip.prepare(stickslip.read("spruce", [*words, f"geometry.order={order}"]))
    steps = [*simulation.steps()]
    errors = simulation.errors(steps)
    for step, error in zip(steps, errors):
        base = step.contacts["base"]
        found += [base.normal_force, base.tangential_force, base.stick_area, step.energy.stored]
        found += [error[Quantity("contacts", "base", key)].mesh for key in ("tangential_force", "dissipation")]
everywhere = MPI.COMM_WORLD.gather([float(value) for value in found])
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(everywhere))
"""


def test_ranks_agree_on_forces_and_errors(tmp_path: Path) -> None:
    (alone,), (one, other) = (told(SCRIPT, ranks, tmp_path) for ranks in (1, 2))
    assert one == other
    assert_allclose(one, alone, rtol=1e-6, atol=1e-9 * max(alone))
