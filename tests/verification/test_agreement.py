"""All methods agree on the ready scenes, wherever the table of applicability allows one."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.method_registry import METHODS
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.lab.verification.cases import agreement as agreement_case
from stickslip.workflows.lab.verification.cases.agreement import ALL, REFERENCE, SCENES
from stickslip.workflows.lab.verification.check import failures

UZAWA = ("uzawa", "inexact-uzawa", "nonlinear-uzawa", "gram-uzawa")
OTHERS = [(name, method) for name in SCENES for method in ALL if method != REFERENCE]
PAIRS = [pair for pair in OTHERS if agreement_case.fits(*pair)]


@pytest.mark.parametrize("method", agreement_case.SLOW)
def test_slow_methods_agree_on_the_cube(method: str) -> None:
    """On all scenes they and the others are compared by test_cases."""
    assert not failures(agreement_case.compared("cube", method))


def test_only_what_the_table_refuses_is_left_out() -> None:
    """`regularised` between bodies, and where contact alone holds a body all that need supports."""
    left_out = {pair for pair in OTHERS if pair not in PAIRS}
    between = [name for name in SCENES if name.startswith(("cylinders", "shrink"))]
    need_supports = [method for method in ALL if not METHODS[method].WORKS_WITH.floating]
    assert set(UZAWA) <= set(need_supports)
    assert left_out == {(name, "regularised") for name in between} | {
        ("shrink_fit", method) for method in need_supports
    }


@pytest.mark.parametrize("method", ["surface-uzawa", "regularised"])
def test_another_coefficient_of_friction_is_not_taken_for_the_same(
    method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    true = agreement_case.scene

    def slippery(name: str, by: str, **solver: Any) -> Scene:
        made = true(name, by, **solver)
        worn = replace(made.contacts["base"], friction=Coulomb(mu=0.3 * (1 + 1e-4)))
        return replace(made, contacts={"base": worn}) if by == method else made

    agreement_case.solve.cache_clear()
    monkeypatch.setattr(agreement_case, "scene", slippery)
    try:
        failed = failures(agreement_case.compared("cube", method))
    finally:
        agreement_case.solve.cache_clear()
    for quantity in ("forces", "resultants", "displacements"):
        assert any(quantity in sentence for sentence in failed)
    assert method == "surface-uzawa" or any("energy norm of its error over that stated" in line for line in failed)


def test_a_limit_takes_the_first_orders_away() -> None:
    levels = np.array([0.1, 0.03, 0.01])
    found = [{"u": np.array([3.0 + 2.0 * h, -1.0 + 5.0 * h - 7.0 * h**2])} for h in levels]
    assert np.allclose(agreement_case.limit(levels, found)["u"], [3.0, -1.0], rtol=1e-13)
