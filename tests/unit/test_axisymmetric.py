"""Axisymmetric models: a full circle of material, one rigid motion, no radial motion on the axis."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.drawn import draw, scene_data
from shared.problems import SceneOf, SimulationOf, SystemOf
from stickslip.geometry.errors import SceneError
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan
from stickslip.workflows.scene_file.read import from_dict

E, NU = 1.0, 0.3
GEOMETRIES: list[dict[str, Any]] = [{"order": 1}, {"order": 2}, {"order": 2, "cells": "tensor"}]
BASE = {"base": {"surface": "block.bottom", "against": "foundation"}}


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_a_pressed_cylinder_is_in_uniaxial_stress(
    geometry: dict[str, Any], scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    # radius 2, height 1, free to widen: sigma_yy = -E/10, u_r = nu r/10: linear, so both orders are exact
    support = {"top": {"boundary": "block.top", "displacement": {"y": -0.1}}}
    tables = {"contacts": BASE, "supports": support, "probes": {"rim": {"point": [2.0, 0.0]}}}
    scene = scene_of(geometry=geometry, model="axisymmetric", solver={"tolerance": 1e-12}, **tables)
    (step,) = simulation_of(scene).steps()
    force = 0.1 * E * np.pi * 4.0
    base = step.contacts["base"]
    assert_allclose(base.normal_force, force, rtol=1e-10)
    assert_allclose(base.force, [0.0, force], rtol=1e-10, atol=1e-12)
    assert_allclose(base.pressure, 0.1 * E, rtol=1e-9)  # the node on the axis included
    assert_allclose(base.contact_area, 4 * np.pi, rtol=1e-12)
    assert_allclose(step.supports["top"][0], [0.0, -force], rtol=1e-10, atol=1e-12)
    assert_allclose(step.probes["rim"][0], [NU * 0.1 * 2.0, 0.0], atol=1e-11)
    assert_allclose(step.stress, np.tile(np.diag([0.0, -0.1 * E, 0.0]), (len(step.stress), 1, 1)), atol=1e-10)
    assert_allclose(step.energy.external, step.energy.stored, rtol=1e-10)
    assert_allclose(step.energy.stored, 0.1 * force / 2, rtol=1e-10)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_pressure_around_a_cylinder_makes_hoop_stress(
    geometry: dict[str, Any], scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    # sigma_rr = sigma_hoop = -p in a solid cylinder between smooth plates: u_r = -(1 + nu)(1 - 2 nu) p r / E
    hold = {side: {"boundary": f"block.{side}", "displacement": {"y": 0.0}} for side in ("top", "bottom")}
    load = {"around": {"boundary": "block.right", "pressure": 0.1}}
    scene = scene_of(geometry=geometry, model="axisymmetric", supports=hold, loads=load)
    (step,) = simulation_of(scene).steps()
    expected = np.diag([-0.1, -2 * NU * 0.1, -0.1])
    assert_allclose(step.stress, np.tile(expected, (len(step.stress), 1, 1)), atol=1e-10)
    assert_allclose(step.displacement[:, 0].min(), -(1 + NU) * (1 - 2 * NU) * 0.1 * 2.0 / E, rtol=1e-10)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_weights_are_positive_and_make_the_disc(
    geometry: dict[str, Any], scene_of: SceneOf, system_of: SystemOf
) -> None:
    friction = {"base": BASE["base"] | {"friction": {"law": "coulomb", "mu": 0.3}}}
    (rows,) = system_of(scene_of(geometry=geometry, model="axisymmetric", contacts=friction)).contacts
    assert rows.node_weights.min() > 0
    for weights in (rows.node_weights, rows.W_n, rows.W_t):
        assert_allclose(weights.sum(), 4 * np.pi, rtol=1e-12)
    on_axis = rows.surface.points[:, 0] == 0.0
    assert on_axis.sum() == 1
    assert len(rows.W_n) == len(on_axis)  # the axis node is pressed like any other
    assert len(rows.W_t) == len(on_axis) - 1  # but does not slip: u_r = 0 there


def test_only_the_shift_along_the_axis_is_rigid(scene_of: SceneOf, system_of: SystemOf) -> None:
    system = system_of(scene_of(model="axisymmetric", contacts=BASE))
    assert system.interface.rigid_modes.shape[1] == 1
    free = scene_of(model="axisymmetric", geometry={"mesh_size": 0.5})
    with pytest.raises(SceneError, match="nothing resists the translation along y of the body"):
        make_plan(free)


def test_a_contact_side_of_which_a_part_lies_on_the_axis_is_refused(tmp_path: Path) -> None:
    def scene(*edges: str) -> Scene:
        data = scene_data(draw(tmp_path / "b.brep", 2), 2, "part", names={"part.bottom": edges, "part.top": ["edge 3"]})
        return from_dict(data | {"model": "axisymmetric"})

    make_plan(scene("edge 1"))
    make_plan(scene("edge 1", "edge 2"))  # bottom and outer rim
    with pytest.raises(SceneError, match=r"part\.bottom: a part lies on the axis of symmetry and has no area"):
        make_plan(scene("edge 1", "edge 4"))
