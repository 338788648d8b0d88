"""The block of Raous, Chabrand and Lebon lifts off, slips and sticks as published."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.workflows.lab.verification.cases import raous as raous_case
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.closed_forms import raous
from stickslip.workflows.lab.verification.prepared import prepare

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


@pytest.mark.parametrize(
    ("method", "counts"), [("condensed-newton", (1, 5, 20)), ("uzawa", (1, 5)), ("surface-uzawa", (1, 5))]
)
def test_more_steps_change_the_dissipation_by_its_law_and_the_displacement_not_at_all(
    method: str, counts: tuple[int, ...]
) -> None:
    assert not failures(raous_case.ramped(method, counts=counts, n=8))


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_more_steps_do_so_on_the_tabulated_mesh_too(method: str) -> None:
    assert not failures(raous_case.ramped(method))


def test_friction_converges_to_the_published_figure_as_the_mesh_is_refined() -> None:
    F_t = []
    for n in (16, 32, 64):
        (step,) = prepare(raous_case.scene("condensed-newton", n=n)).steps()
        F_t.append(step.contacts["base"].tangential_force)
    # 1.6, .41, .10 % too large: this is why .6 % is allowed at n = 32
    rate = np.log2((F_t[0] - F_t[1]) / (F_t[1] - F_t[2]))
    assert abs(rate - 2) < 0.2  # P1: a resultant converges as the energy does, here still without a sign of the corners
    # the source has 5 digits, so .4e-4 at most is rounding; as much again for what is not quite h^2 yet
    assert_allclose(F_t[2] + (F_t[2] - F_t[1]) / 3, raous.F_T, rtol=1e-4)


def test_both_methods_give_the_same_block() -> None:
    (a, _), (b, _) = (raous_case.solve(method) for method in METHODS)
    # both at tolerance 1e-11, relative to p_ref; three digits for the condition of a mesh of 32 cells at mu = 1
    assert_allclose(a.displacement, b.displacement, atol=1e-8 * np.abs(b.displacement).max())
    assert_allclose(a.contacts["base"].force, b.contacts["base"].force, rtol=1e-8)


def test_springs_that_start_again_take_a_soft_penalty_back() -> None:
    """Springs as stiff as the surface, about 10 E/a: alone they move the corner by 3 % of its displacement."""

    def corner(method: str, **springs: Any) -> float:
        scene = raous_case.scene(method, n=8)
        simulation = prepare(replace(scene, solver=replace(scene.solver, **springs)))
        (step,) = simulation.steps()
        return float(step.displacement[np.linalg.norm(simulation.data.points, axis=1).argmin(), 0])

    exact = corner("condensed-newton")
    assert abs(corner("perturbed-lagrangian", omega_factor=1.0, augment=False) / exact - 1) > 0.02
    assert abs(corner("perturbed-lagrangian", omega_factor=1.0) / exact - 1) < 1e-3


@pytest.mark.parametrize("method", METHODS)
def test_checks_fail_without_friction(method: str) -> None:
    checks = raous_case.once(method, mu=0.0) + raous_case.ramped(method, mu=0.0, counts=(1, 5), n=8)
    passing = {check.name for check in checks if check.passed}
    # the balances hold without friction, and so does that the displacement does not depend on the steps
    assert {name for name in passing if "displacement less" not in name and "work that" not in name} <= {
        "F_n, contact and corner [N/m]",
        "open, slip, stick come in this order (1: yes)",
        "last open node [m]",
    }
