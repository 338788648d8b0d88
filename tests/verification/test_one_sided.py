"""Springs that act in one way, as docs/howto/one_sided.md makes them of contacts: piecewise linear closed forms."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_allclose

from stickslip.solvers.results.step_result import StepResult
from stickslip.workflows.scene_file.read import from_dict
from stickslip.workflows.verification.prepared import prepare

PAGE = Path(__file__).resolve().parents[2] / "docs/howto/one_sided.md"
BUMPER, CABLE = (tomllib.loads(text) for text in re.findall(r"^```toml\n(.*?)^```$", PAGE.read_text(), re.M | re.S))
BASE, K, APART, MOST = 300.0, 500.0, 0.01, 20.0  # [N/m], [N/m], [m], [N]
EA = 2000.0  # of a column of 1 m [N]
PULSE = {0.5: 0.5, 1.0: 1.0, 1.5: 0.5, 2.0: 0.0, 2.5: -0.5, 3.0: -1.0}  # of the force, over its most, in time
SOLVERS = [("auto", "auto"), ("uzawa", "auto"), ("surface-uzawa", "matrix-free")]


def carried(force: float, stiffness: float) -> float:
    """By a spring [N/m] that is touched after a way of 10 mm, and then acts beside one that always does.

    >>> carried(2.0, 500.0), carried(19.0, 500.0)
    (0.0, 10.0)
    """
    return max(stiffness * (force / BASE - APART) / (1 + stiffness / BASE), 0.0)


def solved(data: dict[str, Any], order: int, method: str, surface: str) -> list[StepResult]:
    solver = {"method": method, "surface": surface, "tolerance": 1e-11}
    return list(prepare(from_dict(data | {"geometry": data["geometry"] | {"order": order}, "solver": solver})).steps())


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(("method", "surface"), SOLVERS)
def test_bumper_presses_once_it_is_touched_and_never_pulls(method: str, surface: str, order: int) -> None:
    steps = solved(BUMPER, order, method, surface)
    assert {step.time for step in steps} == set(PULSE)
    for step in steps:
        force = MOST * PULSE[step.time]
        exact = carried(force, 1 / (1 / K + 1 / EA))
        bumper = step.contacts["bumper"]
        assert_allclose(bumper.normal_force, exact, rtol=1e-9, atol=1e-9)
        assert_allclose(step.springs["base"].force, [0.0, exact - force], rtol=1e-9, atol=1e-8)
        assert_allclose(bumper.max_penetration, exact / K, rtol=1e-8, atol=1e-11)
        assert_allclose(step.energy.external, step.energy.stored + step.energy.contact, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(("method", "surface"), SOLVERS)
def test_cable_pulls_once_it_is_taut_and_never_pushes(method: str, surface: str, order: int) -> None:
    in_series = 1 / K + 1 / EA + 0.25 / (2.0 * CABLE["bodies"]["lower"]["E"])
    for step in solved(CABLE, order, method, surface):
        force = MOST * PULSE[step.time]
        exact = carried(force, 1 / in_series)
        assert_allclose(step.springs["cable"].force, [0.0, exact], rtol=1e-8, atol=1e-8)
        assert_allclose(step.springs["hanger"].force, [0.0, force - exact], rtol=1e-8, atol=1e-8)


def test_linear_spring_in_the_place_of_the_bumper_would_be_noticed() -> None:
    base = BUMPER["springs"]["base"]
    both = {k: v for k, v in BUMPER.items() if k not in ("obstacles", "contacts")}
    both["springs"] = {"base": base, "bumper": {"at": "block.top", "stiffness": [0.0, K]}}
    pulled = solved(both, 1, "auto", "auto")[-1]
    assert pulled.springs["bumper"].force[1] > 5.0  # pulls back where the bumper has let go
