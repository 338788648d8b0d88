"""Tied surfaces and given gaps are met without a search for pressure."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from shared.audited import record_of
from shared.cases import every_nth
from shared.problems import SceneOf, SimulationOf
from stickslip import STICK, Scene, SceneError, Simulation, StepResult
from stickslip.solvers.results.audit import Auditor
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.simulation.resolve import resolve
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

METHODS = ("condensed-newton", "uzawa")
M = 0.7 / (1.3 * 0.4)  # constrained modulus of E = 1 Pa, nu = 0.3 [Pa]


def dragged(scene_of: SceneOf, dim: int, depth: float = 0.0, method: str = "auto", **contact: Any) -> Scene:
    """The top held, the foundation, `depth` below the block, moved sideways and down."""
    up = "xyz"[dim - 1]
    move = {"x": 0.02, up: -0.01} | ({"y": 0.01} if dim == 3 else {})
    place = {"point": [0.0] * (dim - 1) + [-depth], "normal": [0.0] * (dim - 1) + [1.0]}
    return scene_of(
        dim,
        obstacles={"foundation": {"shape": "plane", "displacement": move} | place},
        base=contact,
        top=dict.fromkeys("xyz"[:dim], 0.0),
        solver={"method": method, "tolerance": 1e-13},
    )


def pulled(scene_of: SceneOf, method: str, top: float, **contact: Any) -> Scene:
    """A column between rollers over a gap of 0.3 m, its top moved up."""
    return scene_of(
        obstacles={"foundation": {"shape": "plane", "point": [0.0, -0.3], "normal": [0.0, 1.0]}},
        base={"normal": {"law": "tied"}} | contact,
        supports={
            "top": {"boundary": "block.top", "displacement": {"y": top}},
            "left": {"boundary": "block.left", "displacement": {"x": 0.0}},
            "right": {"boundary": "block.right", "displacement": {"x": 0.0}},
        },
        solver={"method": method, "tolerance": 1e-13},
    )


def only_step(simulation: Simulation) -> StepResult:
    (step,) = simulation.steps()
    return step


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("method", METHODS)
def test_tied_is_bilateral_and_stuck(dim: int, method: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    laws: list[dict[str, Any]] = [
        {"normal": {"law": "tied"}},
        {"normal": {"law": "bilateral"}, "friction": {"law": "stick"}},
    ]
    tied, both = (only_step(simulation_of(dragged(scene_of, dim, method=method, **law))) for law in laws)
    assert_array_equal(tied.p, both.p)  # the same numbers on the same way
    assert_array_equal(tied.displacement, both.displacement)
    assert np.all(tied.contacts["base"].status == STICK)
    assert tied.contacts["base"].stick_area == tied.contacts["base"].contact_area > 0


@pytest.mark.parametrize("dim", [2, 3])
def test_tied_surface_moves_as_a_support_moves_it(dim: int, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    scene = dragged(scene_of, dim, depth=0.5, normal={"law": "tied"})
    tied = simulation_of(scene)
    step = only_step(tied)
    move = scene.obstacles["foundation"].displacement
    supports = {"base": {"boundary": "block.bottom", "displacement": dict(move)}}
    supports["top"] = {"boundary": "block.top", "displacement": dict.fromkeys("xyz"[:dim], 0.0)}
    held = only_step(simulation_of(scene_of(dim, obstacles={}, supports=supports)))
    # both are one linear solve: rounding times the condition of K, about 1e3
    assert_allclose(step.displacement, held.displacement, atol=1e-12 * 0.02)
    assert_allclose(step.contacts["base"].force, held.supports["base"][0], atol=1e-11)
    record = record_of(step)
    audit = Auditor(resolve(scene), tied.mesh)(record)
    assert max(vars(audit).values()) < 1e-10
    assert_allclose(step.energy.external, step.energy.stored, rtol=1e-8)  # nothing slips, nothing is stored between


@pytest.mark.parametrize("method", METHODS)
def test_tied_surface_pulls_and_keeps_its_gap(method: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    base = only_step(simulation_of(pulled(scene_of, method, top=0.01))).contacts["base"]
    assert_allclose(base.pressure, -M * 0.01, rtol=1e-9)  # uniaxial strain of a column of height 1
    assert_allclose(base.gap, 0.0, atol=1e-14)
    assert_allclose(base.traction, 0.0, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("offset", [0.02, -0.02])
def test_gap_offset_moves_a_tied_surface_along_the_normal(
    method: str, offset: float, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    step = only_step(simulation_of(pulled(scene_of, method, top=0.01, gap_offset=offset)))
    assert_allclose(step.contacts["base"].pressure, -M * (0.01 + offset), rtol=1e-9)  # positive: further down
    assert_allclose(step.displacement[:, 1].min(), min(-offset, 0.01), atol=1e-12)


def test_plan_says_tied_and_holds_a_body_by_it_alone(scene_of: SceneOf) -> None:
    scene = scene_of(base={"normal": {"law": "tied"}})
    rows = {row.effect: row for row in make_plan(scene)}
    assert rows["tied"].because == "contacts.base.normal"
    assert {name for name, row in rows.items() if row.on} == {"contact", "tied"}


def test_a_body_held_by_a_tied_surface_alone_is_solved(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    contact = {"surface": "block.bottom", "against": "foundation", "normal": {"law": "tied"}}
    loads = {"pull": {"boundary": "block.top", "traction": [0.01, 0.02]}}
    base = only_step(simulation_of(scene_of(contacts={"base": contact}, loads=loads))).contacts["base"]
    assert_allclose(base.force, [-0.02, -0.04], rtol=1e-9)  # length 2 m
    assert_allclose(base.slip, 0.0, atol=1e-14)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("slope", [0.0, 0.3])
def test_shear_along_the_surface_needs_no_pressure_for_a_scale(
    method: str, slope: float, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """The normal motion is rounding: a measure relative to it would never be met."""
    along, across = np.array([np.cos(slope), np.sin(slope)]), np.array([-np.sin(slope), np.cos(slope)])
    floor = {"shape": "plane", "point": [0.0, -1.0], "normal": across.tolist()}
    contact = {"surface": "block.bottom", "against": "foundation", "normal": {"law": "tied"}}
    top = {"boundary": "block.top", "displacement": dict(zip("xy", (0.01 * along).tolist(), strict=True))}
    solver = {"method": method, "tolerance": 1e-11}
    scene = scene_of(obstacles={"foundation": floor}, contacts={"base": contact}, supports={"top": top}, solver=solver)
    step = only_step(simulation_of(scene))
    assert step.substeps == 1
    base = step.contacts["base"]
    assert base.tangential_force > 0.005 * 0.3  # G u_x over less than the length of 2 m
    assert_allclose(base.slip, 0.0, atol=1e-10 * 0.01)


@pytest.mark.parametrize(
    ("geometry", "motion", "slope"),
    every_nth(
        2,
        [{}, {"order": 2}, {"order": 2, "mesh_size": 0.05}],
        [{"displacement": {"x": 0.02, "y": 0.01}}, {"rotation": {"angle": 0.01, "point": [3.0, -1.0]}}],
        [0.0, 0.3],
    ),
)
def test_a_body_that_is_tied_alone_goes_with_its_obstacle_as_a_whole(
    slope: float, motion: dict[str, Any], geometry: dict[str, Any], scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """The forces of the tied side are rounding, the more the finer it is: they count as balanced."""
    # below the block, and inclined to it: the geometric gap differs from point to point
    plane = {"shape": "plane", "point": [0.0, -0.5], "normal": [slope, 1.0]}
    contact = {"surface": "block.bottom", "against": "foundation", "normal": {"law": "tied"}}
    tables = {"obstacles": {"foundation": plane | motion}, "contacts": {"base": contact}, "supports": {}}
    simulation = simulation_of(scene_of(2, geometry, **tables))
    step = only_step(simulation)
    x, y = simulation.data.points.T
    turned = 0.01 * np.stack([-(y + 1.0), x - 3.0], axis=1)
    expected = turned if "rotation" in motion else np.full_like(turned, [0.02, 0.01])
    assert_allclose(step.displacement, expected, atol=1e-12)
    assert abs(step.energy.stored) < 1e-15


E, A, B, C = 200.0, 1.0, 2.0, 3.0  # [Pa], radii [m]


def pressure(gap: float | None, normal: dict[str, Any] | None = None) -> float:
    """Mean pressure [Pa] between a quarter of two rings of the same radius with other facets."""
    joint = {"surface": "outer.inside", "against": "inner.outside", "normal": normal or {"law": "unilateral"}}
    roller = {f"{name}_{axis}": {"boundary": f"{name}.{axis}_axis", "displacement": {"xy"[axis == "x"]: 0.0}}
              for name in ("inner", "outer") for axis in "xy"}  # fmt: skip
    scene = from_dict(
        {
            "model": "plane stress",
            "geometry": {"builder": "rings", "inner_radius": A, "radius": B, "outer_radius": C, "angle": 90}
            | {"mesh_size": 0.3, "inner_mesh_size": 0.15, "cells": "tensor"},
            "bodies": {"inner": {"E": E, "nu": 0.3}, "outer": {"E": E, "nu": 0.3}},
            "contacts": {"joint": joint | ({} if gap is None else {"gap": gap})},
            "supports": roller,
        }
    )
    (step,) = prepare(scene).steps()
    return step.contacts["joint"].normal_force / (B * np.pi / 2)


def test_rings_that_fit_press_nothing_though_their_facets_overlap() -> None:
    assert pressure(None) > 0.01  # by the mesh, of twice as many facets inside: a press fit of .7 mm
    assert pressure(0.0) == 0.0


@pytest.mark.parametrize("normal", [{"law": "unilateral"}, {"law": "compliance", "c_n": 1e6, "m_n": 1.0}])
def test_a_negative_gap_is_a_press_fit(normal: dict[str, Any]) -> None:
    """Lamé's closed form, the interference on the radius."""
    exact = E * 1e-3 / B / ((B**2 + A**2) / (B**2 - A**2) + (C**2 + B**2) / (C**2 - B**2))
    assert_allclose(pressure(-1e-3, normal), exact, rtol=0.02)  # order 1, cells of a third of a ring


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"sliding": True}, r"contacts\.base\.gap = 0\.0: a side that slides"),
        ({"normal": {"law": "tied"}}, r"contacts\.base\.gap = 0\.0: a tied surface closes none"),
        ({}, r"contacts\.base\.gap = 0\.0: an obstacle has its exact shape; see gap_offset"),
    ],
)
def test_where_the_key_means_nothing_it_is_refused(changed: dict[str, Any], says: str, scene_of: Any) -> None:
    base = {"surface": "block.bottom", "against": "foundation", "gap": 0.0}
    with pytest.raises(SceneError, match=says):
        scene_of(contacts={"base": base | changed})
