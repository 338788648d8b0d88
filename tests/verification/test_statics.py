"""Bodies held by contact and friction alone obey statics: stacks, arches, squeezed blocks, a table on four feet."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import every_nth, slow
from stickslip import Coulomb, NoEquilibriumError, Output, Scene, StepError, StepResult
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import from_dict

G, DENSITY = 9.81, 2000.0
MILANKOVITCH = 0.1075  # least thickness over mean radius of a half-circular arch under its weight (1907; Heyman 1977)


def stack(count: int, dim: int, tilt: float = 0.0, mu: float = 0.3) -> Scene:
    """Cubes with meshes that do not match, on a floor that is tilted by so much."""
    friction = {"law": "coulomb", "mu": mu}
    joints = {"joint_1": {"surface": "block_1.bottom", "against": "floor", "friction": friction}}
    for k in range(1, count):
        joints[f"joint_{k + 1}"] = {
            "surface": f"block_{k + 1}.bottom", "against": f"block_{k}.top", "friction": friction,
        }  # fmt: skip
    shape = {"builder": "stack", "count": count, "length": 1.0, "height": 1.0, "mesh_size": 0.5, "mesh_ratio": 0.7}
    return from_dict(
        {
            "model": "plane strain" if dim == 2 else "3d",
            "geometry": shape | ({"width": 1.0} if dim == 3 else {}),
            "bodies": {f"block_{k}": {"E": 1e7, "nu": 0.2, "density": DENSITY} for k in range(1, count + 1)},
            "obstacles": {"floor": {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}},
            "contacts": joints,
            "gravity": {"acceleration": [G * np.sin(tilt), *[0.0] * (dim - 2), -G * np.cos(tilt)]},
        }
    )


def arch(count: int, thickness: float, mu: float) -> Scene:
    """A half circle of mean radius 1 on two blocks that are held."""
    stones = [f"stone_{k}" for k in range(1, count + 1)]
    joints: dict[str, Any] = {"joint_0": {"surface": "stone_1.left", "against": "left_springer.top"}}
    for k, (one, other) in enumerate(pairwise(stones), start=1):
        joints[f"joint_{k}"] = {"surface": f"{other}.left", "against": f"{one}.right"}
    joints[f"joint_{count}"] = {"surface": f"{stones[-1]}.right", "against": "right_springer.top"}
    held = {"x": 0.0, "y": 0.0}
    return from_dict(
        {
            "model": "plane strain",
            "geometry": {
                "builder": "arch", "count": count, "inner_radius": 1 - thickness / 2, "thickness": thickness,
                "springer_height": 0.3, "mesh_size": 0.06,
            },
            "bodies": {
                name: {"E": 1e9, "nu": 0.2, "density": DENSITY} for name in ("left_springer", *stones, "right_springer")
            },
            "contacts": {name: joint | {"friction": {"law": "coulomb", "mu": mu}} for name, joint in joints.items()},
            "supports": {f"{s}_base": {"boundary": f"{s}_springer.bottom", "displacement": held}
                         for s in ("left", "right")},
            "gravity": {"acceleration": [0.0, -G]},
        }
    )  # fmt: skip


def solved(scene: Scene) -> StepResult:
    (step,) = prepare(scene).steps()
    assert step.substeps == 1
    return step


@pytest.mark.parametrize(("count", "dim"), [(3, 2), (10, 2), (3, 3)])
def test_each_joint_of_a_stack_carries_what_lies_above_it(count: int, dim: int) -> None:
    step = solved(stack(count, dim))
    for k in range(1, count + 1):
        force = step.contacts[f"joint_{k}"].force
        above = (count - k + 1) * DENSITY * G
        assert_allclose(force, [0.0] * (dim - 1) + [above], atol=1e-8 * above)
    assert step.iterations <= 6


@pytest.mark.parametrize("dim", [2, 3])
def test_a_tilted_stack_slides_where_the_tilt_exceeds_the_friction(dim: int) -> None:
    """Slender enough to slide before it topples: two cubes topple at a tilt of 1/2."""
    below, above = np.arctan(0.3 * 0.999), np.arctan(0.3 * 1.001)
    force = solved(stack(2, dim, below)).contacts["joint_1"].force
    weight = 2 * DENSITY * G
    across = [0.0] * (dim - 2)
    assert_allclose(force, [-weight * np.sin(below), *across, weight * np.cos(below)], atol=1e-8 * weight)
    with pytest.raises(NoEquilibriumError, match="moves along x"):
        solved(stack(2, dim, above))


def test_a_tilted_stack_topples_before_it_slides() -> None:
    """Three cubes: the weight leaves the base at a tilt of 1/3."""
    solved(stack(3, 2, np.arctan(0.99 / 3), mu=0.6))
    with pytest.raises(NoEquilibriumError):
        solved(stack(3, 2, np.arctan(1.01 / 3), mu=0.6))


def test_thrust_of_an_arch_is_in_equilibrium() -> None:
    """Alike at both ends, the same at every joint, and half the weight below each end."""
    scene = arch(9, 0.3, 0.6)
    step = solved(scene)
    forces = np.array([step.contacts[f"joint_{k}"].force for k in range(10)])
    low, high = 1 - 0.15, 1 + 0.15
    stone = (high**2 - low**2) / 2 * np.pi / 9 * DENSITY * G  # of a sector; the mesh has chords
    weight = forces[0, 1] + forces[-1, 1]
    assert_allclose(weight, 9 * stone, rtol=5e-3)
    assert_allclose(forces[0], [-1, 1] * forces[-1], rtol=1e-3)  # gmsh's mesh is not quite symmetric
    forces[-1] *= -1  # the last joint's force is the one on the stone to its left
    thrust = forces[0, 0]
    assert thrust > 0.1 * weight
    assert_allclose(forces[:, 0], thrust, rtol=1e-8)
    assert_allclose(-np.diff(forces[:, 1]), weight / 9, rtol=1e-8)


@pytest.mark.parametrize("share", [1.02, *slow(1.2)])
def test_an_arch_thicker_than_milankovitchs_stands(share: float) -> None:
    step = solved(arch(20, share * MILANKOVITCH, 0.5))
    assert_allclose(step.contacts["joint_0"].force, [-1, 1] * step.contacts["joint_20"].force, rtol=1e-3)


def test_an_arch_thinner_than_milankovitchs_has_no_equilibrium() -> None:
    with pytest.raises(NoEquilibriumError, match="cannot balance the loads"):
        solved(arch(20, 0.98 * MILANKOVITCH, 0.5))


def test_an_arch_of_smooth_stones_has_no_equilibrium() -> None:
    """At its foot the joint is level, so friction alone takes the thrust."""
    with pytest.raises(NoEquilibriumError, match="cannot balance the loads"):
        solved(arch(9, 0.3, 0.1))


PRESS, MU = 100.0, 0.3
LIMIT = 2 * MU * PRESS
FRICTION = {"law": "coulomb", "mu": MU}
STEPS = {"end": 2.0, "count": 2}  # squeezed from t = 0 on; the weight comes between 1 and 2


def weighing(weight: float) -> list[list[float]]:
    return [[0.0, 0.0], [1.0, 0.0], [2.0, weight]]


def model_of(dim: int) -> str:
    return "plane strain" if dim == 2 else "3d"


def between_planes(dim: int, weight: float, by: str) -> Scene:
    """A unit cube between rigid walls x = 0 and x = 1; the right one is pushed by a force, or as far as makes it."""
    E, across = 1e4, [0.0] * (dim - 1)
    push = {"force": -PRESS, "displacement": -PRESS / E}[by]  # nu = 0: the block's stiffness is E times 1 m
    walls: dict[str, Any] = {
        "left": {"shape": "plane", "point": [0.0, *across], "normal": [1.0, *across]},
        "right": {"shape": "plane", "point": [1.0, *across], "normal": [-1.0, *across]},
    }
    walls["right"][by] = {"x": [[0.0, push], [2.0, push]]}
    shape = {"builder": "block", "length": 1.0, "height": 1.0, "mesh_size": 0.25, "cells": "tensor"}
    return from_dict(
        {
            "model": model_of(dim),
            "geometry": shape | ({"width": 1.0} if dim == 3 else {}),
            "bodies": {"block": {"E": E, "nu": 0.3 if by == "force" else 0.0, "density": 1.0}},
            "obstacles": walls,
            "contacts": {s: {"surface": f"block.{s}", "against": s, "friction": FRICTION} for s in walls},
            "gravity": {"acceleration": [*across, weighing(-weight)]},
            "steps": STEPS,
        }
    )


def between_bodies(dim: int, weight: float, by: str) -> Scene:
    """The same between two elastic cubes with other meshes, lying: the weight pulls along x."""
    E, up, axes = 1e4, "xyz"[dim - 1], "xyz"[:dim]
    shape = {"builder": "stack", "count": 3, "length": 1.0, "height": 1.0, "mesh_size": 0.25, "mesh_ratio": 2 / 3}
    lid: dict[str, Any] = {axis: 0.0 for axis in axes[:-1]}
    data: dict[str, Any] = {
        "model": model_of(dim),
        "geometry": shape | {"cells": "tensor"} | ({"width": 1.0} if dim == 3 else {}),
        "bodies": {f"block_{k}": {"E": E, "nu": 0.0} | ({"density": 1.0} if k == 2 else {}) for k in (1, 2, 3)},
        "contacts": {
            "low": {"surface": "block_2.bottom", "against": "block_1.top", "friction": FRICTION},
            "high": {"surface": "block_2.top", "against": "block_3.bottom", "friction": FRICTION},
        },
        "gravity": {"acceleration": [weighing(weight), *[0.0] * (dim - 1)]},
        "steps": STEPS,
    }
    if by == "force":
        data["loads"] = {
            "press": {"boundary": "block_3.top", "traction": [*[0.0] * (dim - 1), [[0, -PRESS], [2, -PRESS]]]}
        }
    else:  # three cubes one behind the other
        lid[up] = [[0.0, -3 * PRESS / E], [2.0, -3 * PRESS / E]]
    base = {axis: 0.0 for axis in axes}
    data["supports"] = {
        "base": {"boundary": "block_1.bottom", "displacement": base},
        "lid": {"boundary": "block_3.top", "displacement": lid},
    }
    return from_dict(data)


def last(scene: Scene) -> StepResult:
    *_, step = prepare(scene).steps()
    return step


@pytest.mark.parametrize("by", ["force", "displacement"])
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("share", [0.5, 0.999])
def test_walls_carry_half_the_weight_each(dim: int, by: str, share: float) -> None:
    step = last(between_planes(dim, share * LIMIT, by))
    across = [0.0] * (dim - 2)
    for name, normal in (("left", PRESS), ("right", -PRESS)):
        force = step.contacts[name].force
        assert_allclose(force, [normal, *across, share * LIMIT / 2], rtol=1e-8, atol=1e-8 * PRESS)


@pytest.mark.parametrize("by", ["force", "displacement"])
@pytest.mark.parametrize("dim", [2, 3])
def test_elastic_platens_hold_as_much(dim: int, by: str) -> None:
    """How much each carries is theirs to share, unless both are held alike."""
    weight = 0.999 * LIMIT
    step = last(between_bodies(dim, weight, by))
    low, high = (step.contacts[name].force for name in ("low", "high"))
    assert_allclose([low[-1], high[-1]], [PRESS, -PRESS], rtol=1e-8)
    assert_allclose(low[0] + high[0], -weight, rtol=1e-8)
    assert max(abs(low[0]), abs(high[0])) <= MU * PRESS * (1 + 1e-8)
    if by == "displacement":
        assert_allclose([low[0], high[0]], -weight / 2, rtol=1e-8)


@pytest.mark.parametrize(("scene", "moves"), [(between_planes, "bodies.block moves along -{up}"),
                                              (between_bodies, "bodies.block_2 moves along x")])  # fmt: skip
@pytest.mark.parametrize("dim", [2, 3])
def test_more_weight_than_friction_can_hold_has_no_equilibrium(dim: int, scene: Any, moves: str) -> None:
    """All is well until the weight is 60 N; the last good substep lies within a halved step's reach of it."""
    reached: list[float] = []
    steps = prepare(scene(dim, 1.001 * LIMIT, "force")).steps()
    with pytest.raises(NoEquilibriumError, match=f"cannot balance the loads: {moves.format(up='xyz'[dim - 1])}"):
        reached.extend(step.time for step in steps)
    holds = 1 + 1 / 1.001
    assert reached[:2] == [0.0, 1.0]
    assert holds - 1e-3 < reached[2] < holds


