"""Centrifugal loads: resultants about any axis, the square of the speed in time, and refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import audit
from stickslip.geometry.errors import SceneError
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

RHO = 3.0


def scene(model: str, density: float = RHO, **centrifugal: Any) -> Scene:
    """A block 2 x 1 (x 1), held at its bottom."""
    geometry = {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.5}
    if model == "3d":
        geometry["width"] = 1.0
    held = {axis: 0.0 for axis in ("y" if model == "axisymmetric" else "xyz"[: 3 if model == "3d" else 2])}
    return from_dict(
        {
            "model": model,
            "geometry": geometry,
            "bodies": {"block": {"E": 1e3, "nu": 0.3, "density": density}},
            "supports": {"base": {"boundary": "block.bottom", "displacement": held}},
            "centrifugal": centrifugal,
            "steps": {"count": 2},
        }
    )


def test_the_load_is_density_times_speed_squared_times_distance() -> None:
    axis = np.array([1.0, 2.0, 2.0]) / 3
    point = np.array([0.5, -1.0, 0.2])
    arm = np.array([1.0, 0.5, 0.5]) - point
    for model, centrifugal, expected in (
        ("plane strain", {"speed": 2.0, "point": [3.0, 0.0]}, np.array([-2.0, 0.5]) * 2),
        ("plane stress", {"speed": -2.0}, np.array([1.0, 0.5]) * 2),
        ("3d", {"speed": 2.0, "axis": [1.0, 2.0, 2.0], "point": point.tolist()}, 2 * (arm - arm @ axis * axis)),
    ):
        simulation = prepare(scene(model, **centrifugal))
        for step in simulation.steps():
            pull = RHO * (2.0 * step.time) ** 2 * expected
            assert_allclose(step.supports["base"].force, -pull, rtol=1e-10, atol=1e-12, err_msg=model)
            assert max(audit(simulation, step).values()) < 1e-10
            assert step.energy.external == pytest.approx(step.energy.stored, rel=1e-10)


def test_turns_of_the_speed_are_steps() -> None:
    found = scene("plane strain", speed=[[0.0, 0.0], [0.3, 2.0], [1.0, 1.0]])
    forces = {step.time: step.supports["base"].force[0] for step in prepare(found).steps()}
    assert sorted(forces) == [0.3, 0.5, 1.0]
    assert_allclose(forces[0.3], 4 * forces[1.0], rtol=1e-10)


@pytest.mark.parametrize(
    ("model", "centrifugal", "message"),
    [
        ("3d", {"speed": 1.0}, r"centrifugal\.axis: missing, a 3D model needs it"),
        ("3d", {"speed": 1.0, "axis": [0.0, 0.0, 0.0]}, r"centrifugal\.axis = .*must not be zero"),
        ("3d", {"speed": 1.0, "axis": [0.0, 1.0]}, r"centrifugal\.axis = \[0\.0, 1\.0\]: expected 3 components"),
        ("plane strain", {"speed": 1.0, "axis": [0.0, 1.0]}, r"centrifugal\.axis = .*only a 3D model"),
        ("plane strain", {"speed": 1.0, "point": [0.0]}, r"centrifugal\.point = \[0\.0\]: expected 2 components"),
        ("axisymmetric", {"speed": 1.0, "point": [0.0, 0.0]}, r"centrifugal\.point = .*spins about its axis"),
        ("plane strain", {"speed": 1.0, "density": 0.0}, r"centrifugal: no body has a density"),
        ("plane strain", {"speed": "t"}, r'centrifugal\.speed = "t": expected a number'),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(model: str, centrifugal: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene(model, **centrifugal)
