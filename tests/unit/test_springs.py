"""Springs between places: in series with a column, alone under a body, between bodies; what they hold; refusals."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pytest

import stickslip
from shared.audited import audit
from shared.cases import every_nth
from stickslip.geometry.errors import SceneError
from stickslip.solvers.results.step_result import Quantity, values
from stickslip.solvers.simulation.plan import make_plan, planned
from stickslip.workflows.lab.verification.cases.springs import AREA, CORNERS, K, alone, between, floor, pressed, scene
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict


@pytest.mark.parametrize(("model", "order", "surface"), every_nth(2, AREA, [1, 2], ["condensed", "matrix-free"]))
def test_a_spring_presses_a_column_on_the_floor(model: str, order: Literal[1, 2], surface: str) -> None:
    simulation, step, checks = pressed(model, order, "surface-uzawa", surface)
    assert not failures(checks)
    assert max(audit(simulation, step).values()) < 1e-6
    along = "z" if model == "3d" else "y"
    assert values(step)[f"spring.s.force.{along}"] == step.springs["s"].force[-1]


def test_springs_hold_a_body_and_pull_on_two() -> None:
    assert planned(scene(CORNERS)).rigid_modes.shape == (3, 0)
    for simulation, step, checks in (alone(1), alone(2), between()):
        assert not failures(checks)
        assert max(audit(simulation, step).values()) < 1e-9


def test_a_mean_resists_no_rotation_about_its_centre() -> None:
    """One spring under the whole base holds it up, not upright."""
    with pytest.raises(SceneError, match=r"supports: nothing resists the rotation"):
        make_plan(scene({"s": {"at": "block.bottom", "stiffness": [K, K]}}))


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
        ({"acts": "compression"}, r"springs\.s\.direction: missing, a spring that acts in one way needs it"),
        ({"gap": 0.1}, r"springs\.s\.gap = 0\.1: belongs to acts"),
        (
            {"stiffness": K, "direction": [0.0, 1.0], "acts": "tension", "gap": -0.1},
            r"springs\.s\.gap = -0\.1: must not be negative",
        ),
        ({"acts": "pull"}, r"springs\.s\.acts = .*pull"),
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


def test_a_point_belongs_to_the_body_with_the_nearest_of_all_sides() -> None:
    """The lower block's left side is farther from its own right corner than the upper block's left side is."""
    wide = {"builder": "two_blocks", "length": 1.0, "height": 0.5, "lower_length": 3.0, "mesh_size": 0.25}
    tables = {
        "model": "plane strain",
        "geometry": wide,
        "bodies": {name: {"E": 1.0, "nu": 0.3} for name in ("lower", "upper")},
        "contacts": {"joint": {"surface": "upper.bottom", "against": "lower.top"}},
        "supports": {
            "base": {"boundary": "lower.bottom", "displacement": {"y": 0.0}},
            "corner": {"point": [2.0, 0.0], "displacement": {"x": 0.0}},
            "top": {"boundary": "upper.top", "displacement": {"x": 0.0, "y": -0.01}},
        },
    }
    assert planned(from_dict(tables)).rigid_modes.shape == (6, 0)
