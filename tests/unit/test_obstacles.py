"""Obstacles: distances and normals, how they move and are driven, and balls in cones."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial import cKDTree

from shared.cases import every_nth
from shared.problems import plane, scene_of
from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array
from stickslip.geometry.dolfinx_versions import ufl
from stickslip.geometry.errors import SceneError
from stickslip.geometry.field import HeightMap
from stickslip.geometry.obstacles import Obstacle
from stickslip.geometry.obstacles.cone import Cone
from stickslip.geometry.obstacles.graph import Graph
from stickslip.geometry.obstacles.obstacle import Rotation
from stickslip.geometry.obstacles.plane import Plane
from stickslip.geometry.obstacles.round import Cylinder, Sphere
from stickslip.geometry.shape import Model
from stickslip.solvers.contact.build import along
from stickslip.solvers.results.step_result import SLIP
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.lab.verification.prepared import prepare, system_of
from stickslip.workflows.scene_file.read import from_dict, read

CONES = [
    Cone(apex=(0.0, 0.2), axis=(0.0, 3.0), half_angle=30.0),
    Cone(apex=(0.0, 0.2), axis=(0.0, -1.0), half_angle=70.0, inside=True),
    Cone(apex=(0.3, -0.2, 0.1), axis=(1.0, 2.0, -2.0), half_angle=50.0),
    Cone(apex=(0.3, -0.2, 0.1), axis=(1.0, 2.0, -2.0), half_angle=40.0, inside=True),
]
KINDS: list[tuple[Obstacle, int]] = [
    *((cone, len(cone.apex)) for cone in CONES),
    (Plane(point=(0.1, 0.2), normal=(1.0, 3.0)), 2),
    (Plane(point=(0.1, 0.2, -0.5), normal=(1.0, 3.0, -2.0)), 3),
    (Cylinder(point=(0.3, -0.2), radius=0.7), 2),
    (Cylinder(point=(0.3, -0.2), radius=5.0, inside=True), 2),
    (Cylinder(point=(0.3, -0.2, 1.0), axis=(1.0, 2.0, 2.0), radius=0.7), 3),
    (Sphere(center=(0.3, -0.2, 1.0), radius=0.7), 3),
    (Sphere(center=(0.3, -0.2, 1.0), radius=5.0, inside=True), 3),
    (Graph(height="0.5*x", under=True), 2),
    (Graph(height="0.01*sin(x)*cos(2*y) - 0.5*y"), 3),
]


@pytest.mark.parametrize(("obstacle", "dim"), KINDS)
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


ALONG_Y = HeightMap(over=("y",), rows=((0.0, 0.0), (1.0, 2.0)))
WRONG: list[tuple[type[Obstacle], dict[str, Any], Model, str]] = [
    (Cylinder, {"point": (0.0, 0.0), "radius": 0.0}, "plane strain", "radius = 0.0: must be positive"),
    (Cylinder, {"point": (0.0, 0.0, 0.0), "radius": 1.0}, "3d", "axis = None: missing"),
    (Cylinder, {"point": (0.0, 0.0, 0.0), "radius": 1.0, "axis": (0.0, 0.0, 0.0)}, "3d", "axis = .* must not be zero"),
    (Cylinder, {"point": (0.0, 0.0), "radius": 1.0, "axis": (0.0, 1.0)}, "plane stress", "axis = .*along z"),
    (Cylinder, {"point": (1.0, 0.0), "radius": 1.0, "axis": (0.0, 1.0)}, "axisymmetric", "point = .*axis of symmetry"),
    (Cylinder, {"point": (0.0, 0.0), "radius": 1.0, "axis": (1.0, 1.0)}, "axisymmetric", "axis = .*expected"),
    (Sphere, {"center": (0.0, 0.0), "radius": 1.0}, "plane strain", '^shape = "sphere": .*use "cylinder"'),
    (Sphere, {"center": (0.0, 0.0), "radius": 1.0}, "plane stress", '^shape = "sphere": .*use "cylinder"'),
    (Sphere, {"center": (1.0, 0.0), "radius": 1.0}, "axisymmetric", "center = .*axis of symmetry"),
    (Sphere, {"center": (1.0, 0.0), "radius": 1.0}, "3d", "center = .*expected 3 components here$"),
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
    *((Cone, {"apex": (0.0, 0.0, 0.0), "axis": (0.0, 0.0, 1.0), "half_angle": 30.0} | keys, model, sentence)
      for keys, model, sentence in [
          ({"half_angle": 0.0}, "3d", "half_angle = 0.0: must lie between 0 and 90"),
          ({"half_angle": 90.0}, "3d", "half_angle = 90.0: must lie between 0 and 90"),
          ({"axis": (0.0, 0.0, 0.0)}, "3d", "axis = .*must not be zero"),
          ({"apex": (0.0, 0.0)}, "3d", "apex = .*expected 3 components"),
          ({"axis": (0.0, 1.0)}, "3d", "axis = .*expected 3 components"),
          ({}, "plane strain", 'shape = "cone": there is none in a plane model'),
          ({}, "plane stress", 'shape = "cone": there is none in a plane model'),
          ({"apex": (1.0, 0.0), "axis": (0.0, 1.0)}, "axisymmetric", "apex = .*axis of symmetry"),
          ({"apex": (0.0, 0.0), "axis": (1.0, 1.0)}, "axisymmetric", "axis = .*expected"),
      ]),
    *((Graph, {"height": height}, model, f"^height{sentence}")
      for height, model, sentence in [
          ("q", "3d", ' = "q": column 1'),
          ("pi*x*t", "axisymmetric", r' = "pi\*x\*t": t: it is a formula of \[\'x\'\]$'),
          ("x + y*t", "plane strain", r' = "x \+ y\*t": t, y: it is a formula of \[\'x\'\]$'),
          ("x + y - z", "3d", r' = "x \+ y - z": z: it is a formula of \[\'x\', \'y\'\]$'),
          (ALONG_Y, "plane stress", r".over = \['y'\]: expected \['x'\]$"),
          (replace(ALONG_Y, plus=0.5), "3d", ".plus = 0.5: move the obstacle by displacement"),
      ]),
    (Graph, {"height": "x", "force": {"x": 1.0}}, "axisymmetric", "force.x = given: breaks the symmetry"),
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
    Cone(apex=(0.0, 0.0), axis=(0.0, -1.0), half_angle=0.5).check_model("axisymmetric")
    Cone(apex=(1.0, 0.0, 0.0), axis=(1.0, 0.0, 1.0), half_angle=89.5).check_model("3d")
    Graph(height="pi*x", displacement={"x": 1.0}).check_model("plane strain")
    Graph(height="pi*x", displacement={"y": 1.0}).check_model("axisymmetric")
    Graph(height="pi*x*y").check_model("3d")
    Graph(height=ALONG_Y).check_model("3d")
    Graph(height=HeightMap(over=("y", "x"), rows=((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))).check_model("3d")


def test_a_graph_has_a_height_over_each_point() -> None:
    Graph(height="1/(x*y)").check_points(np.array([[1.0, 1.0, 0.0], [2.0, 1.0, 0.0]]))
    with pytest.raises(SceneError, match=r'^height = "1/\(x\*y\)": has no finite value at \(2, 0, 5\)$'):
        Graph(height="1/(x*y)").check_points(np.array([[1.0, 1.0, 0.0], [2.0, 0.0, 5.0]]))
    Graph(height=ALONG_Y).check_points(np.array([[7.0, 0.5, 0.0]]))
    with pytest.raises(SceneError, match=r"^height: the map has no height at y = 7"):
        Graph(height=ALONG_Y).check_points(np.array([[0.5, 0.5, 0.0], [0.5, 7.0, 0.0]]))


@pytest.mark.parametrize(("size", "shift"), [(1e-9, 0.0), (1.0, 1e5), (1e6, 0.0)])
def test_a_graph_of_any_size_anywhere_is_that_of_size_one(size: float, shift: float) -> None:
    """The circle of radius 2, and the plane y = -x."""
    x = size * np.array([[-1.0, 1.0], [0.5, 3.0], [1.0, 1.0], [1.0, 1.5]])
    round_, slope = Graph(height=f"sqrt({4 * size**2} - (x - {shift})**2)"), Graph(height="-x")
    at = x + np.array([shift, 0.0])
    assert_allclose(round_.signed_gap(at), np.linalg.norm(x, axis=1) - 2 * size, rtol=1e-9)
    assert_allclose(round_.normals(at), x / np.linalg.norm(x, axis=1)[:, None], atol=1e-4)
    assert_allclose(slope.signed_gap(x), x.sum(axis=1) / np.sqrt(2), atol=1e-12 * size)
    assert slope.signed_gap(x[:0]).shape == (0,)
    assert slope.normals(x[:0]).shape == (0, 2)


def test_beyond_a_map_nothing_is_nearest() -> None:
    gaps = Graph(height=ALONG_Y).signed_gap(np.array([[0.0, 0.5, 1.0], [0.0, 1.5, 1.0], [0.0, 0.5, 2.0]]))
    assert_allclose(gaps, [0.0, np.nan, 1 / np.sqrt(5)], atol=1e-12)


def test_what_changes_in_time_is_listed_with_its_place() -> None:
    turn, rise = Rotation(angle=0.5, point=(0.0, 0.0)), ((0.0, 0.0), (1.0, 2.0))
    plane_ = Plane(point=(0.0, 0.0), normal=(0.0, 1.0), displacement={"x": rise}, force={"y": 3.0}, rotation=turn)
    found = {("displacement", "x"): rise, ("force", "y"): 3.0, ("rotation", "angle"): 0.5}
    assert plane_.amplitudes() == found
    assert replace(plane_, rotation=None).amplitudes() == {key: found[key] for key in list(found)[:2]}
    assert plane_.driven() == ("y",)


def test_wrong_rotations_and_motions_are_refused() -> None:
    with pytest.raises(SceneError, match=r"^axis = \(0\.0, 0\.0, 0\.0\): must not be zero"):
        Rotation(angle=1.0, point=(0.0, 0.0, 0.0), axis=(0.0, 0.0, 0.0))
    late = ((1.0, 1.0), (0.5, 2.0))
    with pytest.raises(SceneError, match=r"^angle"):
        Rotation(angle=late, point=(0.0, 0.0))
    with pytest.raises(SceneError, match=r"^displacement\.y = .*: times must increase"):
        Plane(point=(0.0, 0.0), normal=(0.0, 1.0), displacement={"y": late})


def generators(cone: Cone, count: int, reach: float) -> Array:
    """Points (k, d) that fill the cone's surface from the apex to a distance."""
    axis = np.array(cone.axis) / np.linalg.norm(cone.axis)
    around = np.linalg.svd(axis[None])[2][1:]  # directions across the axis
    turns = np.linspace(0, 2 * np.pi, count, endpoint=False) if len(axis) == 3 else np.array([0.0, np.pi])
    out = np.stack([np.cos(turns), np.sin(turns)][: len(around)], axis=1) @ around
    angle = np.radians(cone.half_angle)
    lines = np.cos(angle) * axis + np.sin(angle) * out
    return np.asarray((np.array(cone.apex) + np.linspace(0, reach, 2000)[:, None, None] * lines).reshape(-1, len(axis)))


