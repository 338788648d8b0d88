"""No entry of a stiffness is too small: the factorisation knows no absolute threshold."""

import pytest
from numpy.testing import assert_allclose

from stickslip.solvers.results.step_result import ContactState
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import read

SIZES = ["geometry.mesh_size=0.3", "geometry.lower_mesh_size=0.4", "geometry.contact_mesh_size=0.15"]


def joint(E: float) -> ContactState:
    """Two blocks of the same stiffness [Pa], moved: forces are proportional to it."""
    simulation = prepare(read("two_blocks", [*SIZES, f"bodies.upper.E={E}", f"bodies.lower.E={E}"]))
    *_, last = simulation.steps()
    return last.contacts["joint"]


@pytest.mark.parametrize("E", [1e-24, 1e-16, 1e24])
def test_forces_are_proportional_to_the_stiffness_of_all_bodies(E: float) -> None:
    found, one = joint(E), joint(1.0)
    assert_allclose(found.force / E, one.force, rtol=1e-9)
    assert_allclose(found.pressure / E, one.pressure, rtol=0, atol=1e-8 * one.max_pressure)
