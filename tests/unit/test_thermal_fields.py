"""Temperatures that change from place to place: bent bars without stress, held bars, a cylinder; hydrostatic loads."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import record_of, stored_by
from stickslip.geometry.errors import SceneError
from stickslip.solvers.results.audit import Auditor
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.scene_file.read import from_dict
from stickslip.workflows.verification.prepared import prepare

E, NU, ALPHA, SLOPE = 200.0, 0.3, 1e-3, 20.0
PINNED = {
    "plane stress": {"a": ([0.0, 0.0], "xy"), "b": ([0.0, 1.0], "x")},
    "3d": {"a": ([0.0, 0.0, 0.0], "xyz"), "b": ([0.0, 0.0, 1.0], "xy"), "c": ([0.0, 1.0, 0.0], "x")},
}


def scene(model: str, temperature: Any, order: int = 2, **tables: Any) -> Scene:
    """A bar 4 x 1 (x 1)."""
    shape = {"builder": "block", "length": 4.0, "height": 1.0, "mesh_size": 0.5, "order": order}
    heat = temperature if isinstance(temperature, dict) else {"temperature": temperature}
    data = {
        "model": model,
        "geometry": shape | ({"width": 1.0} if model == "3d" else {}),
        "bodies": {"block": {"E": E, "nu": NU}},
        "thermal": {"block": {"expansion": ALPHA} | heat},
    }
    return from_dict(data | tables)


def solved(scene: Scene) -> tuple[Simulation, list[StepResult]]:
    """Solved and audited, stress included."""
    simulation = prepare(scene)
    steps, auditor = [*simulation.steps()], Auditor(simulation.problem, simulation.mesh)
    for step in steps:
        record = record_of(step)
        found = vars(auditor(type(record)(**{**vars(record), "stored": stored_by(step)})))
        assert max(found.values()) < 1e-7
        assert step.energy.external == pytest.approx(step.energy.stored + step.energy.contact, rel=1e-8, abs=1e-14)
    return simulation, steps


@pytest.mark.parametrize("model", [*PINNED])
def test_a_free_bar_with_a_linear_temperature_bends_into_a_circle_without_stress(model: str) -> None:
    """Curvature alpha dT/dh: u_h = alpha g (h² - x² (- y²)) / 2, u_x = alpha g x h."""
    pins = {n: {"point": at, "displacement": dict.fromkeys(axes, 0.0)} for n, (at, axes) in PINNED[model].items()}
    up = "z" if model == "3d" else "y"
    simulation, (step,) = solved(scene(model, f"{SLOPE}*{up}", supports=pins))
    assert np.abs(step.stress).max() < 1e-9 * E * ALPHA * SLOPE
    x, h = simulation.data.points[:, 0], simulation.data.points[:, -1]
    across = simulation.data.points[:, 1] if model == "3d" else 0 * x
    assert_allclose(step.displacement[:, 0], ALPHA * SLOPE * x * h, atol=1e-10)
    assert_allclose(step.displacement[:, -1], ALPHA * SLOPE * (h**2 - x**2 - across**2) / 2, atol=1e-10)


@pytest.mark.parametrize("order", [1, 2])
def test_a_bar_between_walls_is_pressed_by_its_mean_temperature(order: int) -> None:
    """Nu = 0: the stress is uniform, -E alpha (mean of T), and follows the history of the field."""
    walls = {side: {"boundary": f"block.{side}", "displacement": {"x": 0.0}} for side in ("left", "right")}
    walls["foot"] = {"boundary": "block.bottom", "displacement": {"y": 0.0}}
    heat = {"temperature": f"{SLOPE}*x**2", "history": [[1.0, 1.0], [2.0, -0.5]]}
    tables = {"supports": walls, "bodies": {"block": {"E": E, "nu": 0.0}}, "steps": {"end": 2.0, "count": 2}}
    _, steps = solved(scene("plane strain", heat, order, **tables))
    mean = SLOPE * 16 / 3
    for step, factor in zip(steps, (1.0, -0.5), strict=True):
        assert_allclose(step.supports["right"].force[0], -E * ALPHA * mean * factor, rtol=1e-9)


def test_a_cylinder_warm_outside_is_pulled_inside() -> None:
    """Between plates, T = g r²: sigma_r = E alpha g (b² - r²) / (4 (1 - nu)), Timoshenko & Goodier, section 150."""
    plates = {side: {"boundary": f"block.{side}", "displacement": {"y": 0.0}} for side in ("top", "bottom")}
    shape = {"builder": "block", "length": 1.0, "height": 0.25, "mesh_size": 0.0625, "order": 2}
    simulation, (step,) = solved(scene("axisymmetric", f"{SLOPE}*x**2", supports=plates, geometry=shape))
    r = simulation.data.points[simulation.data.cells[:, :3], 0].mean(axis=1)
    exact = E * ALPHA * SLOPE * (1 - r**2) / (4 * (1 - NU))
    assert_allclose(step.stress[:, 0, 0], exact, atol=2e-3 * exact.max())


def test_bodies_with_fields_of_their_own_meet_in_contact() -> None:
    """A block grows by the integral of its temperature until it touches; nu = 0."""
    tables: dict[str, Any] = {
        "geometry": {"builder": "two_blocks", "length": 1.0, "height": 1.0, "mesh_size": 0.25},
        "bodies": {"upper": {"E": E, "nu": 0.0}, "lower": {"E": E, "nu": 0.0}},
        "supports": {
            "foot": {"boundary": "lower.bottom", "displacement": {"y": 0.0}},
            "head": {"boundary": "upper.top", "displacement": {"y": 0.0}},
            **{b: {"boundary": f"{b}.left", "displacement": {"x": 0.0}} for b in ("lower", "upper")},
        },
        "contacts": {"joint": {"surface": "upper.bottom", "against": "lower.top", "gap_offset": 2e-3}},
        "thermal": {
            "upper": {"expansion": ALPHA, "temperature": f"{SLOPE}*y"},
            "lower": {"expansion": ALPHA, "temperature": 2.0},
        },
    }
    _, (step,) = solved(scene("plane strain", 0.0, **tables))
    pressure = E / 2 * (ALPHA * SLOPE / 2 + ALPHA * 2.0 - 2e-3)
    assert_allclose(step.contacts["joint"].normal_force, pressure, rtol=5e-3)


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
        solved(scene("plane strain", "log(x-1)", supports=held))


@pytest.mark.parametrize("order", [1, 2])
def test_water_presses_on_a_wall_by_its_depth(order: int) -> None:
    """Hydrostatic: pressure = rho g depth up to the level of the water, H g² / 2 at a third of the height."""
    level, weight = 0.75, 9.81
    supports = {"foot": {"boundary": "block.bottom", "displacement": {"x": 0.0, "y": 0.0}}}
    water = {"water": {"boundary": "block.left", "pressure": f"{weight}*max({level}-y, 0)"}}
    data = {
        "model": "plane strain",
        "geometry": {"builder": "block", "length": 0.5, "height": 1.0, "mesh_size": 0.25, "order": order},
        "bodies": {"block": {"E": E, "nu": NU}},
        "supports": supports,
        "loads": water,
    }
    simulation = prepare(from_dict(data))
    (step,) = simulation.steps()
    thrust = weight * level**2 / 2
    assert_allclose(step.supports["foot"].force, [-thrust, 0.0], rtol=1e-10, atol=1e-10)
    assert_allclose(step.supports["foot"].moment, [thrust * level / 3], rtol=1e-10)
