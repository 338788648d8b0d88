"""A compliant face shifts the block of Raous as published, down to a compliance that nobody can tell from none."""

import pytest
from numpy.testing import assert_allclose

from stickslip.solvers.laws.friction import Coulomb
from stickslip.workflows.lab.verification.cases import raous as raous_case
from stickslip.workflows.lab.verification.cases.raous_compliance import RIGID, checks, solve
from stickslip.workflows.lab.verification.check import failures


@pytest.mark.parametrize("method", ["condensed-newton", "uzawa"])
def test_compliance_shifts_the_corner_as_published(method: str) -> None:
    assert not failures(checks(method))


def test_checks_fail_with_other_friction() -> None:
    assert len(failures(checks("condensed-newton", mu=0.9))) == 4


def test_the_shift_is_that_of_both_stiffnesses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(raous_case, "Coulomb", lambda mu, k_T: Coulomb(mu=mu))  # rigid before slip
    solve.cache_clear()
    try:
        assert len(failures(checks("condensed-newton"))) >= 2
    finally:
        solve.cache_clear()


def test_huge_stiffness_changes_neither_the_answer_nor_the_effort() -> None:
    limit, u_limit = solve("condensed-newton", RIGID)
    for k in (1e4, 1e6):
        step, u = solve("condensed-newton", k)
        assert_allclose(u, u_limit, rtol=0.5 / k)  # the published shift is .43 / k
        assert_allclose(step.contacts["base"].force, limit.contacts["base"].force, rtol=5 / k)
        assert step.substeps == limit.substeps == 1
        assert step.iterations <= 1.5 * limit.iterations  # 43 and 33
    assert limit.iterations < 60  # 32