def scattered(cone: Cone) -> Array:
    """Points within, without and behind the apex."""
    return np.asarray(np.array(cone.apex) + np.random.default_rng(5).normal(size=(60, len(cone.apex))))


def regions(cone: Cone, x: Array) -> tuple[Any, Any]:
    """Which points lie within the cone, and which of the others have the apex as the nearest point of it."""
    axis, arm = np.array(cone.axis) / np.linalg.norm(cone.axis), x - np.array(cone.apex)
    from_axis = np.degrees(np.arccos(arm @ axis / np.linalg.norm(arm, axis=1)))
    return from_axis < cone.half_angle, from_axis > cone.half_angle + 90


@pytest.mark.parametrize("cone", CONES)
def test_distance_is_that_of_the_nearest_point_and_positive_where_the_body_may_be(cone: Cone) -> None:
    x, surface = scattered(cone), generators(cone, 720, 6.0)
    nearest = cKDTree(surface).query(x)[0]
    within, behind = regions(cone, x)
    assert min(within.sum(), behind.sum(), (~within & ~behind).sum()) > 2
    sign = np.where(within, -1.0, 1.0) * (-1.0 if cone.inside else 1.0)
    # points of the surface lie up to 0.003 m apart along it and 0.03 m around it
    assert_allclose(cone.signed_gap(x), sign * nearest, atol=2e-3)


