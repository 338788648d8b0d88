"""A sheared column sticks below its bound, slips at it, comes back, and dissipates bound times slip."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

from solvers.effects.friction import Coulomb
from workflows.verification import sheared_column, sheared_column_case
from workflows.verification.check import Check, failures
from workflows.verification.sheared_column_case import MU, E, bases, cycled, driven, laws, scene

METHODS = ("condensed-newton", "uzawa")
PATH = sheared_column.TOP[:, None]
# tolerances are the case's own, 1e-9: the state is uniform, and a step of any size is exact


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("law", laws())
def test_column_sticks_slips_and_reverses_as_the_closed_form(method: str, law: str) -> None:
    assert not failures(driven(method, law, laws()[law]))


@pytest.mark.parametrize("method", METHODS)
def test_every_cycle_of_many_dissipates_the_same(method: str) -> None:
    assert not failures(cycled(method))


def test_both_methods_give_the_same_history() -> None:
    a, b = (bases(scene(dim=2, method=method, E=E, friction=Coulomb(mu=MU), path=PATH)) for method in METHODS)
    for mine, theirs in zip(a, b, strict=True):
        # both at tolerance 1e-12, relative to a pressure of 10 Pa and a motion of 10 mm
        assert_allclose(mine.traction, theirs.traction, atol=1e-9)
        assert_allclose(mine.slip, theirs.slip, atol=1e-12)


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
    assert passing <= {"dissipation so far"}  # the first move only sticks, and dissipates nothing either way
    assert len(failures(checks)) == len(checks) - 1
    assert len(failures(cycled(method, mu=0.0))) == 4


def test_dissipation_of_the_last_state_is_the_sum_over_the_moves() -> None:
    states = bases(scene(dim=2, method="condensed-newton", E=E, friction=Coulomb(mu=MU), path=PATH))
    # a sum of six terms: rounding
    assert_allclose(np.sum([s.dissipation for s in states]), states[-1].dissipation_total, rtol=1e-13)
