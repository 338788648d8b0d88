"""A column that grazes, is pressed, dragged, lifted off, carried aside and set down again follows the closed form."""

import pytest

from stickslip.solvers.laws.compliance import Compliance
from stickslip.workflows.lab.verification.cases import lifted as lifted_case
from stickslip.workflows.lab.verification.check import failures

METHODS = ("condensed-newton", "uzawa", "surface-uzawa")
# tolerances are the case's own, with their reasons


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dim", [2, 3])
def test_contact_is_lost_and_regained(method: str, dim: int) -> None:
    assert not failures(lifted_case.checks_of(method, dim))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("foundation", lifted_case.FOUNDATIONS, ids=lambda law: f"m={law.m_n:g}")
def test_contact_with_a_foundation_that_gives_way_is_lost_and_regained(method: str, foundation: Compliance) -> None:
    assert not failures(lifted_case.checks_of(method, 2, normal=foundation))


def test_checks_notice_another_friction() -> None:
    missed = failures(lifted_case.checks_of("condensed-newton", 3, mu=0.2))
    assert len(missed) > 20  # shear, slip and dissipation from the first slip on
    assert {name.split(": ")[1].split(" ")[0] for name in missed} == {"shear", "slip", "dissipation"}