@pytest.mark.parametrize("inside", [False, True])
def test_on_the_axis_and_at_the_apex_the_normal_is_along_it(inside: bool) -> None:
    cone = Cone(apex=(0.0, 1.0), axis=(0.0, 1.0), half_angle=30.0, inside=inside)
    x, out = np.array([[0.0, 0.0], [0.0, 1.0], [0.0, 3.0]]), -1.0 if inside else 1.0
    assert_allclose(cone.signed_gap(x), [out * 1.0, 0.0, -out * 1.0], atol=1e-15)  # 2 m sin 30°
    assert_allclose(cone.normals(x), [[0.0, -out]] * 3, atol=0)


@pytest.mark.parametrize("inside", [False, True])
def test_symbols_have_the_gradient_that_numbers_have_on_the_surface_too(inside: bool) -> None:
    """Vertices of the mesh lie within, on and outside the cone of 45 degrees, and behind its apex."""
    cone = Cone(apex=(0.0, 0.5), axis=(0.0, 1.0), half_angle=45.0, inside=inside)
    hold = {"base": {"boundary": "block.bottom", "displacement": {"y": 0.0}}}
    domain = system_of(scene_of(2, {"cells": "tensor"}, model="axisymmetric", supports=hold)).mesh.domain
    x = ufl.SpatialCoordinate(domain)
    corners = dx.reference_nodes("quadrilateral", 1)
    distance = cone.distance([x[0], x[1]], ufl.sqrt)
    cells = np.arange(domain.topology.index_map(2).size_local, dtype=np.int32)
    places, values, slopes = (
        dx.CellExpression(e, corners, domain)(cells).reshape(len(cells) * 4, -1)
        for e in (x, distance, ufl.grad(distance))
    )
    off_axis = places[:, 0] > 1e-9  # on it the distance has an edge
    assert_allclose(values[:, 0], cone.signed_gap(places), atol=1e-14)
    assert_allclose(slopes[off_axis], cone.normals(places[off_axis]), atol=1e-12)
    assert np.sum(np.abs(values) < 1e-15) > 4  # on the surface itself


