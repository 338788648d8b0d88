"""A bolted joint, against the closed form."""

import pytest

from shared.cases import slow
from stickslip.workflows.lab.verification.cases import bolted_joint as case
from stickslip.workflows.lab.verification.check import failures


@pytest.mark.parametrize("method", ["condensed-newton", "uzawa", *slow("surface-uzawa")])
def test_bolt_and_plates_share_what_draws_the_joint_apart(method: str) -> None:
    assert not failures(case.checks(method))


@pytest.mark.parametrize("name", ["BOLT", "FORCE"])
def test_checks_notice_another_bolt(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(case, name, 1.001 * getattr(case, name))
    assert len(failures(case.checks("condensed-newton"))) >= 6
