"""Rings that spin, against the closed form."""

import pytest

from stickslip.workflows.lab.verification.cases import spinning_rings as case
from stickslip.workflows.lab.verification.check import failures


def test_free_rings_and_a_cylinder_grow_as_the_closed_form_says() -> None:
    assert not failures(case.free())


@pytest.mark.parametrize("method", ["condensed-newton", "uzawa"])
def test_speed_loosens_a_shrink_fit(method: str) -> None:
    assert not failures(case.loosened(method))


def test_checks_notice_another_density(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(case, "DENSITIES", (2.002, 1.0))
    assert len(failures(case.loosened("condensed-newton"))) == 2
