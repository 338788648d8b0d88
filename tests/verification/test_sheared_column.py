"""A sheared column sticks below its bound, slips at it, comes back, and dissipates bound times slip."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.laws.tangential_compliance import TangentialCompliance
from stickslip.workflows.lab.verification.cases import sheared_column as sheared_column_case
from stickslip.workflows.lab.verification.cases.sheared_column import (
    K_T,
    MU,
    E,
    bases,
    cycled,
    driven,
    laws,
    penetrating,
    scene,
    threshold,
)
from stickslip.workflows.lab.verification.check import Check, failures
from stickslip.workflows.lab.verification.closed_forms import sheared_column
from stickslip.workflows.lab.verification.cycles import accounted, repeats
from stickslip.workflows.lab.verification.prepared import prepare

METHODS = ("condensed-newton", "uzawa")
PATH = sheared_column.TOP[:, None]
# tolerances are the case's own, 1e-9: the state is uniform, and a step of any size is exact


def test_cycles_that_differ_are_noticed() -> None:
    steps = sheared_column_case.solve(
        scene(dim=2, method="condensed-newton", E=E, friction=Coulomb(mu=MU), path=np.tile(PATH, (5, 1)))
    )
    same = repeats("as they are", steps[1:], len(PATH))
    shifted = repeats("a step too early", steps[:-1], len(PATH))
    assert not failures(same)
    assert not failures(shifted)  # from cycle 2 on any five steps in a row come again
    grown = [*steps[:-1], replace(steps[-1], contacts=steps[-2].contacts)]
    assert {name.split(": ")[1].split(",")[0] for name in failures(repeats("another end", grown[1:], len(PATH)))} == {
        "tractions", "slip increments", "gaps", "forces",
    }  # fmt: skip
    still = [*steps[:-1], replace(steps[-1], contacts=steps[-3].contacts)]  # only sticks, and loses nothing
    assert "dissipation [J]" in " ".join(failures(repeats("another end", still[1:], len(PATH))))


@pytest.mark.parametrize(("c_T", "m_T"), [(1.001e6, 2.0), (1e6, 2.001)])
def test_threshold_notices_another_power_of_the_penetration(
    c_T: float, m_T: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sheared_column_case, "TangentialCompliance", lambda **_: TangentialCompliance(c_T=c_T, m_T=m_T))
    assert failures(threshold("condensed-newton", 1e6, 2.0))
    assert len(failures(penetrating("condensed-newton", 1e6, 2.0))) > 10  # of 21; the first move only sticks


def test_a_stiff_base_is_that_of_the_rigid_law() -> None:
    rigid, stiff = (
        bases(scene(dim=2, method="condensed-newton", E=E, friction=Coulomb(mu=MU, k_T=k_T), path=PATH))
        for k_T in (None, 1e9)
    )
    for mine, theirs in zip(rigid, stiff, strict=True):
        # G / k_T = 1e-6 of what a move of 20 mm would make, 20 Pa, and of the move itself
        assert_allclose(mine.traction, theirs.traction, atol=2e-5)
        assert_allclose(mine.slip, theirs.slip, atol=2e-8)


def test_elastic_give_is_stored_and_given_back() -> None:
    law = Coulomb(mu=MU, k_T=K_T)
    steps = list(prepare(scene(dim=2, method="condensed-newton", E=E, friction=law, path=PATH)).steps())
    exact = sheared_column.drive(sheared_column.ShearedColumn(G=1000.0, bound=3.0, k_T=K_T), sheared_column.TOP)
    for step, tau in zip(steps[-len(PATH) :], exact.tau, strict=True):
        # closed form, as accurate as the states
        assert_allclose(step.energy.compliance, tau**2 / (2 * K_T), rtol=1e-9)
        assert_allclose(step.energy.external, step.energy.stored + step.energy.contact, rtol=1e-8)
    stuck = steps[-len(PATH)].energy
    assert_allclose(stuck.contact, stuck.compliance, rtol=1e-9)  # nothing has slipped: all of it is elastic
    assert_allclose(stuck.dissipated, 0.0, atol=1e-9 * stuck.compliance)


def test_bound_is_mu_times_pressure_for_coulomb_and_as_given_for_tresca() -> None:
    for law in laws(mu=MU / 2).values():
        slipping = bases(scene(dim=2, method="condensed-newton", E=E, friction=law, path=PATH))[2]
        # as above
        assert_allclose(slipping.tangential_force, MU / 2 * sheared_column_case.PRESSURE, rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("law", laws())
def test_checks_fail_without_friction(method: str, law: str) -> None:
    def names(checks: list[Check], passed: Callable[[Check], bool]) -> set[str]:
        return {check.name.split(":")[1].split("[")[0].strip() for check in checks if passed(check)}

    checks = [c for c in driven(method, law, laws(mu=0.0)[law]) if "pressure" not in c.name]
    passing = names(checks, lambda check: check.passed)
    assert passing <= {"dissipation so far"}  # the moves that only stick dissipate nothing either way
    assert len(failures(checks)) == len(checks) - 1
    assert len(failures(cycled(method, mu=0.0))) == 4


def test_energy_that_is_lost_is_noticed() -> None:
    steps = sheared_column_case.solve(scene(dim=2, method="condensed-newton", E=E, friction=Coulomb(mu=MU), path=PATH))
    assert not failures(accounted("as it is", steps))
    energy, base = steps[3].energy, steps[3].contacts["base"]
    lost = replace(steps[3], energy=replace(energy, external=energy.external * (1 + 1e-8)))
    assert len(failures(accounted("work without an effect", [*steps[:3], lost]))) == 1
    driven = replace(steps[3], contacts={"base": replace(base, dissipation=-1e-9 * energy.external)})
    assert len(failures(accounted("friction that drives", [*steps[:3], driven]))) == 1


def test_dissipation_of_the_last_state_is_the_sum_over_the_moves() -> None:
    states = bases(scene(dim=2, method="condensed-newton", E=E, friction=Coulomb(mu=MU), path=PATH))
    # a sum of six terms: rounding
    assert_allclose(np.sum([s.dissipation for s in states]), states[-1].dissipation_total, rtol=1e-13)