@pytest.mark.parametrize(
    ("scene", "method", "surface"),
    [
        (between_planes, "auto", "auto"),
        (between_bodies, "auto", "auto"),
        pytest.param(between_planes, "surface-uzawa", "matrix-free", marks=pytest.mark.slow),
    ],
)
def test_what_elasticity_limits_is_told_as_a_limit(scene: Any, method: str, surface: str) -> None:
    """Platens that are held where they are would press as hard as need be on rigid bodies: springs find the limit.

    Only the condensed form can have them: else the step is not solved, and nothing is claimed.
    """
    found, reached = scene(2, 1.001 * LIMIT, "displacement"), list[float]()
    simulation = prepare(replace(found, solver=replace(found.solver, method=method, surface=surface)))
    with pytest.raises(StepError) as caught:
        reached.extend(step.time for step in simulation.steps())
    assert isinstance(caught.value, NoEquilibriumError) == (surface == "auto")
    near = 2e-3 if surface == "auto" else 2 / 256
    assert 1 + 1 / 1.001 - near < reached[-1] < 1 + 1 / 1.001 + 1e-9


def test_friction_is_what_holds() -> None:
    """Half the coefficient holds half the weight."""
    scene = between_planes(2, 0.999 * LIMIT, "force")
    weaker = {s: replace(contact, friction=Coulomb(mu=MU / 2)) for s, contact in scene.contacts.items()}
    with pytest.raises(NoEquilibriumError):
        list(prepare(replace(scene, contacts=weaker)).steps())


