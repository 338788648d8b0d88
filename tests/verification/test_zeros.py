"""Where there is nothing to do, nothing is done: no change, at most one iteration, no 0/0."""

import pytest

from stickslip.workflows.lab.verification.cases import zeros as zeros_case
from stickslip.workflows.lab.verification.check import failures

METHODS = ("condensed-newton", "uzawa")
# tolerances are the case's own: 0, or the rounding of one solve with the bodies


@pytest.mark.parametrize("method", METHODS)
def test_block_without_force_does_not_move(method: str) -> None:
    assert not failures(zeros_case.no_force(method))


def test_floating_block_without_force_does_not_move() -> None:
    assert not failures(zeros_case.no_force("condensed-newton", held=False))  # Uzawa refuses floating bodies


@pytest.mark.parametrize("method", METHODS)
def test_block_that_touches_nothing_follows_its_support_unstrained(method: str) -> None:
    assert not failures(zeros_case.no_touch(method))


@pytest.mark.parametrize("method", METHODS)
def test_step_in_which_nothing_moves_changes_nothing(method: str) -> None:
    assert not failures(zeros_case.no_increment(method))


@pytest.mark.parametrize("method", METHODS)
def test_no_coefficient_and_no_bound_are_no_friction(method: str) -> None:
    assert not failures(zeros_case.no_friction(method))


@pytest.mark.parametrize("method", METHODS)
def test_checks_of_no_friction_fail_with_friction(method: str) -> None:
    checks = [check for check in zeros_case.no_friction(method, mu=0.3) if "none" not in check.name]
    assert len(failures(checks)) == len(checks)


@pytest.mark.parametrize("method", METHODS)
def test_checks_of_no_increment_fail_without_friction(method: str) -> None:
    assert failures(zeros_case.no_increment(method, mu=0.0))  # the step before does not stick anywhere
