"""Contact rows: what a pressure weighs, what a displacement opens, and who carries a multiplier."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from shared.cases import every_nth
from stickslip.solvers.contact.build import frames_of
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.interface.prepare import prepare_surface
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.system.system import System

Array = NDArray[np.float64]
SceneOf = Callable[..., Scene]
SystemOf = Callable[[Scene], System]
SHAPES: dict[str, tuple[int, dict[str, Any]]] = {
    "triangles": (2, {}),
    "graded triangles": (2, {"contact_mesh_size": 0.11}),
    "quadrilaterals": (2, {"cells": "tensor"}),
    "tetrahedra": (3, {}),
    "graded tetrahedra": (3, {"contact_mesh_size": 0.3}),
    "hexahedra": (3, {"cells": "tensor"}),
    "quadratic triangles": (2, {"order": 2}),
    "quadratic quadrilaterals": (2, {"cells": "tensor", "order": 2}),
    "quadratic tetrahedra": (3, {"order": 2}),
    "quadratic hexahedra": (3, {"cells": "tensor", "order": 2}),
}
LAWS: dict[str, dict[str, Any]] = {
    "unilateral": {"law": "unilateral"},
    "compliance 1": {"law": "compliance", "c_n": 7.0},
    "compliance 2.5": {"law": "compliance", "c_n": 7.0, "m_n": 2.5},
}
WALL = {"wall": {"shape": "plane", "point": [0.0, 0.0], "normal": [1.0, 0.0]}}
PERIODIC = {"sides": {"boundary": "block.right", "with": "block.left"}}


def contact(
    side: str = "bottom", against: str = "foundation", law: str = "unilateral", mu: float = 0.3
) -> dict[str, Any]:
    friction = {"friction": {"law": "coulomb", "mu": mu}}
    return {"surface": f"block.{side}", "against": against, "normal": LAWS[law]} | (friction if mu else {})


@pytest.mark.parametrize(("shape", "law"), every_nth(3, SHAPES, LAWS))
def test_uniform_tractions_have_the_exact_resultant_and_nodal_forces(
    shape: str, law: str, scene_of: SceneOf, system_of: SystemOf
) -> None:
    dim, geometry = SHAPES[shape]
    (rows,) = system_of(scene_of(dim, geometry, contacts={"base": contact(law=law)})).contacts
    n, size = len(rows.surface.nodes), 2.0  # 2 m (by 1 m)
    for weights in (rows.node_weights, rows.W_n, rows.W_t):
        assert_allclose(weights.sum(), size, rtol=1e-13)
        assert weights.min() > 0
    pressure, t = np.full(len(rows.W_n), 3.0), np.tile(np.arange(1.0, dim), (n, 1))
    forces = rows.nodal_forces(pressure, t)
    down = -np.eye(dim)[-1]  # outward normal of the bottom: B^T p is what the body does to the foundation
    tangents = rows.frames[0, 1:]
    assert_allclose(forces.sum(axis=0), size * (3.0 * down + np.arange(1.0, dim) @ tangents), rtol=1e-13, atol=1e-13)
    # ∫ phi~_j p ds, node by node: nothing but the lumped weights
    assert_allclose(rows.surface.forces_transform @ forces @ down, 3.0 * rows.node_weights, rtol=1e-12)
    centre = rows.node_weights @ rows.surface.points / size
    expected = np.array([1.0, 0.5, 0.0])[: dim - 1]
    assert_allclose(centre[: dim - 1], expected, rtol=1e-12)  # no moment about the middle
    assert_allclose(rows.node_pressure(pressure), 3.0, rtol=1e-12)
    assert_allclose(rows.average @ pressure, 3.0, rtol=1e-12)  # the pressure that friction sees


@pytest.mark.parametrize(("shape", "law"), every_nth(3, SHAPES, LAWS))
def test_friction_sees_the_normal_force_of_each_node(
    shape: str, law: str, scene_of: SceneOf, system_of: SystemOf
) -> None:
    """No pressure, however uneven, gives a negative mean, and the means add up to the normal force."""
    dim, geometry = SHAPES[shape]
    (rows,) = system_of(scene_of(dim, geometry, contacts={"base": contact(law=law)})).contacts
    assert rows.average.data.min() > -1e-15
    assert_allclose(rows.W_t @ rows.average, rows.W_n, rtol=1e-12)
    p_n = np.zeros(len(rows.W_n))
    p_n[:: len(p_n) // 5] = 3.0
    normal = rows.nodal_forces(p_n, np.zeros(rows.free.shape)) @ rows.normals[0]
    slides = np.zeros(rows.free.shape)
    slides[:, 0] = rows.average @ p_n
    tangential = rows.nodal_forces(np.zeros_like(p_n), slides) @ rows.tangents[0, 0]
    assert_allclose(tangential, normal, atol=1e-13)  # all slides one way: friction / mu, node by node of the body


@pytest.mark.parametrize(("shape", "law"), every_nth(3, SHAPES, LAWS))
def test_tractions_work_on_relative_displacement_as_nodal_forces_do(
    shape: str, law: str, scene_of: SceneOf, system_of: SystemOf
) -> None:
    dim, geometry = SHAPES[shape]
    (rows,) = system_of(scene_of(dim, geometry, contacts={"base": contact(law=law)})).contacts
    random = np.random.default_rng(0)
    u = random.normal(size=rows.surface.points.shape)
    p_n, t = random.normal(size=len(rows.W_n)), random.normal(size=rows.free.shape)
    on_points = (rows.N_n @ u.ravel()) @ (rows.W_n * p_n)
    on_points += (rows.N_t @ u.ravel()) @ (rows.W_t[:, None] * t).ravel()
    assert_allclose(np.sum(u * rows.nodal_forces(p_n, t)), on_points, rtol=1e-12)
    # and the node values shown to the user do the same work as the forces
    normal, tangential = rows.node_motion(u)
    shown = rows.node_weights @ (rows.node_traction(t) * tangential).sum(axis=1)
    assert_allclose(shown, (rows.N_t @ u.ravel()) @ (rows.W_t[:, None] * t).ravel(), rtol=1e-10)
    if law == "unilateral":
        shown = rows.node_weights @ (rows.node_pressure(p_n) * normal)
        assert_allclose(shown, (rows.N_n @ u.ravel()) @ (rows.W_n * p_n), rtol=1e-10)


@pytest.mark.parametrize("shape", SHAPES)
def test_frames_are_right_angled_and_look_at_the_obstacle(shape: str, scene_of: SceneOf, system_of: SystemOf) -> None:
    dim, geometry = SHAPES[shape]
    low = {
        "foundation": {
            "shape": "plane",
            "point": [0.0] * (dim - 1) + [-0.2],
            "normal": [0.1] + [0.0] * (dim - 2) + [2.0],
        }
    }
    scene = scene_of(dim, geometry, obstacles=low, contacts={"base": contact()})
    (rows,) = system_of(scene).contacts
    assert_allclose(
        rows.frames @ rows.frames.transpose(0, 2, 1), np.tile(np.eye(dim), (len(rows.frames), 1, 1)), atol=1e-15
    )
    normal = -np.array(low["foundation"]["normal"])
    assert_allclose(rows.frames[:, 0], np.tile(normal / np.linalg.norm(normal), (len(rows.frames), 1)), rtol=1e-15)
    # moving a node by the gap along its normal closes it
    moved = scene.obstacles["foundation"].signed_gap(rows.surface.points)[:, None] * rows.frames[:, 0]
    assert_allclose(rows.N_n @ moved.ravel(), rows.gap, rtol=1e-12)
    assert rows.gap.min() > 0.1


def carries_uniform_pressure(rows: ContactRows) -> None:
    """Shares add up to 1, and the load stays the uniform one, node by node."""
    forces = rows.nodal_forces(np.ones(len(rows.W_n)), np.zeros(rows.free.shape))
    forces = rows.surface.forces_transform @ forces
    normal = np.einsum("nd,nd->n", forces, rows.frames[:, 0])
    assert_allclose(normal, rows.node_weights, rtol=1e-12)
    assert_allclose(forces - normal[:, None] * rows.frames[:, 0], 0.0, atol=1e-14)
    assert_allclose(np.asarray(rows.share_t.sum(axis=0)).ravel(), 1.0, rtol=1e-14)
    assert_allclose([rows.W_n.sum(), rows.W_t.sum()], rows.node_weights.sum(), rtol=1e-13)


@pytest.mark.parametrize("shape", SHAPES)
def test_neighbours_take_over_where_the_normal_motion_is_prescribed(
    shape: str, scene_of: SceneOf, system_of: SystemOf
) -> None:
    dim, geometry = SHAPES[shape]
    hold = {"clamp": {"boundary": "block.left", "displacement": dict.fromkeys("xyz"[:dim], 0.0)}}
    (rows,) = system_of(scene_of(dim, geometry, contacts={"base": contact()}, supports=hold)).contacts
    held = np.isclose(rows.surface.points[:, 0], 0.0)
    assert len(rows.W_n) == len(rows.W_t) == (~held).sum()
    assert rows.dropped == 2 * held.sum()  # normal and tangential
    carries_uniform_pressure(rows)
    # taken over along the surface: by nodes of the next facet, not by far ones
    share = rows.share_t.toarray()
    receivers = share[:, held].sum(axis=1) > 0
    x = rows.surface.points[~held][receivers, 0]
    assert x.max() < 0.8
    # a side that is held in x only keeps its normal multipliers and loses its friction
    hold = {"clamp": {"boundary": "block.left", "displacement": {"x": 0.0}}}
    (rows,) = system_of(scene_of(dim, geometry, contacts={"base": contact()}, supports=hold)).contacts
    assert len(rows.W_n) == len(rows.surface.nodes)
    assert len(rows.W_t) == len(rows.surface.nodes) - (held.sum() if dim == 2 else 0)
    carries_uniform_pressure(rows)


def test_a_node_on_a_symmetry_plane_keeps_friction_along_the_plane(scene_of: SceneOf, system_of: SystemOf) -> None:
    symmetry = {"symmetry": {"boundary": "block.left", "displacement": {"normal": 0.0}}}
    (rows,) = system_of(scene_of(3, contacts={"base": contact()}, supports=symmetry)).contacts
    on_plane = np.isclose(rows.surface.points[:, 0], 0.0)
    assert_array_equal(rows.free.sum(axis=1), np.where(on_plane, 1, 2))
    N_t = rows.N_t.toarray().reshape(len(rows.W_t), 2, len(on_plane), 3)
    for j in np.flatnonzero(on_plane):
        assert_allclose(np.abs(N_t[j, 0, j]), [0.0, 1.0, 0.0], atol=1e-14)  # along y, of full length
        assert_array_equal(N_t[j, 1], 0.0)
    carries_uniform_pressure(rows)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_node_and_its_periodic_image_share_one_multiplier(dim: int, scene_of: SceneOf, system_of: SystemOf) -> None:
    system = system_of(scene_of(dim, contacts={"base": contact()}, periodic=PERIODIC))
    (rows,) = system.contacts
    x = rows.surface.points
    image = np.isclose(x[:, 0], 2.0)
    assert len(rows.W_n) == len(rows.W_t) == (~image).sum()
    assert_array_equal((rows.share_t.toarray() > 0).sum(axis=1), np.where(np.isclose(x[~image, 0], 0.0), 2, 1))
    carries_uniform_pressure(rows)


def full_row_rank(simulation: Simulation) -> tuple[int, int]:
    surface = simulation.stepper.surface
    B = surface.N.toarray()
    rank = int(np.linalg.matrix_rank(B[np.abs(B).max(axis=1) > 1e-12]))
    return rank, int((np.abs(B).max(axis=1) > 1e-12).sum())


def test_two_contacts_in_one_corner_ask_nothing_twice(
    scene_of: SceneOf, simulation_of: Callable[[Scene], Simulation]
) -> None:
    ground = {"foundation": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}}
    both = {"base": contact("bottom"), "side": contact("left", "wall")}
    simulation = simulation_of(scene_of(obstacles=ground | WALL, contacts=both))
    rank, rows = full_row_rank(simulation)
    assert rank == rows
    base, side = simulation.system.contacts
    # the corner's two displacements are held by the two pressures; nothing is left for friction there
    assert len(base.W_n) == len(base.surface.nodes)
    assert len(side.W_n) == len(side.surface.nodes)
    assert len(base.W_t) == len(base.surface.nodes) - 1
    assert len(side.W_t) == len(side.surface.nodes) - 1
    for rows_of in (base, side):
        assert rows_of.dropped == 1
        carries_uniform_pressure(rows_of)


def test_parallel_planes_on_adjoining_sides_do_not_hold_a_corner_twice(
    scene_of: SceneOf, simulation_of: Callable[[Scene], Simulation]
) -> None:
    # both obstacles face up and right: the corner of bottom and left has one normal motion for the two
    ground = {"foundation": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.1, 1.0]}}
    pit = {"wall": {"shape": "plane", "point": [0.0, -1.0], "normal": [0.2, 2.0]}}
    both = {"base": contact("bottom"), "side": contact("left", "wall", mu=0.0)}
    hold = {"lid": {"boundary": "block.top", "displacement": {"x": 0.0, "y": -0.1}}}
    simulation = simulation_of(scene_of(obstacles=ground | pit, contacts=both, supports=hold))
    rank, rows = full_row_rank(simulation)
    assert rank == rows
    base, side = simulation.system.contacts
    assert len(base.W_n) == len(base.surface.nodes)
    assert len(side.W_n) == len(side.surface.nodes) - 2  # the corner, and the held end at the top
    assert side.dropped == 2


@pytest.mark.parametrize("shape", ["graded triangles", "tetrahedra"])
def test_rows_on_the_contact_dofs_measure_what_rows_on_the_nodes_do(
    shape: str, scene_of: SceneOf, simulation_of: Callable[[Scene], Simulation]
) -> None:
    dim, geometry = SHAPES[shape]
    hold = {"clamp": {"boundary": "block.left", "displacement": {"x": 0.0}}}
    scene = scene_of(dim, geometry, contacts={"base": contact()}, supports=hold, periodic={})
    system = simulation_of(scene).system
    (rows,) = system.contacts
    surface = prepare_surface(system, simulation_of(scene).stepper.chain.volume)
    q = system.T.createVecRight()
    q.array[:] = np.random.default_rng(2).normal(size=q.getSize())
    (u,) = system.interface.displacement(system.T * q)
    expected = np.concatenate([rows.N_n @ u.ravel(), rows.N_t @ u.ravel()])
    assert_allclose(surface.N @ q.array[system.interface.dofs], expected, atol=1e-13)


def test_rounding_does_not_choose_the_frame() -> None:
    """At the pole of a ball two components of the normal are rounding, in other units another one."""
    pole, other = np.array([[1e-17, 3e-17, -1.0], [3e-17, -1e-17, -1.0]])
    assert_allclose(*frames_of(np.array([pole, other])), atol=1e-15)
