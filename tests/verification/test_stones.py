"""Bodies held by contact and friction alone: a stack settles; an arch stands if it is thick and rough enough."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import slow
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.stepping.stepper import NoEquilibriumError
from stickslip.workflows.lab.verification.prepared import prepare
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