@pytest.mark.slow  # of the sentence above, and of the runs of test_limits
def test_run_ends_as_no_equilibrium_and_keeps_what_was_reached(tmp_path: Path) -> None:
    scene = replace(between_planes(2, 1.001 * LIMIT, "force"), output=Output(pictures=False))
    outcome, content = run(scene, tmp_path / "out")
    assert (outcome.status, outcome.exit_code, content["status"]) == ("no_equilibrium", 3, "no_equilibrium")
    assert "bodies.block moves along -y" in outcome.sentence
    assert [step["time"] for step in content["steps"][:2]] == [0.0, 1.0]
    assert len(content["steps"]) == len(list((tmp_path / "out" / "steps").iterdir())) == 3
    assert max(content["audit"].values()) <= 1e-8


TABLE = """
def build(model, parameters):
    occ, foot = model.occ, 0.3
    box = occ.addBox(0, 0, 0, 1, 1, 0.4)
    corners = [(x, y) for x in (0, 1 - foot) for y in (0, 1 - foot)]
    feet = [(2, occ.addRectangle(x, y, 0, foot, foot)) for x, y in corners]
    occ.fragment([(3, box)], feet)
    occ.synchronize()

    def name(dim, tags, text):
        model.setPhysicalName(dim, model.addPhysicalGroup(dim, tags), text)

    def inside(x, y, z, size):
        e = 1e-6
        found = model.getEntitiesInBoundingBox(x - e, y - e, z - e, x + size + e, y + size + e, z + e, 2)
        return [tag for dim, tag in found]

    name(3, [tag for dim, tag in model.getEntities(3)], "table")
    for k, (x, y) in enumerate(corners):
        name(2, inside(x, y, 0, foot), f"table.foot_{k}")
    name(2, inside(0, 0, 0.4, 1), "table.top")
"""
P = 1e6  # [Pa]
STIFF = 1e12  # [Pa]
UNEVEN = np.array([0.0, 0.2, 0.05, 0.3])  # heights of the floor under the feet, over P / E: all of them touch


