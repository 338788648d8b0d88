"""A column on an elastic bed, against the closed form."""

import pytest

from stickslip.workflows.lab.verification.cases import elastic_bed as case
from stickslip.workflows.lab.verification.check import failures


@pytest.mark.parametrize("method", ["condensed-newton", "uzawa", "surface-uzawa"])
def test_springs_and_column_share_what_the_plate_presses(method: str) -> None:
    assert not failures(case.checks(method))


@pytest.mark.parametrize("name", ["NORMAL", "TANGENTIAL"])
def test_checks_notice_other_springs(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(case, name, 1.001 * getattr(case, name))
    assert len(failures(case.checks("condensed-newton"))) >= 6