@pytest.mark.parametrize("c_n", [3.0, 3e4])
@pytest.mark.parametrize(("dim", "inside"), [(2, False), (3, False), (3, True)])
def test_compliance_meets_a_cone_at_each_point(dim: int, inside: bool, c_n: float) -> None:
    """The form in UFL and the points in numbers: two ways of one distance. Stiff laws have nodes for the points."""
    law = {"law": "compliance", "c_n": c_n, "m_n": 2.0}
    middle, low = ([0.0] if dim == 2 else [0.9, 0.45]), [1.0]  # between the nodes
    cone = {"shape": "cone", "apex": middle + ([-0.6] if inside else [0.05]), "half_angle": 70.0, "inside": inside}
    cone["axis"] = [0.0] * (dim - 1) + (low if inside else [-1.0])
    base = {"surface": "block.bottom", "against": "foundation", "normal": law, "gap_offset": -0.2}
    tables: dict[str, Any] = {"obstacles": {"foundation": cone}, "contacts": {"base": base}}
    system = system_of(scene_of(dim, {"mesh_size": 0.5}, model="axisymmetric" if dim == 2 else "3d", **tables))
    u = dx.fem.Function(system.space)
    u.x.array[:] = np.random.default_rng(11).normal(size=len(u.x.array))
    (rows,), (contact,) = system.contacts, (pair.contact for pair in system.problem.pairs.values())
    form = dx.assemble_vector(system.weak.compile(system.weak.normal_compliance(u, contact, rows.normal))).array
    values = u.x.array.reshape(-1, dim)
    assert rows.quadrature is not None
    points = rows.quadrature(rows.degree)
    N, gap = along(points.relative, points.normals[:, None]), points.gap - 0.2
    pressure = c_n * np.maximum(N @ values[rows.surface.nodes].ravel() - gap, 0.0) ** 2
    by_points = np.zeros_like(values)
    by_points[rows.surface.nodes] = (N.T @ (points.weights * pressure)).reshape(-1, dim)
    assert np.any(pressure > 0)
    assert_allclose(by_points.ravel(), form, atol=1e-12 * np.abs(form).max())
    turns = dim == 3  # the cone's normals do, along the side
    assert (len(rows.W_n) == len(rows.surface.nodes)) == (turns and c_n > 3)
    assert_allclose(rows.W_n.sum(), points.weights.sum(), rtol=1e-13)
    assert_allclose(rows.gap, rows.at_points(gap), atol=1e-13)
    assert_allclose(rows.N_n.toarray(), rows.at_points(N).toarray(), atol=1e-13)


