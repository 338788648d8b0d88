"""Loads, body forces and supports that are expressions: resultants, fields, energy and audit against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import audit, solved
from stickslip.geometry.errors import SceneError
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.lab.verification.cases import by_place as case
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

E, NU = 200.0, 0.3
HELD = {"left": {"boundary": "block.left", "displacement": {"x": 0.0, "y": 0.0}}}


def scene(model: str = "plane strain", **tables: Any) -> Scene:
    """A block 2 x 1 (x 1), held at its left side."""
    geometry = {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.5}
    held = HELD
    if model == "3d":
        geometry["width"] = 1.0
        held = {"left": {"boundary": "block.left", "displacement": {"x": 0.0, "y": 0.0, "z": 0.0}}}
    if model == "axisymmetric":
        held = {"left": {"boundary": "block.bottom", "displacement": {"y": 0.0}}}
    data = {"model": model, "geometry": geometry, "bodies": {"block": {"E": E, "nu": NU}}, "supports": held}
    return from_dict(data | tables)


def test_loads_and_displacements_follow_expressions() -> None:
    for simulation, steps, checks in case.problems():
        assert not failures(checks)
        for step in steps:
            assert max(audit(simulation, step).values()) < 1e-10
            assert step.energy.external == pytest.approx(step.energy.stored, rel=1e-10)


def test_in_3d_and_around_an_axis() -> None:
    force = {"block": {"force": ["x*y*z", 0.0, "z"]}}
    _, (step,) = solved(scene("3d", body_force=force))
    assert_allclose(step.supports["left"][0], [-2 * 0.25, 0.0, -1.0], rtol=1e-10, atol=1e-12)
    _, (step,) = solved(scene("axisymmetric", body_force={"block": {"force": [0.0, "x*y"]}}))
    assert_allclose(step.supports["left"][0][1], -2 * np.pi * 8 / 3 / 2, rtol=1e-10)


def test_a_sine_that_ends_at_zero_contradicts_no_support() -> None:
    supports = HELD | {"top": {"boundary": "block.top", "displacement": {"x": "1e-3*sin(pi*x)", "y": "1e-3*sin(pi*x)"}}}
    supports |= {"right": {"boundary": "block.right", "displacement": {"x": 0.0}}}
    _, (step,) = solved(scene(supports=supports))
    assert np.abs(step.displacement).max() > 0.9e-3


def test_the_start_is_solved_if_an_expression_is_not_zero_there() -> None:
    cosine, sine = ({"block": {"force": [f"x*{name}(t)", 0.0]}} for name in ("cos", "sin"))
    assert scene(body_force=cosine).requested_times() == (0.0, 1.0)
    assert scene(body_force=sine).requested_times() == (1.0,)


def test_a_script_repeats_them() -> None:
    tables: dict[str, Any] = {"body_force": {"block": {"force": ["x", "0.1*t"]}}, "steps": {"end": 2.0}}
    right = {"right": {"boundary": "block.right", "displacement": {"y": 0.0}}}
    script = prepare(scene(supports=HELD | right, **tables)).script()
    script.step(to=0.5, supports={"right": {"y": 1e-3}})
    last = script.step(to=1.0, supports={"right": {"y": 0.0}})
    _, steps = solved(script.scene)
    assert_allclose(steps[-1].displacement, last.displacement, atol=1e-12)
    assert steps[-1].energy.stored == pytest.approx(last.energy.stored, rel=1e-10)
    script.step(to=3.0)
    assert script.scene.requested_times() == (0.5, 1.0, 2.0, 3.0)  # where the ramp ends is hit
    assert scene(**tables).timeline().turns == {0.0, 2.0}


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"body_force": {"blok": {"force": [0.0, 1.0]}}}, r"body_force\.blok: no such body.*did you mean block\?"),
        ({"body_force": {"block": {"force": [1.0]}}}, r"body_force\.block\.force = \[1\.0\]: expected 2 components"),
        ({"body_force": {"block": {"force": ["x+", 0.0]}}}, r'body_force\.block\.force = "x\+": column 3: invalid'),
        ({"body_force": {"block": {"force": [True, 0.0]}}}, r"force\.0 = true: expected a number in N/m³, .*in quotes"),
        ({"body_force": {"block": {"force": [0.0, "z"]}}}, r'body_force\.block\.force\.y = "z": z: a plane model has'),
        (
            {"loads": {"a": {"boundary": "block.top", "pressure": "x*(y"}}},
            r'loads\.a\.pressure = "x\*\(y": column 3: .* never closed',
        ),
        (
            {"loads": {"a": {"boundary": "block.top", "force": ["x", 0.0]}}},
            r"loads\.a\.force\.0 = \"x\": expected a nu",
        ),
        (
            {"supports": {"p": {"point": [0.0, 0.0], "displacement": {"x": "E"}}}},
            r'supports\.p\.displacement\.x = "E": E: no body has it here',
        ),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(tables: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene(**tables)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"body_force": {"block": {"force": ["log(-x)", 0.0]}}}, r"body_force\.block\.force\.x: .* no finite value"),
        ({"body_force": {"block": {"force": ["x/(t-1)", 0.0]}}}, r"force\.x: .* no finite value somewhere at t = 1"),
        (
            {"supports": {"left": {"boundary": "block.left", "displacement": {"x": "t/x", "y": 0.0}}}},
            r"supports\.left\.displacement\.x: .* no finite value at the point \(0, ",
        ),
    ],
)
def test_what_has_no_finite_value_is_refused_before_any_solve(tables: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        prepare(scene(**tables))
