"""Supports and periodic sides: what is prescribed holds for every free displacement, and nothing else is held."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from shared.matrices import dense, whole
from shared.problems import SceneOf, SimulationOf, SystemOf
from stickslip.geometry.arrays import Array, cross
from stickslip.geometry.errors import SceneError
from stickslip.geometry.surfaces.surface import Surface, gather_surface
from stickslip.solvers.fem.constraints import Components, Constraints
from stickslip.solvers.fem.rigid_fields import rigid_fields
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.system.stiffness import Stiffness
from stickslip.solvers.system.system import System
from stickslip.workflows.scene_file.read import from_dict

AXES = {"x": 0, "y": 1, "z": 2}
SIDES = {"periodic": {"sides": {"boundary": "block.right", "with": "block.left"}}}


def support(side: str, **displacement: Any) -> dict[str, Any]:
    return {"boundary": f"block.{side}", "displacement": displacement}


def surface(system: System, side: str) -> Surface:
    return gather_surface(system.mesh, system.space, system.nodes, side)


def free_columns(T: Any) -> Array:
    """T without the zero columns of eliminated numbers."""
    found = dense(T)
    return found[:, found.any(axis=0)]


def any_displacement(system: System, time: float) -> Array:
    """T q + u_s for random q, by node (n, d)."""
    T = dense(system.T)
    q = np.random.default_rng(3).normal(size=T.shape[1])
    u = T @ q + system.prescribed(time).array
    return np.asarray(u.reshape(-1, system.mesh.dim))


def holding(of: Constraints, held: Mapping[int, str], rows: Mapping[str, tuple[Any, float]]) -> Constraints:
    """The same mesh with other supports, each one letter with a direction and a value, at some nodes."""
    at = [(node, name) for node, names in held.items() for name in names]
    nodes, index = np.array([node for node, _ in at]), np.array([[*rows].index(name) for _, name in at])
    components = Components(
        node=nodes,
        directions=np.array([rows[name][0] for _, name in at]),
        drive=index,
        support=index,
        points=of.nodes.points[nodes],
    )
    drives = tuple(value for _, value in rows.values())
    return replace(of, drives=drives, supports=tuple(rows), components=components)


CASES: dict[str, tuple[int, dict[str, Any]]] = {
    "free": (2, {}),
    "one side": (2, {"supports": {"top": support("top", x=0.3, y=-0.1)}}),
    "corner from two sides": (2, {"supports": {"top": support("top", y=-0.1), "left": support("left", x=0.2)}}),
    "normal on two sides": (2, {"supports": {"a": support("left", normal=0.1), "b": support("bottom", normal=-0.2)}}),
    "one corner twice": (2, {"supports": {"top": support("top", x=0.1), "left": support("left", normal=-0.1)}}),
    "periodic": (2, SIDES),
    "periodic, held": (2, SIDES | {"supports": {"top": support("top", x=0.1, y=0.2), "base": support("bottom", y=0)}}),
    "3d edge": (3, {"supports": {"left": support("left", normal=0.1), "front": support("front", y=0.3)}}),
    "3d corner": (
        3, {"supports": {"a": support("left", x=0.1), "b": support("front", normal=0.3), "c": support("bottom", z=1)}},
    ),
    "3d periodic both ways": (
        3,
        {
            "periodic": SIDES["periodic"] | {"depth": {"boundary": "block.back", "with": "block.front"}},
            "supports": {"top": support("top", x=0.1, z=-0.2)},
        },
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_every_free_displacement_fulfils_what_is_prescribed(case: str, scene_of: SceneOf, system_of: SystemOf) -> None:
    dim, tables = CASES[case]
    scene = scene_of(dim, **tables)
    system = system_of(scene)
    T = free_columns(system.T)
    assert T.shape[1] == system.constraints.free_total
    assert_allclose(T.T @ T, np.eye(T.shape[1]) * (T * T).sum(axis=0), atol=1e-14)  # no two free numbers mix
    if "periodic" not in tables:
        assert_allclose(T.T @ T, np.eye(T.shape[1]), atol=1e-14)
    for time in (0.5, 1.0):
        u = any_displacement(system, time)
        for held in scene.supports.values():
            side = surface(system, str(held.boundary))
            for axis, value in held.displacement.items():
                direction = side.node_normals()[0] if axis == "normal" else np.eye(dim)[AXES[axis]]
                assert_allclose(u[side.nodes] @ direction, float(value) * time, atol=1e-14)  # type: ignore[arg-type]
        for slave_side, master_side in scene.request().periodic:
            slave, master = surface(system, slave_side), surface(system, master_side)
            shift = master.points.mean(axis=0) - slave.points.mean(axis=0)
            distance = np.linalg.norm(slave.points[:, None] + shift - master.points, axis=2)
            assert distance.min(axis=1).max() < 1e-12
            assert_array_equal(u[slave.nodes], u[master.nodes[distance.argmin(axis=1)]])


def test_stiffness_of_the_free_displacements_is_selected_or_transformed_alike(
    scene_of: SceneOf, system_of: SystemOf
) -> None:
    selecting = {case: system_of(scene_of(dim, **tables)) for case, (dim, tables) in CASES.items()}
    free = selecting["free"]
    inclined = holding(free.constraints, {4: "a", 9: "a"}, {"a": ([0.6, 0.8], 0.3)})
    T = inclined.transformation()
    both = Stiffness.of(whole(free), T, inclined)
    selecting["inclined"] = replace(free, constraints=inclined, T=T, assembled=lambda: both)
    for case, system in selecting.items():
        assert system.constraints.selects == ("periodic" not in case and case != "inclined"), case
        T, gone = dense(system.T), system.constraints.eliminated()
        expected = T.T @ dense(whole(system)) @ T
        assert not expected[gone].any()
        assert not expected[:, gone].any()
        expected[gone, gone] = expected.trace() / system.constraints.free_total
        assert_allclose(dense(system.K_B), expected, atol=1e-14 * np.abs(expected).max(), err_msg=case)
        assert system.K_B.getBlockSize() == system.mesh.dim


def test_nothing_more_than_what_is_prescribed_is_held(scene_of: SceneOf, system_of: SystemOf) -> None:
    # 9 x 5 nodes, 9 of them on top: x and y there, and the periodic image of the lower four on the right
    everywhere = 2 * 9 * 5
    free = {case: system_of(scene_of(2, **CASES[case][1])).constraints.free_total for case in list(CASES)[:6]}
    assert free["free"] == everywhere
    assert free["one side"] == everywhere - 2 * 9
    assert free["corner from two sides"] == free["normal on two sides"] == everywhere - 9 - 5
    assert free["one corner twice"] == everywhere - 9 - 5 + 1  # both hold x in the corner
    assert free["periodic"] == everywhere - 2 * 5


def test_an_inclined_direction_is_held_and_the_other_is_free(scene_of: SceneOf, system_of: SystemOf) -> None:
    system = system_of(scene_of(3))
    directions = np.array([[1.0, 2.0, 2.0], [0.0, 3.0, 4.0]]) / np.array([[3.0], [5.0]])
    rows = {"a": (directions[0], 0.3), "b": (directions[1], -0.1)}
    inclined = holding(system.constraints, {4: "a", 9: "ab"}, rows)
    T = free_columns(inclined.transformation())
    assert inclined.free_total == 3 * system.nodes.total - 3 == T.shape[1]
    assert_allclose(T.T @ T, np.eye(T.shape[1]), atol=1e-14)
    u = (T @ np.random.default_rng(5).normal(size=T.shape[1])).reshape(-1, 3)
    u[inclined.prescribed_nodes] += inclined.prescribed(1.0)
    assert_allclose([u[4] @ directions[0], u[9] @ directions[0], u[9] @ directions[1]], [0.3, 0.3, -0.1], atol=1e-14)
    # a force along what holds is shared among those that hold, with nothing left over
    force = np.zeros((system.nodes.owned, 3))
    force[[4, 9]] = 0.7 * directions[0], -0.2 * directions[0] + 1.1 * directions[1]
    shares = inclined.reactions(force)
    assert_allclose(shares["a"][0], 0.5 * directions[0], atol=1e-14)
    assert_allclose(shares["b"][0], 1.1 * directions[1], atol=1e-14)


def test_supports_that_contradict_are_refused_by_name(scene_of: SceneOf, system_of: SystemOf) -> None:
    at_corner = {"lid": support("top", y=-0.1), "wall": support("left", y=0.0)}
    with pytest.raises(
        SceneError, match=r"supports\.lid and supports\.wall: contradict each other at the point \(0, 1\)"
    ):
        system_of(scene_of(supports=at_corner))
    later = {"lid": support("top", y=[[0, 0], [1, 0], [2, -0.1]]), "wall": support("left", y=0.0)}
    steps = {"end": 2.0, "count": 4}
    with pytest.raises(SceneError, match=r"supports\.lid and supports\.wall: .* at t = 1\.5"):
        system_of(scene_of(supports=later, steps=steps))
    images = SIDES | {"supports": {"one": support("left", x=0.1), "other": support("right", x=0.2)}}
    with pytest.raises(SceneError, match=r"supports\.one and supports\.other: contradict"):
        system_of(scene_of(**images))


def test_a_point_support_away_from_every_vertex_is_refused(scene_of: SceneOf, system_of: SystemOf) -> None:
    pin = {"pin": {"point": [0.01, 0.0], "displacement": {"x": 0.0}}}
    with pytest.raises(SceneError, match=r"supports\.pin\.point = \[0\.01, 0\.0\]: .* the nearest is \(0, 0\)"):
        system_of(scene_of(supports=pin))


MOTIONS: list[tuple[int, dict[str, Any], int, str]] = [
    (2, {}, 3, "free"),
    (3, {}, 6, "free"),
    (2, {"a": support("left", x=0.0, y=0.0)}, 0, "one side held"),
    (3, {"a": support("left", x=0.0, y=0.0, z=0.0)}, 0, "one side held"),
    (2, {"a": support("left", x=0.0)}, 1, "slides along y"),
    (2, {"a": support("left", y=0.0)}, 2, "slides along x, and turns about the side: its points then move along x"),
    (2, {"a": {"point": [0.0, 0.0], "displacement": {"x": 0.0, "y": 0.0}}}, 1, "turns about the pin"),
    (3, {"a": support("bottom", z=0.0)}, 3, "slides in the plane and turns about z"),
    (3, {"a": support("bottom", z=0.0), "b": support("left", x=0.0)}, 1, "slides along y"),
    (3, {"a": {"point": [0.0, 0.0, 0.0], "displacement": {"x": 0.0, "y": 0.0, "z": 0.0}}}, 3, "turns about the pin"),
]


@pytest.mark.parametrize(("dim", "supports", "count", "why"), MOTIONS)
def test_rigid_motions_left_free_are_counted(
    dim: int, supports: Mapping[str, Any], count: int, why: str, scene_of: SceneOf, system_of: SystemOf
) -> None:
    system = system_of(scene_of(dim, supports=supports))
    low, high = system.mesh.box()
    motions = system.lifting.unresisted
    assert motions.shape[1] == count, why
    # each is a displacement without strain that the supports allow
    points = system.nodes.points[np.argsort(system.nodes.number)]
    fields = rigid_fields(points, (low + high) / 2, float(np.max(high - low)), axisymmetric=False) @ motions
    T = dense(system.T)
    for field in np.moveaxis(fields, 2, 0):
        assert_allclose(T @ (T.T @ field.ravel()), field.ravel(), atol=1e-12)
        K_u = dense(whole(system)) @ field.ravel()
        assert np.abs(K_u).max() < 1e-12 * np.abs(dense(whole(system))).max()


def test_a_prescribed_rigid_motion_follows_the_time_and_whoever_changes_its_values(
    scene_of: SceneOf, system_of: SystemOf
) -> None:
    system = system_of(scene_of(supports={"top": support("top", x=0.3, y=-0.1)}))
    other = scene_of(supports={"top": support("top", x=0.6, y=-0.1)}).timeline()
    (place,) = (place for place, value in other.amplitudes.items() if value == 0.6)

    def along_x(time: float) -> float:
        motion = system.rigid_motion(time)
        assert motion is not None
        return float(motion[0, 0])

    assert [along_x(1.0), along_x(0.5), along_x(1.0)] == pytest.approx([0.3, 0.15, 0.3])
    with system.course.following(other):
        assert along_x(1.0) == pytest.approx(0.6)
    assert along_x(1.0) == pytest.approx(0.3)
    system.course.found = {place: 0.9}
    assert along_x(1.0) == pytest.approx(0.9)


def test_a_periodic_block_moves_but_does_not_turn(scene_of: SceneOf, system_of: SystemOf) -> None:
    system = system_of(scene_of(**SIDES))
    motions = system.lifting.unresisted
    assert motions.shape[1] == 2
    assert_allclose(motions[2], 0.0, atol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_reactions_contact_and_loads_balance(dim: int, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    pull = {"x": 0.02, "y": -0.05} if dim == 2 else {"x": 0.02, "y": 0.01, "z": -0.05}
    wall = {} if dim == 2 else {"wall": support("left", normal=-0.02)}  # shares an edge with the top
    scene = scene_of(
        dim,
        contacts={"base": {"surface": "block.bottom", "against": "foundation", "friction": {"law": "stick"}}},
        supports={"top": support("top", **pull)} | wall,
        loads={"push": {"boundary": "block.right", "traction": [0.01, -0.02] + [0.005] * (dim - 2)}},
    )
    simulation = simulation_of(scene)
    (step,) = simulation.steps()
    load = simulation.system.load(1.0).array.reshape(-1, dim)
    points = simulation.system.nodes.points
    contact = step.contacts["base"]
    force = load.sum(axis=0) + contact.force + sum(f for f, _ in step.supports.values())
    moment = np.atleast_1d(cross(points, load).sum(axis=0)) + contact.moment
    moment = moment + sum(m for _, m in step.supports.values())
    largest = max(float(np.linalg.norm(f)) for f, _ in step.supports.values())
    assert contact.normal_force > 0.01
    assert largest > 0.01
    assert_allclose(force, 0.0, atol=1e-12 * largest)  # a direct solve
    assert_allclose(moment, 0.0, atol=1e-12 * largest)


TWO_BLOCKS = """
For k In {0:1}
  For c In {0:3}
    Point(10*k+c+1) = {2*k + (c == 1 || c == 2), (c > 1)/2, 0};
  EndFor
  For c In {0:3}
    Line(10*k+c+1) = {10*k+c+1, 10*k+(c+1)%4+1};
  EndFor
  Curve Loop(k+1) = {10*k+1, 10*k+2, 10*k+3, 10*k+4};
  Plane Surface(k+1) = {k+1};