@pytest.mark.parametrize(("lower", "upper"), [(1.0, 1e-3), (1e-3, 1.0)])
def test_a_law_is_stiff_beside_the_body_that_it_acts_on(lower: float, upper: float) -> None:
    """On a roller: a soft body elsewhere changes nothing."""
    words = [f"bodies.lower.E={lower!r}", f"bodies.upper.E={upper!r}", "geometry.mesh_size=0.25"]
    roller = "obstacles={ roller = { shape = 'cylinder', point = [0.5, -3.0], radius = 3.0 } }"
    base = "contacts.base={ surface = 'lower.bottom', against = 'roller', normal = { law = 'compliance', c_n = 1.0 } }"
    held = "supports.base={ boundary = 'lower.left', displacement = { x = 0.0, y = 0.0 } }"
    system = system_of(read("two_blocks", [*words, roller, base, held]))
    rows = next(rows for rows in system.contacts if rows.name == "base")
    assert (rows.of_points is not None) == (lower < 0.1)


@pytest.mark.parametrize(
    ("half_angle", "mu", "order", "dim"),
    [*every_nth(2, [30.0, 45.0, 60.0], [0.0, 0.1], [1, 2], [2]), (45.0, 0.0, 1, 3)],
)
def test_a_ball_rests_in_a_socket_as_statics_says(half_angle: float, mu: float, order: int, dim: int) -> None:
    """N = P / (sin + mu cos) of the half angle: a ball, its flat side up, that is pressed into a conical socket.

    All normals have the same slope, so the balance along the axis is exact on any mesh; at mu = 0.1 all of it slips.
    """
    angle, radius = np.radians(half_angle), 1.0
    tip = [0.0] * (dim - 1) + [radius - radius / np.sin(angle)]  # the cone touches the ball
    if dim == 2:
        shape: dict[str, Any] = {"builder": "half_disc", "symmetric": True}
        body, side, supports = "disc", "arc", {}
    else:
        shape, body, side = {"builder": "half_ball", "symmetry": "quarter"}, "ball", "cap"
        supports = {p: {"boundary": f"ball.{p}", "displacement": {p[0]: 0.0}} for p in ("x_plane", "y_plane")}
    shape |= {"radius": radius, "mesh_size": 0.05 if dim == 2 else 0.25, "order": order}
    data = {
        "model": "axisymmetric" if dim == 2 else "3d",
        "geometry": shape,
        "bodies": {body: {"E": 1.0, "nu": 0.3}},
        "obstacles": {
            "socket": {
                "shape": "cone", "apex": tip, "axis": [0.0] * (dim - 1) + [1.0], "half_angle": half_angle,
                "inside": True,
            }
        },
        "contacts": {
            "seat": {"surface": f"{body}.{side}", "against": "socket", "friction": {"law": "coulomb", "mu": mu}}
        },
        "supports": supports,
        "loads": {"press": {"boundary": f"{body}.top", "pressure": 0.01}},
        "solver": {"tolerance": 1e-11},
    }  # fmt: skip
    simulation = prepare(from_dict(data))
    (step,) = simulation.steps()
    seat, P = step.contacts["seat"], 0.01 * simulation.system.weak.area(f"{body}.top")
    N = P / (np.sin(angle) + mu * np.cos(angle))
    assert_allclose(seat.force[-1], P, rtol=1e-8)  # the solver's 1e-11 and three digits to spare
    assert_allclose(seat.normal_force, N, rtol=1e-8)
    pressed = seat.pressure > 0
    assert 2 < pressed.sum() < 0.8 * len(pressed)  # around the ring where the ball touches
    (rows,) = simulation.system.contacts
    height = rows.surface.points[pressed, -1].mean()
    assert_allclose(height, radius * (1 - np.sin(angle)), atol=0.1)  # where a ball and a cone touch
    assert np.all(seat.status[pressed] == SLIP)
    assert np.all(seat.gap[~pressed] > -1e-9)


