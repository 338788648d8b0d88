"""What small strain leaves out of a number is estimated: judged by a total Lagrangian computation on the same mesh."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip import prepare
from stickslip.solvers.simulation.plan import warnings
from stickslip.workflows.lab.verification.cases.neglect import GLUED, total_lagrangian
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import from_dict

E, NU = 6.0, 0.3


def scene(size: tuple[float, float], top: dict[str, float], **tables: Any) -> dict[str, Any]:
    """A block on a floor."""
    return {
        "model": "plane strain",
        "geometry": {"builder": "block", "length": size[0], "height": size[1], "mesh_size": 0.25},
        "bodies": {"block": {"E": E, "nu": NU}},
        "obstacles": {"floor": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
        "contacts": {"base": {"surface": "block.bottom", "against": "floor"}},
        "supports": {"top": {"boundary": "block.top", "displacement": top}} | tables.pop("supports", {}),
        "output": {"pictures": False},
    } | tables


def gasket(pressed: float) -> dict[str, Any]:
    """Its flanks are held: it is strained alike everywhere."""
    flanks = {side: {"boundary": f"block.{side}", "displacement": {"x": 0.0}} for side in ("left", "right")}
    return scene((20.0, 1.0), {"x": 0.0, "y": -pressed}, supports=flanks)


@pytest.mark.parametrize("pressed", [0.02, 0.1, 0.4])
def test_of_a_confined_gasket_it_is_that_of_the_closed_form(pressed: float) -> None:
    """F S of St. Venant and Kirchhoff: (1 - e) (e - e²/2) in place of e."""
    (step,) = prepare(from_dict(gasket(pressed))).steps()
    force = step.contacts["base"].normal_force
    exact = force / pressed * (1 - pressed) * (pressed - pressed**2 / 2)
    error = step.errors["contacts.base.normal_force"]
    assert_allclose(error.model, force - exact, rtol=1e-8)
    assert error.total is None or error.total < 1e-6 * force  # it is not in the total


@pytest.mark.parametrize("pressed", [0.4, 1.2])
def test_squeezed_gaskets_are_doubtful(pressed: float, tmp_path: Path) -> None:
    """Of one, half of the force is wrong; the other is pressed through itself."""
    outcome, content = run(from_dict(gasket(pressed)), tmp_path / "out")
    assert (outcome.status, outcome.exit_code, content["status"]) == ("doubtful", 1, "doubtful")
    assert ("inside out" if pressed > 1 else "by about 52%") in outcome.sentence


def test_a_gasket_that_is_squeezed_a_little_is_not(tmp_path: Path) -> None:
    assert run(from_dict(gasket(0.02)), tmp_path / "out")[0].status == "converged"


def test_a_modulus_in_pascals_under_megapascals_draws_a_line() -> None:
    steel = {"bodies": {"block": {"E": 210e9, "nu": NU}}}
    assert any("is it in Pa?" in line for line in warnings(from_dict(gasket(0.02) | steel | {"units": "mm-N-MPa"})))
    steel["bodies"]["block"]["E"] = 210e3
    assert not warnings(from_dict(gasket(0.02) | steel | {"units": "mm-N-MPa"}))


@pytest.mark.parametrize(
    ("size", "top"),
    [((2.0, 1.0), {"x": 0.05, "y": -0.05}),  # pressed and sheared: shear is softer under pressure
     ((0.5, 3.0), {"x": 0.2, "y": 0.0})],  # a slender one, clamped at both ends: strained little, turned much
)  # fmt: skip
def test_of_a_glued_block_it_is_that_of_a_total_lagrangian_computation(
    size: tuple[float, float], top: dict[str, float]
) -> None:
    simulation = prepare(from_dict(scene(size, top, contacts=GLUED["contacts"])))
    (step,) = simulation.steps()
    assert step.displacement.shape == simulation.data.points.shape
    exact = total_lagrangian(simulation.data, step.displacement)
    found, error = step.supports["top"].force, step.errors["supports.top.force"].model
    assert_allclose(total_lagrangian(simulation.data, 1e-6 * step.displacement), 1e-6 * found, rtol=1e-4)
    assert_allclose(error, np.abs(exact - found), atol=0.3 * np.linalg.norm(exact - found))
    assert np.linalg.norm(exact - found) > 0.02 * np.linalg.norm(found)
