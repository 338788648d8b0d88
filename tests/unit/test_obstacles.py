"""Rigid obstacles: distances and normals against geometry, motions against rigid-body kinematics."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from stickslip.geometry.errors import SceneError
from stickslip.geometry.obstacles import Obstacle
from stickslip.geometry.obstacles.obstacle import Rotation
from stickslip.geometry.obstacles.plane import Plane
from stickslip.geometry.obstacles.round import Cylinder, Sphere
from stickslip.geometry.shape import Model

ROUND: list[tuple[Obstacle, int]] = [
    (Plane(point=(0.1, 0.2), normal=(1.0, 3.0)), 2),
    (Plane(point=(0.1, 0.2, -0.5), normal=(1.0, 3.0, -2.0)), 3),
    (Cylinder(point=(0.3, -0.2), radius=0.7), 2),
    (Cylinder(point=(0.3, -0.2), radius=5.0, inside=True), 2),
    (Cylinder(point=(0.3, -0.2, 1.0), axis=(1.0, 2.0, 2.0), radius=0.7), 3),
    (Sphere(center=(0.3, -0.2, 1.0), radius=0.7), 3),
    (Sphere(center=(0.3, -0.2, 1.0), radius=5.0, inside=True), 3),
]


@pytest.mark.parametrize(("obstacle", "dim"), ROUND)
def test_normal_is_the_gradient_of_the_distance_and_leads_to_the_surface(obstacle: Obstacle, dim: int) -> None:
    x, step = np.random.default_rng(5).normal(size=(20, dim)), 1e-6
    normals = obstacle.normals(x)
    assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-14)
    for axis in range(dim):
        shift = step * np.eye(dim)[axis]
        slope = (obstacle.signed_gap(x + shift) - obstacle.signed_gap(x - shift)) / (2 * step)
        assert_allclose(slope, normals[:, axis], atol=1e-8)  # central difference: step² and rounding / step
    closest = x - obstacle.signed_gap(x)[:, None] * normals
    assert_allclose(obstacle.signed_gap(closest), 0.0, atol=1e-14)


def test_round_obstacles_are_where_they_are() -> None:
    outside, inside = (Cylinder(point=(1.0, 0.0), radius=2.0, inside=bore) for bore in (False, True))
    x = np.array([[4.0, 0.0], [1.0, 1.5]])
    assert_allclose(outside.signed_gap(x), [1.0, -0.5])
    assert_allclose(inside.signed_gap(x), [-1.0, 0.5])
    assert_allclose(inside.normals(x), [[-1.0, 0.0], [0.0, -1.0]], atol=0)
    roller = Cylinder(point=(0.0, 0.0, 0.0), axis=(0.0, 0.0, 3.0), radius=1.0)
    assert_allclose(roller.signed_gap(np.array([[3.0, 4.0, 9.0]])), [4.0])


def test_planes_and_balls_are_where_they_are() -> None:
    x = np.array([[1.0, 2.0, 5.0], [4.0, 6.0, 3.0]])
    assert_allclose(Plane(point=(7.0, 7.0, 3.0), normal=(0.0, 0.0, -2.0)).signed_gap(x), [-2.0, 0.0])
    assert_allclose(Sphere(center=(1.0, 2.0, 3.0), radius=1.5).signed_gap(x), [0.5, 3.5])


def test_normals_are_zero_on_the_core() -> None:
    assert_array_equal(Sphere(center=(1.0, 2.0, 3.0), radius=1.5).normals(np.array([[1.0, 2.0, 3.0]])), 0.0)


def test_what_is_tied_turns_about_the_same_point_from_where_it_is() -> None:
    turn = Rotation(angle=1.0, point=(1.0, 0.0))
    roller = Cylinder(point=(0.0, 0.0), radius=2.0, rotation=turn)
    x = np.array([[0.0, 2.4], [2.1, 0.0], [0.0, -3.0]])
    tied, carried = (roller.motion(x, np.zeros(2), 0.1, tied) for tied in (True, False))
    assert_allclose(tied, [[-0.24, -0.1], [0.0, 0.11], [0.3, -0.1]], atol=1e-15)
    assert_allclose(carried, [[-0.2, -0.1], [0.0, 0.1], [0.2, -0.1]], atol=1e-15)


def test_obstacle_moves_and_turns() -> None:
    turn = Rotation(angle=((0.0, 0.0), (1.0, 0.3)), point=(0.0, 0.0))
    roller = Cylinder(point=(0.0, 0.0), radius=2.0, displacement={"y": 0.5}, rotation=turn)
    x = np.array([[0.0, 2.4], [2.1, 0.0]])
    # the roller's own points, radius times angle along the surface, and the shift
    assert_allclose(roller.motion(x, np.array([0.0, 0.25]), 0.15), [[-0.3, 0.25], [0.0, 0.55]], atol=1e-15)
    table = Plane(
        point=(0.0, 0.0, 0.0),
        normal=(0.0, 0.0, 1.0),
        rotation=Rotation(angle=0.1, point=(1.0, 0.0, 5.0), axis=(0, 0, 2)),
    )
    assert_allclose(table.motion(np.array([[1.0, 3.0, 0.7]]), np.zeros(3), 0.1), [[-0.3, 0.0, 0.0]], atol=1e-15)


WRONG: list[tuple[type[Obstacle], dict[str, Any], Model, str]] = [
    (Cylinder, {"point": (0.0, 0.0), "radius": 0.0}, "plane strain", "radius = 0.0: must be positive"),
    (Cylinder, {"point": (0.0, 0.0, 0.0), "radius": 1.0}, "3d", "axis = None: missing"),
    (Cylinder, {"point": (0.0, 0.0, 0.0), "radius": 1.0, "axis": (0.0, 0.0, 0.0)}, "3d", "axis = .* must not be zero"),
    (Cylinder, {"point": (0.0, 0.0), "radius": 1.0, "axis": (0.0, 1.0)}, "plane stress", "axis = .*along z"),
    (Cylinder, {"point": (1.0, 0.0), "radius": 1.0, "axis": (0.0, 1.0)}, "axisymmetric", "point = .*axis of symmetry"),
    (Cylinder, {"point": (0.0, 0.0), "radius": 1.0, "axis": (1.0, 1.0)}, "axisymmetric", "axis = .*expected"),
    (Sphere, {"center": (0.0, 0.0), "radius": 1.0}, "plane strain", '^shape = "sphere": .*use "cylinder"'),
    (Sphere, {"center": (1.0, 0.0), "radius": 1.0}, "axisymmetric", "center = .*axis of symmetry"),
    (Sphere, {"center": (1.0, 0.0), "radius": 1.0}, "3d", "center = .*expected 3 components"),
    (Plane, {"point": (0.0, 0.0), "normal": (0.0, 0.0)}, "plane strain", "normal = .*must not be zero"),
    *((Plane, {"point": (0.0,) * dim, "normal": (*(0.0,) * (dim - 1), 1.0)} | keys, model, sentence)
      for dim, keys, model, sentence in [
          (2, {"force": {"y": 1.0}, "displacement": {"y": 1.0}}, "plane strain", "force.y: displacement.y is"),
          (2, {"force": {"x": 1.0}}, "axisymmetric", "force.x = given: breaks the symmetry"),
          (2, {"displacement": {"z": 1.0}}, "plane strain", "displacement.z = given: a plane model has x and y only"),
      ]),
    *((Plane, {"point": (0.0,) * dim, "normal": (*(0.0,) * (dim - 1), 1.0), "rotation": Rotation(angle=1.0, **turn)},
       model, sentence)
      for dim, turn, model, sentence in [
          (2, {"point": (0.0, 0.0), "axis": (0, 0, 1)}, "plane strain", "rotation.axis = .*turns about z"),
          (3, {"point": (0.0, 0.0, 0.0)}, "3d", "rotation.axis = None: missing"),
          (2, {"point": (0.0, 0.0)}, "axisymmetric", "rotation = given: an axisymmetric model has none"),
          (2, {"point": (0.0, 0.0, 0.0)}, "plane strain", "^rotation.point = .*: expected 2 components here"),
          (3, {"point": (0.0, 0.0), "axis": (0, 0, 1)}, "3d", "^rotation.point = .*: expected 3 components here"),
          (3, {"point": (0.0, 0.0, 0.0), "axis": (0, 1)}, "3d", r"^rotation.axis = \(0.0, 1.0\): expected 3"),
      ]),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "data", "model", "sentence"), WRONG)
def test_wrong_obstacles_are_refused(kind: type[Obstacle], data: dict[str, Any], model: Model, sentence: str) -> None:
    with pytest.raises(SceneError, match=sentence):
        kind(**data).check_model(model)


def test_right_obstacles_are_accepted() -> None:
    turn = Rotation(angle=1.0, point=(0.0, 0.0, 0.0), axis=(0.0, 1.0, 0.0))
    Plane(point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0), rotation=turn).check_model("3d")
    Plane(point=(0.0, 0.0), normal=(0.0, 1.0), rotation=Rotation(angle=1.0, point=(0.0, 0.0))).check_model(
        "plane stress"
    )
    Cylinder(point=(0.0, 3.0), radius=1.0, axis=(0.0, 1.0)).check_model("axisymmetric")
    Cylinder(point=(1.0, 0.0, 0.0), radius=1.0, axis=(1.0, 1.0, 0.0)).check_model("3d")
    Cylinder(point=(1.0, 0.0), radius=1.0).check_model("plane strain")
    Sphere(center=(0.0, 3.0), radius=1.0).check_model("axisymmetric")


def test_wrong_rotations_and_motions_are_refused() -> None:
    with pytest.raises(SceneError, match=r"^axis = \(0\.0, 0\.0, 0\.0\): must not be zero"):
        Rotation(angle=1.0, point=(0.0, 0.0, 0.0), axis=(0.0, 0.0, 0.0))
    late = ((1.0, 1.0), (0.5, 2.0))
    with pytest.raises(SceneError, match=r"^angle"):
        Rotation(angle=late, point=(0.0, 0.0))
    with pytest.raises(SceneError, match=r"^displacement\.y = .*: times must increase"):
        Plane(point=(0.0, 0.0), normal=(0.0, 1.0), displacement={"y": late})
