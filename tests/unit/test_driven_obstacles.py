"""Obstacles that a force drives or that turn: their motion is an unknown, their balance holds."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import every_nth
from stickslip.geometry.errors import SceneError
from stickslip.solvers.results.step_result import SLIP
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.scene_file.read import from_dict

SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]
FRICTION = {"friction": {"law": "coulomb", "mu": 0.3}}
CONTACT = {"base": {"surface": "block.bottom", "against": "foundation"}}
LAWS: dict[str, dict[str, Any]] = {
    "unilateral": {"law": "unilateral"},
    "compliance": {"law": "compliance", "c_n": 30.0},
}


def driven(dim: int, **motion: Any) -> dict[str, Any]:
    """The foundation, moved."""
    plane = {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}
    return {"foundation": plane | motion}


def clamped(dim: int) -> dict[str, Any]:
    return {"top": {"boundary": "block.top", "displacement": dict.fromkeys("xyz"[:dim], 0.0)}}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("dim", "order"), [(2, 1), (2, 2), (3, 1)])
def test_a_force_moves_the_foundation_as_far_as_the_same_displacement_makes_that_force(
    dim: int, order: int, law: str, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    up, slide = "xyz"[dim - 1], {"x": 0.03}
    tables = {"contacts": {"base": CONTACT["base"] | FRICTION | {"normal": LAWS[law]}}, "supports": clamped(dim)}
    tables |= {"solver": {"tolerance": 1e-12}}
    pushed = scene_of(dim, {"order": order}, obstacles=driven(dim, force={up: 0.2}, displacement=slide), **tables)
    (by_force,) = simulation_of(pushed).steps()
    moved, force, _ = by_force.obstacles["foundation"]
    assert_allclose(force[-1], 0.2, rtol=1e-12)
    assert moved[-1] > 0.01
    shifted = scene_of(dim, {"order": order}, obstacles=driven(dim, displacement=slide | {up: moved[-1]}), **tables)
    (by_shift,) = simulation_of(shifted).steps()
    assert_allclose(by_shift.contacts["base"].normal_force, 0.2, rtol=1e-9)
    assert_allclose(by_shift.displacement, by_force.displacement, atol=1e-9 * abs(by_force.displacement).max())
    energy = by_force.energy
    assert_allclose(energy.external, energy.stored + energy.contact, rtol=1e-10)


def test_a_sideways_force_beyond_friction_has_no_answer_and_one_below_it_has(
    scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    tables = {"contacts": {"base": CONTACT["base"] | FRICTION}, "supports": clamped(2), "solver": {"tolerance": 1e-11}}
    held = scene_of(obstacles=driven(2, force={"y": 0.2, "x": 0.05}), **tables)
    (step,) = simulation_of(held).steps()
    assert_allclose(step.obstacles["foundation"][1], [0.05, 0.2], rtol=1e-10)
    assert step.obstacles["foundation"][0][0] > 0  # the way the force pushes
    from stickslip.solvers.stepping.stepper import StepError

    slips = scene_of(obstacles=driven(2, force={"y": 0.2, "x": 0.07}), **tables)  # 0.07 > 0.3 * 0.2
    with pytest.raises(StepError):
        list(simulation_of(slips).steps())


def test_a_turning_roller_drags_the_block(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    roller = {
        "foundation": {
            "shape": "cylinder",
            "point": [1.0, -5.0],
            "radius": 5.0,
            "displacement": {"y": [[0, 0], [1, 0.02]]},
            "rotation": {"point": [1.0, -5.0], "angle": [[0, 0], [1, 0], [2, 0.01]]},
        }
    }
    scene = scene_of(
        geometry={"mesh_size": 0.1},
        obstacles=roller,
        contacts={"base": CONTACT["base"] | FRICTION},
        supports=clamped(2),
        steps={"end": 2.0},
    )
    pressed, turned = simulation_of(scene).steps()
    pressing = pressed.contacts["base"]
    assert abs(pressing.force[0]) < 0.01 * pressing.normal_force  # symmetric but for the mesh's diagonals
    base = turned.contacts["base"]
    assert np.all(base.status[base.status != 0] == SLIP)  # 5 m * 0.01 is far beyond what sticks
    assert_allclose(base.tangential_force, 0.3 * base.normal_force, rtol=1e-3)  # the arc's slope: 0.2 at most, squared
    # friction acts 5 m from the roller's axis; the base of the block reaches (1 m / 5 m)^2 / 2 farther at most
    assert_allclose(turned.obstacles["foundation"][2], 5.0 * 0.3 * base.normal_force, rtol=0.02)
    assert base.force[0] < 0  # anticlockwise: the top of the roller moves to the left


@pytest.mark.parametrize("method", ["condensed-newton", "regularised"])
def test_an_obstacle_that_jumps_at_the_start_does_its_work_and_slips_then(
    method: str, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    contacts = {"base": CONTACT["base"] | {"friction": {"law": "coulomb", "mu": 0.1}}}
    jump = {"x": [[0, 0.1], [1, 0.1]], "y": [[0, 0.01], [1, 0.02]]}
    tables = {"contacts": contacts, "supports": clamped(2), "solver": {"method": method, "tolerance": 1e-10}}
    scene = scene_of(obstacles=driven(2, displacement=jump), **tables)
    for step in simulation_of(scene).steps():
        assert_allclose(step.energy.external, step.energy.stored + step.energy.contact, rtol=1e-10)
        base = step.contacts["base"]
        if step.time == 0:
            assert_allclose(base.slip_increment, base.slip, rtol=1e-12)
            assert np.all(base.status == SLIP)  # 0.1 m is far beyond what sticks


@pytest.mark.parametrize(
    ("load", "unit"), every_nth(2, [(1e-3, 0.0), (1e-3, 0.3), (1e-6, 0.3), (0.1, 0.3)], [1.0, 1e3])
)
def test_a_force_finds_where_a_pin_touches_its_wider_bore(
    load: tuple[float, float], unit: float, simulation_of: SimulationOf
) -> None:
    force, mu = load

    def scene(**motion: Any) -> Scene:
        pin = {"shape": "cylinder", "point": [0.0, 0.0], "radius": 0.59 * unit}
        ring = {"inner_radius": 0.6 * unit, "outer_radius": unit, "mesh_size": 0.1 * unit}
        table = {
            "model": "plane strain",
            "geometry": {"builder": "ring", "cells": "tensor"} | ring,
            "bodies": {"ring": {"E": 1.0, "nu": 0.3}},
            "obstacles": {"pin": pin | motion},
            "contacts": {"bore": {"surface": "ring.inner", "against": "pin", "friction": {"law": "coulomb", "mu": mu}}},
            "supports": {"outer": {"boundary": "ring.outer", "displacement": {"x": 0.0, "y": 0.0}}},
            "solver": {"tolerance": 1e-11},
        }
        return from_dict(table)

    (pushed,) = simulation_of(scene(force={"y": -force * unit})).steps()
    moved = pushed.obstacles["pin"][0]
    assert moved[1] < -0.01 * unit  # through the clearance, and on into the ring
    assert_allclose(pushed.contacts["bore"].force[1], -force * unit, rtol=1e-9)
    (shifted,) = simulation_of(scene(displacement={"y": moved[1]})).steps()
    assert_allclose(shifted.contacts["bore"].force[1], -force * unit, rtol=1e-6)
    assert_allclose(shifted.displacement, pushed.displacement, atol=1e-7 * abs(pushed.displacement).max())


@pytest.mark.parametrize(
    ("motion", "tables", "sentence"),
    [
        ({"force": {"x": 1.0}}, {}, "nothing resists the motion of obstacles.foundation along x"),
        ({"force": {"y": 1.0}}, {"solver": {"method": "uzawa"}}, "cannot move obstacles.foundation by a force"),
    ],
)
def test_what_cannot_be_driven_is_refused(
    motion: dict[str, Any], tables: dict[str, Any], sentence: str, scene_of: SceneOf
) -> None:
    scene = scene_of(obstacles=driven(2, **motion), contacts=CONTACT, supports=clamped(2), **tables)
    with pytest.raises(SceneError, match=sentence):
        make_plan(scene)