EndFor
Physical Surface("a") = {1}; Physical Curve("a.bottom") = {1}; Physical Curve("a.top") = {3};
Physical Surface("b") = {2}; Physical Curve("b.bottom") = {11}; Physical Curve("b.top") = {13};
"""


def two_blocks(folder: Path, *held: str) -> Scene:
    """Two blocks side by side on one foundation; those that are held are pressed down by 0.01 m."""
    (folder / "two.geo").write_text(TWO_BLOCKS)
    contact = {"against": "foundation", "friction": {"law": "stick"}}
    push = {"x": 0.0, "y": -0.01}
    return from_dict(
        {
            "model": "plane strain",
            "geometry": {"file": "two.geo", "mesh_size": 0.2},
            "bodies": {"a": {"E": 1.0, "nu": 0.3}, "b": {"E": 2.0, "nu": 0.3}},
            "obstacles": {"foundation": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
            "contacts": {name: {"surface": f"{name}.bottom"} | contact for name in "ab"},
            "supports": {name: {"boundary": f"{name}.top", "displacement": push} for name in held},
        },
        folder,
    )


def test_each_part_of_a_mesh_that_falls_apart_is_held_by_its_own(tmp_path: Path, simulation_of: SimulationOf) -> None:
    (step,) = simulation_of(two_blocks(tmp_path, "a", "b")).steps()
    a, b = (step.contacts[name].normal_force for name in "ab")
    assert_allclose(b, 2 * a, rtol=0.02)  # the same block of a material twice as stiff; their meshes differ
    # contact alone holds the other one, and nothing loads it
    (step,) = simulation_of(two_blocks(tmp_path, "a")).steps()
    assert_allclose(step.contacts["a"].normal_force, a, rtol=1e-7)
    assert abs(step.contacts["b"].normal_force) < 1e-9 * a
    # without contact it is loose
    loose = two_blocks(tmp_path, "a")
    with pytest.raises(SceneError, match=r"nothing resists the .* of bodies\.b"):
        make_plan(replace(loose, contacts={"a": loose.contacts["a"]}))
