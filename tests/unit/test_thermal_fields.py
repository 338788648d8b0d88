"""Temperatures that change from place to place: bent bars without stress, held bars, a cylinder; refusals."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from shared.audited import record_of, stored_by
from stickslip.geometry.errors import SceneError
from stickslip.solvers.results.audit import Auditor
from stickslip.workflows.lab.verification.cases import warm_bars as case
from stickslip.workflows.lab.verification.cases.warm_bars import scene
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.prepared import prepare


def test_bars_bend_freely_or_press_and_a_cylinder_and_two_bodies_too() -> None:
    for simulation, steps, checks in case.problems():
        assert not failures(checks)
        auditor = Auditor(simulation.problem, simulation.mesh)
        for step in steps:
            found = vars(auditor(replace(record_of(step), stored=stored_by(step))))
            assert max(found.values()) < 1e-7
            balance = step.energy.stored + step.energy.contact
            assert step.energy.external == pytest.approx(balance, rel=1e-8, abs=1e-12)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"temperature": "20*t"}, r'thermal\.block\.temperature = "20\*t": t: has no place here; give its factor'),
        ({"temperature": "20*z"}, r'thermal\.block\.temperature = "20\*z": z: a plane model has x and y only'),
        ({"temperature": 20.0, "history": 1.0}, r"thermal\.block\.history = given: only of an expression"),
        ({"temperature": "20*q"}, r'thermal\.block\.temperature = "20\*q": '),
    ],
)
def test_a_wrong_field_is_refused_in_one_line(table: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene("plane strain", table)


def test_a_field_without_a_finite_value_is_refused() -> None:
    held = {"left": {"boundary": "block.left", "displacement": {"x": 0.0, "y": 0.0}}}
    with pytest.raises(SceneError, match=r"thermal\.block\.temperature: the expression has no finite value"):
        list(prepare(scene("plane strain", "log(x-1)", supports=held)).steps())
