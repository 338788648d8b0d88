"""Two bars under body forces that are expressions of place and time, against the closed form."""

from typing import Literal

import pytest

from stickslip.workflows.lab.verification.cases import two_bars as case
from stickslip.workflows.lab.verification.check import failures


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("method", ["condensed-newton", "uzawa"])
def test_bars_meet_as_the_closed_form_says(method: str, order: Literal[1, 2]) -> None:
    assert not failures(case.checks(method, order))


def test_checks_notice_another_force(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(case, "A_2", 1.001 * case.A_2)
    wrong = case.scene("condensed-newton")
    monkeypatch.undo()
    monkeypatch.setattr(case, "scene", lambda method, order: wrong)
    assert len(failures(case.checks("condensed-newton"))) >= 8