def test_a_blunt_cone_indents_a_half_space_as_love_says() -> None:
    """F = pi a² E* cot(theta) / 2, depth = pi a cot(theta) / 2, p = E* cot(theta) arcosh(a / r) / 2.

    Source: Love, Quart. J. Math. 10 (1939), 161-175; Sneddon, Int. J. Engng Sci. 3 (1965), 47-57.
    """
    E, nu, a, theta, cell = 1.0, 0.3, 1.0, np.radians(89.0), 0.025
    E_star, cot = E / (1 - nu**2), 1 / np.tan(theta)
    F, depth = np.pi * a**2 * E_star * cot / 2, np.pi * a * cot / 2
    assert_allclose(F, 2 / np.pi * E_star * depth**2 / cot, rtol=1e-14)
    data = {
        "model": "axisymmetric",
        "geometry": {
            "builder": "half_space", "size": 80.0, "contact_half_width": 1.5, "mesh_size": 16.0,
            "contact_mesh_size": cell, "symmetric": True, "order": 2,
        },
        "bodies": {"half_space": {"E": E, "nu": nu}},
        "obstacles": {
            "tip": {"shape": "cone", "apex": [0.0, 0.0], "axis": [0.0, 1.0], "half_angle": 89.0, "force": {"y": -F}}
        },
        "contacts": {"track": {"surface": "half_space.contact", "against": "tip"}},
        "supports": {"bottom": {"boundary": "half_space.bottom", "displacement": {"y": 0.0}}},
        "solver": {"tolerance": 1e-10},
    }  # fmt: skip
    simulation = prepare(from_dict(data))
    (step,) = simulation.steps()
    track, (rows,) = step.contacts["track"], simulation.system.contacts
    assert_allclose(track.force, [0.0, -F], atol=1e-8 * F)
    assert_allclose(track.normal_force, F / np.sin(theta), rtol=1e-6)  # all but the point of the tip, where it is F
    assert_allclose(np.sqrt(track.contact_area / np.pi), a, atol=cell)  # the edge lies somewhere in a cell
    # a half-space of 80 a gives less by a / (80 pi) = 0.4 %, and the linear theory has no slope: 0.2 % more
    assert_allclose(-step.obstacles["tip"][0][1], depth, rtol=0.012)
    r = rows.surface.points[:, 0]
    between = (r > 0.1) & (r < 0.9)  # at the tip the pressure is infinite, at the edge its slope
    mean = E_star * cot / 2
    assert_allclose(track.pressure[between] / mean, np.arccosh(a / r[between]), atol=0.03)  # found: 0.013


FRICTION = {"friction": {"law": "coulomb", "mu": 0.3}}
CONTACT = {"base": {"surface": "block.bottom", "against": "foundation"}}
LAWS: dict[str, dict[str, Any]] = {
    "unilateral": {"law": "unilateral"},
    "compliance": {"law": "compliance", "c_n": 30.0},
}


def driven(dim: int, **motion: Any) -> dict[str, Any]:
    """The foundation, moved."""
    return {"foundation": plane(dim) | motion}


def clamped(dim: int) -> dict[str, Any]:
    return {"top": {"boundary": "block.top", "displacement": dict.fromkeys("xyz"[:dim], 0.0)}}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("dim", "order"), [(2, 1), (2, 2), (3, 1)])
def test_a_force_moves_the_foundation_as_far_as_the_same_displacement_makes_that_force(
    dim: int, order: int, law: str
) -> None:
    up, slide = "xyz"[dim - 1], {"x": 0.03}
    tables = {"contacts": {"base": CONTACT["base"] | FRICTION | {"normal": LAWS[law]}}, "supports": clamped(dim)}
    tables |= {"solver": {"tolerance": 1e-12}}
    pushed = scene_of(dim, {"order": order}, obstacles=driven(dim, force={up: 0.2}, displacement=slide), **tables)
    (by_force,) = prepare(pushed).steps()
    moved, force, _ = by_force.obstacles["foundation"]
    assert_allclose(force[-1], 0.2, rtol=1e-12)
    assert moved[-1] > 0.01
    shifted = scene_of(dim, {"order": order}, obstacles=driven(dim, displacement=slide | {up: moved[-1]}), **tables)
    (by_shift,) = prepare(shifted).steps()
    assert_allclose(by_shift.contacts["base"].normal_force, 0.2, rtol=1e-9)
    assert_allclose(by_shift.displacement, by_force.displacement, atol=1e-9 * abs(by_force.displacement).max())
    energy = by_force.energy
    assert_allclose(energy.external, energy.stored + energy.contact, rtol=1e-10)