def stand(path: Path, E: float, order: tuple[int, ...] = (0, 1, 2, 3), **solver: Any) -> StepResult:
    """The table on its feet under a load that leans to one side."""
    (path / "table.py").write_text(TABLE)
    data = {
        "model": "3d",
        "geometry": {"file": str(path / "table.py"), "mesh_size": 0.15},
        "bodies": {"table": {"E": E, "nu": 0.3}},
        "obstacles": {"floor": {"shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}},
        "contacts": {
            f"foot_{k}": {"surface": f"table.foot_{k}", "against": "floor", "gap_offset": UNEVEN[k] * P / E}
            for k in order
        },
        "supports": {
            "here": {"point": [0.0, 0.0, 0.4], "displacement": {"x": 0.0, "y": 0.0}},
            "there": {"point": [1.0, 0.0, 0.4], "displacement": {"y": 0.0}},
        },
        "loads": {"top": {"boundary": "table.top", "pressure": P}},
        "solver": solver,
    }
    (step,) = prepare(from_dict(data)).steps()
    return step


def test_displacement_of_a_stiff_block_on_four_feet_is_unique(tmp_path: Path) -> None:
    found = stand(tmp_path, STIFF)
    again = stand(tmp_path, STIFF, order=(2, 0, 3, 1), tolerance=1e-12)
    size = np.abs(found.displacement).max()
    assert_allclose(again.displacement, found.displacement, rtol=0, atol=1e-6 * size)
    carried = sum(foot.normal_force for foot in found.contacts.values())
    assert_allclose(carried, P, rtol=1e-7)  # the top's area is 1 m²; the solver's 1e-8
    assert min(foot.normal_force for foot in found.contacts.values()) > 0.01 * P  # all four have to


@pytest.mark.parametrize("E", [1.0, 1e6])
def test_stiffness_scales_the_displacement_and_nothing_else(tmp_path: Path, E: float) -> None:
    stiff, soft = stand(tmp_path, STIFF), stand(tmp_path, E)
    size = np.abs(stiff.displacement).max()
    assert_allclose(soft.displacement * E / STIFF, stiff.displacement, rtol=0, atol=1e-6 * size)


BLOCKS = """
def build(model, parameters):
    occ = model.occ
    upper = occ.addRectangle(0.5, 1, 0, 1, 1)
    corners = [(0, 0), (2, 0), (2, 1), (1.5, 1), (0.5, 1), (0, 1)]
    points = [occ.addPoint(x, y, 0) for x, y in corners]
    lines = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1])]
    lower = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    occ.synchronize()
    below, right, above, left = (tag for dim, tag in model.getBoundary([(2, upper)], oriented=False))
    groups = {
        (2, "upper"): [upper], (2, "lower"): [lower],
        (1, "upper.bottom"): [below], (1, "upper.top"): [above],
        (1, "lower.bottom"): [lines[0]], (1, "lower.overhang"): [lines[2], lines[4]],
        (1, "lower.top"): [lines[3]],
    }
    for (dim, name), tags in groups.items():
        model.setPhysicalName(dim, model.addPhysicalGroup(dim, tags), name)
    for dim, tag in model.getBoundary([(2, upper)], oriented=False, recursive=True):
        model.mesh.setSize([(dim, tag)], parameters["size"])
    for tag in points:
        model.mesh.setSize([(0, tag)], 0.3)
"""
PRESSURE = 1e5  # [Pa]


@pytest.mark.parametrize(("slave", "size", "order"), every_nth(2, ["upper", "lower"], [0.2, 0.05], [1, 2]))
def test_pressure_goes_over_to_a_wider_block(tmp_path: Path, slave: str, size: float, order: int) -> None:
    (tmp_path / "blocks.py").write_text(BLOCKS)
    sides = ["upper.bottom", "lower.top"]
    surface, against = sides if slave == "upper" else sides[::-1]
    scene = from_dict(
        {
            "model": "plane strain",
            "geometry": {"file": str(tmp_path / "blocks.py"), "order": order, "parameters": {"size": size}},
            "bodies": {"upper": {"E": 2e6, "nu": 0.3}, "lower": {"E": 2e6, "nu": 0.3}},
            "contacts": {"joint": {"surface": surface, "against": against}},
            "supports": {
                "base": {"boundary": "lower.bottom", "displacement": {"y": 0.0}},
                "foot": {"point": [0.0, 0.0], "displacement": {"x": 0.0}},
                "top": {"point": [0.5, 2.0], "displacement": {"x": 0.0}},
            },
            "loads": {
                "top": {"boundary": "upper.top", "pressure": PRESSURE},
                "overhang": {"boundary": "lower.overhang", "pressure": PRESSURE},
            },
            "solver": {"tolerance": 1e-12},
        }
    )
    (step,) = prepare(scene).steps()
    joint = step.contacts["joint"]
    assert_allclose(joint.weight.sum(), 1.0, rtol=1e-9)
    assert_allclose(joint.pressure, PRESSURE, rtol=1e-8)
    assert_allclose(step.stress[:, 1, 1], -PRESSURE, rtol=1e-8)
    assert np.abs(step.stress[:, [0, 0], [0, 1]]).max() < 1e-8 * PRESSURE
