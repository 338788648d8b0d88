"""The block of Raous, Chabrand and Lebon lifts off, slips and sticks as published."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from workflows.verification import raous, raous_case
from workflows.verification.check import failures

METHODS = ("condensed-newton", "uzawa")
# tolerances are the case's own, with their reasons: the mesh, the digits of the source, or the solver


@pytest.mark.parametrize("method", METHODS)
def test_contact_face_moves_as_on_the_same_mesh_elsewhere(method: str) -> None:
    assert not failures(raous_case.displacements(method))


@pytest.mark.parametrize("method", METHODS)
def test_forces_balance_and_friction_is_the_published_one(method: str) -> None:
    assert not failures(raous_case.forces(method))


@pytest.mark.parametrize("method", METHODS)
def test_face_is_open_then_slips_then_sticks(method: str) -> None:
    assert not failures(raous_case.zones(method))


@pytest.mark.parametrize("method", METHODS)
def test_more_steps_change_the_dissipation_by_its_law_and_the_displacement_not_at_all(method: str) -> None:
    assert not failures(raous_case.ramped(method))


def test_friction_falls_towards_the_converged_figure_as_the_mesh_is_refined() -> None:
    excess = []
    for n in (16, 32, 64):
        (step,) = raous_case.prepare(raous_case.scene("condensed-newton", n=n)).steps()
        excess.append(step.contacts["base"].tangential_force / raous.F_T - 1)
    # 1.03, 0.41, 0.17 %: this is why 0.6 % is allowed at n = 32
    assert np.all(np.diff(excess) < 0)
    assert 0 < excess[-1] < 0.6 * excess[-2]


def test_both_methods_give_the_same_block() -> None:
    (a, _), (b, _) = (raous_case.solve(method) for method in METHODS)
    # both at tolerance 1e-11; Coulomb friction at mu = 1 on this mesh multiplies it by some 1e2
    assert_allclose(a.displacement, b.displacement, atol=1e-8 * np.abs(b.displacement).max())
    assert_allclose(a.contacts["base"].force, b.contacts["base"].force, rtol=1e-8)


@pytest.mark.parametrize("method", METHODS)
def test_checks_fail_without_friction(method: str) -> None:
    checks = raous_case.checks(method, mu=0.0)
    passing = {check.name for check in checks if check.passed}
    # the balance of vertical forces, and that the displacement does not depend on the steps, hold without friction
    assert {name for name in passing if not name.startswith("displacement")} <= {
        "F_n, contact and corner [N/m]",
        "open, slip, stick come in this order (1: yes)",
        "last open node [m]",
    }