def test_a_sideways_force_beyond_friction_has_no_answer_and_one_below_it_has() -> None:
    tables = {"contacts": {"base": CONTACT["base"] | FRICTION}, "supports": clamped(2), "solver": {"tolerance": 1e-11}}
    held = scene_of(obstacles=driven(2, force={"y": 0.2, "x": 0.05}), **tables)
    (step,) = prepare(held).steps()
    assert_allclose(step.obstacles["foundation"][1], [0.05, 0.2], rtol=1e-10)
    assert step.obstacles["foundation"][0][0] > 0  # the way the force pushes
    from stickslip.solvers.stepping.stepper import StepError

    slips = scene_of(obstacles=driven(2, force={"y": 0.2, "x": 0.07}), **tables)  # 0.07 > 0.3 * 0.2
    with pytest.raises(StepError):
        list(prepare(slips).steps())


def test_a_turning_roller_drags_the_block() -> None:
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
    pressed, turned = prepare(scene).steps()
    pressing = pressed.contacts["base"]
    assert abs(pressing.force[0]) < 0.01 * pressing.normal_force  # symmetric but for the mesh's diagonals
    base = turned.contacts["base"]
    assert np.all(base.status[base.status != 0] == SLIP)  # 5 m * 0.01 is far beyond what sticks
    assert_allclose(base.tangential_force, 0.3 * base.normal_force, rtol=1e-3)  # the arc's slope: 0.2 at most, squared
    # friction acts 5 m from the roller's axis; the base of the block reaches (1 m / 5 m)^2 / 2 farther at most
    assert_allclose(turned.obstacles["foundation"][2], 5.0 * 0.3 * base.normal_force, rtol=0.02)
    assert base.force[0] < 0  # anticlockwise: the top of the roller moves to the left


@pytest.mark.parametrize("method", ["condensed-newton", "regularised"])
def test_an_obstacle_that_jumps_at_the_start_does_its_work_and_slips_then(method: str) -> None:
    contacts = {"base": CONTACT["base"] | {"friction": {"law": "coulomb", "mu": 0.1}}}
    jump = {"x": [[0, 0.1], [1, 0.1]], "y": [[0, 0.01], [1, 0.02]]}
    tables = {"contacts": contacts, "supports": clamped(2), "solver": {"method": method, "tolerance": 1e-10}}
    scene = scene_of(obstacles=driven(2, displacement=jump), **tables)
    for step in prepare(scene).steps():
        assert_allclose(step.energy.external, step.energy.stored + step.energy.contact, rtol=1e-10)
        base = step.contacts["base"]
        if step.time == 0:
            assert_allclose(base.slip_increment, base.slip, rtol=1e-12)
            assert np.all(base.status == SLIP)  # 0.1 m is far beyond what sticks


@pytest.mark.parametrize(
    ("load", "unit"), every_nth(2, [(1e-3, 0.0), (1e-3, 0.3), (1e-6, 0.3), (0.1, 0.3)], [1.0, 1e3])
)
def test_a_force_finds_where_a_pin_touches_its_wider_bore(load: tuple[float, float], unit: float) -> None:
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

    (pushed,) = prepare(scene(force={"y": -force * unit})).steps()
    moved = pushed.obstacles["pin"][0]
    assert moved[1] < -0.01 * unit  # through the clearance, and on into the ring
    assert_allclose(pushed.contacts["bore"].force[1], -force * unit, rtol=1e-9)
    (shifted,) = prepare(scene(displacement={"y": moved[1]})).steps()
    assert_allclose(shifted.contacts["bore"].force[1], -force * unit, rtol=1e-6)
    assert_allclose(shifted.displacement, pushed.displacement, atol=1e-7 * abs(pushed.displacement).max())
