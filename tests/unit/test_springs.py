"""Springs between places: in series with a column, alone under a body, between bodies; what they hold; refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import stickslip
from shared.audited import audit
from stickslip.geometry.errors import SceneError
from stickslip.solvers.results.error_parts import Quantity
from stickslip.solvers.results.quantities import values
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan, planned
from stickslip.workflows.scene_file.read import from_dict
from stickslip.workflows.verification.prepared import prepare

E, K, MOVED = 1000.0, 300.0, -0.02


def scene(springs: dict[str, Any], model: str = "plane strain", order: int = 1, **tables: Any) -> Scene:
    """A block 2 x 1 (x 0.5), nu = 0."""
    shape = {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.5, "order": order}
    data = {
        "model": model,
        "geometry": shape | ({"width": 0.5} if model == "3d" else {}),
        "bodies": {"block": {"E": E, "nu": 0.0, "density": 1.0}},
        "springs": springs,
    }
    return from_dict(data | tables)


AREA = {"plane strain": 2.0, "3d": 1.0, "axisymmetric": np.pi * 4.0}


def floor(model: str) -> dict[str, Any]:
    """A floor under the block, and supports that keep it from sliding."""
    up = [0.0, 0.0, 1.0] if model == "3d" else [0.0, 1.0]
    sides = {"left": "x", "front": "y"} if model == "3d" else {"left": "x"} if model == "plane strain" else {}
    return {
        "obstacles": {"floor": {"shape": "plane", "point": [0.0] * len(up), "normal": up}},
        "contacts": {"base": {"surface": "block.bottom", "against": "floor"}},
        "supports": {side: {"boundary": f"block.{side}", "displacement": {axis: 0.0}} for side, axis in sides.items()},
    }


@pytest.mark.parametrize("surface", ["condensed", "matrix-free"])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("model", [*AREA])
def test_a_spring_presses_a_column_on_the_floor(model: str, order: int, surface: str) -> None:
    """In series: k E A/h / (k + E A/h) times the motion of the ground."""
    down, moved = ([0.0] * (model == "3d") + [0.0, value] for value in (-2.0, MOVED))
    springs = {"s": {"at": "block.top", "stiffness": K, "direction": down, "displacement": moved}}
    solver = {"method": "surface-uzawa", "surface": surface}
    simulation = prepare(scene(springs, model, order, **floor(model), solver=solver))
    (step,) = simulation.steps()
    column = E * AREA[model]
    force = -MOVED * K * column / (K + column)
    assert_allclose(values(step)[f"spring.s.force.{'z' if model == '3d' else 'y'}"], -force, rtol=1e-6)
    assert_allclose(step.contacts["base"].normal_force, force, rtol=1e-6)
    assert step.energy.stored == pytest.approx(-force * MOVED / 2, rel=1e-6)
    assert step.energy.external == pytest.approx(step.energy.stored, rel=1e-6)
    assert max(audit(simulation, step).values()) < 1e-6


def test_springs_alone_hold_a_body() -> None:
    """Statics: three springs at two corners carry the weight, whose line is 1.0 m from either."""
    corners: dict[str, Any] = {
        "a": {"at": [0.0, 0.0], "stiffness": [K, K]},
        "b": {"at": [2.0, 0.0], "stiffness": 2 * K, "direction": [0.0, 1.0]},
    }
    assert planned(scene(corners)).rigid_modes.shape == (3, 0)
    for order in (1, 2):
        simulation = prepare(scene(corners, order=order, gravity={"acceleration": [3.0, -2.0]}))
        (step,) = simulation.steps()
        # moments about the first corner: 2 b = 4 * 1.0 + 6 * 0.5
        assert_allclose(step.springs["b"].force, [0.0, 3.5], atol=1e-9)
        assert_allclose(step.springs["a"].force, [-6.0, 0.5], atol=1e-9)
        assert step.energy.external == pytest.approx(step.energy.stored, rel=1e-10)
        assert max(audit(simulation, step).values()) < 1e-10


def test_a_mean_resists_no_rotation_about_its_centre() -> None:
    """One spring under the whole base holds it up, not upright."""
    with pytest.raises(SceneError, match=r"supports: nothing resists the rotation"):
        make_plan(scene({"s": {"at": "block.bottom", "stiffness": [K, K]}}))


def test_a_spring_between_two_bodies_pulls_on_both() -> None:
    """Columns of heights .5 and 1 and a spring between them, apart by MOVED: all in series."""
    tables: dict[str, Any] = {
        "model": "plane strain",
        "geometry": {"builder": "two_blocks", "mesh_size": 0.25, "length": 1.0, "height": 1.0, "lower_height": 0.5},
        "bodies": {"lower": {"E": E, "nu": 0.0}, "upper": {"E": 2 * E, "nu": 0.0}},
        "supports": {
            "foot": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0}},
            "head": {"boundary": "upper.top", "displacement": {"x": 0.0, "y": -MOVED}},
        },
        "springs": {"s": {"at": "upper.bottom", "to": "lower.top", "stiffness": [0.0, K]}},
        "contacts": {"pair": {"surface": "upper.bottom", "against": "lower.top"}},
    }
    simulation = prepare(from_dict(tables))
    (step,) = simulation.steps()
    force = -MOVED / (1 / K + 0.5 / E + 1 / (2 * E))
    assert_allclose(step.springs["s"].force, [0.0, -force], rtol=1e-9, atol=1e-9)
    assert_allclose(step.supports["head"].force[1], force, rtol=1e-9)
    assert step.contacts["pair"].normal_force == 0.0
    assert max(audit(simulation, step).values()) < 1e-9


def test_stated_errors_of_spring_forces_hold_and_points_have_none() -> None:
    """A block that a spring presses and another one drags over the floor, against a mesh four times as fine."""
    springs: dict[str, Any] = {
        "down": {"at": "block.top", "stiffness": [0.0, 800.0], "displacement": [0.0, -0.01]},
        "side": {"at": "block.left", "stiffness": 500.0, "direction": [1.0, 0.5], "displacement": [0.004, 0.0]},
        "tip": {"at": [2.0, 1.0], "stiffness": [50.0, 0.0]},
    }
    tables = floor("plane strain") | {"supports": {}}
    tables["contacts"]["base"]["friction"] = {"law": "coulomb", "mu": 0.4}
    answers = []
    for size in (0.25, 0.0625):
        shape = {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": size}
        simulation = stickslip.prepare(scene(springs, **tables, geometry=shape))
        steps = [*simulation.steps()]
        answers.append((steps[-1], simulation.errors(steps)[-1]))
    (coarse, errors), (fine, _) = answers
    for name in ("down", "side"):
        parts = errors[Quantity("springs", name, "force")]
        assert parts.mesh is not None
        off = np.abs(coarse.springs[name].force - fine.springs[name].force)
        assert np.all(off <= parts.mesh + 1e-12)
        assert np.all(parts.mesh < 4 * off + 1e-12)
    assert errors[Quantity("springs", "tip", "force")].mesh is None


@pytest.mark.parametrize(
    ("spring", "message"),
    [
        ({"at": "block.botom"}, r"springs\.s\.at = block\.botom: no such side; did you mean"),
        ({"to": "block.tp"}, r"springs\.s\.to = block\.tp: no such side; did you mean"),
        ({"to": "block.bottom"}, r"springs\.s\.to = block\.bottom: a spring has two different ends"),
        ({"at": [0.0]}, r"springs\.s\.at = \[0\.0\]: expected 2 components"),
        ({"stiffness": 5.0}, r"springs\.s\.direction: missing, a single stiffness needs it"),
        ({"direction": [1.0, 0.0]}, r"springs\.s\.direction = \[1\.0, 0\.0\]: a stiffness by component has none"),
        ({"stiffness": 5.0, "direction": [0.0, 0.0]}, r"springs\.s\.direction = .*must not be zero"),
        ({"stiffness": [0.0, 0.0]}, r"springs\.s\.stiffness = .*must not be negative, and one be positive"),
        ({"stiffness": [K, -1.0]}, r"springs\.s\.stiffness = .*must not be negative"),
        ({"stiffness": [K]}, r"springs\.s\.stiffness = \[300\.0\]: expected 2 components"),
        ({"stiffness": [1e-9, 0.0]}, r"springs\.s\.stiffness = 1e-09: too soft beside the bodies"),
        ({"stiffness": [1e12, 0.0]}, r"springs\.s\.stiffness = 1000000000000\.0: too stiff beside the bodies"),
        (
            {"acts": "compression"},
            r"springs\.s\.acts = compression: springs are linear; what only presses is a contact",
        ),
        ({"to": "block.top", "displacement": [0.0, 1.0]}, r"springs\.s\.displacement = given: moves the ground"),
        ({"displacement": [0.0]}, r"springs\.s\.displacement = \[0\.0\]: expected 2 components"),
        ({"force": 1.0}, r"springs\.s\.force: unknown key"),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(spring: dict[str, Any], message: str) -> None:
    supports = {"foot": {"boundary": "block.bottom", "displacement": {"x": 0.0, "y": 0.0}}}
    with pytest.raises(SceneError, match=message):
        make_plan(scene({"s": {"at": "block.bottom", "stiffness": [K, K], **spring}}, supports=supports))


def test_what_only_the_mesh_shows_is_refused() -> None:
    foot = {"foot": {"boundary": "block.bottom", "displacement": {"x": 0.0, "y": 0.0}}}
    with pytest.raises(SceneError, match=r"springs\.s\.at = \[0\.3, 0\.0\]: no mesh vertex there; the nearest is"):
        prepare(scene({"s": {"at": [0.3, 0.0], "stiffness": [K, K]}}, supports=foot))


def test_an_axisymmetric_model_has_springs_along_its_axis() -> None:
    for spring, message in (
        ({"at": [1.0, 0.0], "stiffness": [0.0, K]}, r"springs\.s\.at = .*an axisymmetric model has rings; use a side"),
        ({"at": "block.top", "stiffness": [K, K]}, r"springs\.s = radial: .*act along the axis y"),
    ):
        with pytest.raises(SceneError, match=message):
            scene({"s": spring}, "axisymmetric")
