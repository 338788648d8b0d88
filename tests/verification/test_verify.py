"""`verify` says what was computed and what was expected, and whether all of it agrees."""

import pytest

from stickslip.geometry.errors import SceneError, SolverError
from stickslip.workflows.lab.verification import registry as module
from stickslip.workflows.lab.verification.check import Check, failures
from stickslip.workflows.lab.verification.registry import Case, verify


def right(method: str) -> list[Check]:
    return [Check("right [m]", 1.0, 1.0, 0.0, relative=True)]


def test_a_problem_is_a_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(module, "CASES", {"zeros": Case(about="a right figure", checks=right)})
    assert verify(["zeros"])
    one, last = capsys.readouterr().out.splitlines()
    assert one.split()[0] == "zeros"
    assert one.split()[2] == "passed"
    assert last.endswith("checks passed")


def test_named_problem_is_solved_and_tabulated(capsys: pytest.CaptureFixture[str]) -> None:
    assert verify(["zeros"], every_row=True)
    printed = capsys.readouterr().out
    for word in ("no increment", "condensed-newton", "uzawa", "surface-uzawa", "deviation", "checks passed"):
        assert word in printed


def test_unknown_problem_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(SceneError, match=r"raus: no such verification problem; did you mean raous\?"):
        verify(["zeros", "raus"])


def test_one_wrong_figure_fails_the_whole(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def checks(method: str) -> list[Check]:
        return [*right(method), Check("wrong [m]", 1.0, 2.0, 0.1, relative=True)]

    monkeypatch.setattr(module, "CASES", {"wrong": Case(about="a wrong figure", checks=checks)})
    assert not verify([])
    printed = capsys.readouterr().out
    assert "3 of 6 checks failed" in printed  # with each of three methods
    assert "3 of 6 FAILED" in printed
    assert "wrong [m]" in printed
    assert "right [m]" not in printed


def test_problem_without_an_answer_fails_and_the_others_go_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def checks(method: str) -> list[Check]:
        raise SolverError("t = 1: not converged")

    monkeypatch.setattr(
        module, "CASES", {"stuck": Case(about="no answer", checks=checks), "right": Case(about="", checks=right)}
    )
    assert not verify([])
    printed = capsys.readouterr().out
    assert "not solved: t = 1: not converged" in printed
    assert "passed" in printed


def test_check_that_is_not_a_number_fails_and_no_check_is_no_success() -> None:
    assert not Check("force [N]", float("nan"), 0.0, 1.0, relative=False).passed
    with pytest.raises(ValueError, match="nothing was checked"):
        failures([])
    with pytest.raises(ValueError, match="cannot be relative"):
        Check("force [N]", 1.0, 0.0, 1.0, relative=True)
