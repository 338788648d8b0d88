"""Rows of contact: their frames, weights, normals and couplings carry tractions over as nodal forces."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from shared.cases import every_nth
from shared.overlays import above, below
from shared.problems import plane, scene_of
from stickslip.geometry.arrays import Array
from stickslip.geometry.surfaces.overlap import overlap
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.contact.build import frames_of
from stickslip.solvers.contact.coupling import Facing
from stickslip.solvers.contact.mortar import _least, mortar_coupling, mortar_integrals
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.interface.prepare import prepare_surface
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.lab.verification.prepared import prepare, system_of
from stickslip.workflows.scene_file.read import from_dict, read

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


@cache
def rows_of(shape: str, law: str) -> ContactRows:
    """The contact of the block on its foundation."""
    dim, geometry = SHAPES[shape]
    (rows,) = system_of(scene_of(dim, geometry, contacts={"base": contact(law=law)})).contacts
    return rows


@pytest.mark.parametrize(("shape", "law"), every_nth(3, SHAPES, LAWS))
def test_uniform_tractions_have_the_exact_resultant_and_nodal_forces(shape: str, law: str) -> None:
    rows, dim = rows_of(shape, law), SHAPES[shape][0]
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
def test_friction_sees_the_force_of_each_node(shape: str, law: str) -> None:
    """No pressure, however uneven, gives a negative mean, and the means add up to the normal force."""
    rows = rows_of(shape, law)
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
def test_tractions_work_on_relative_displacement_as_nodal_forces_do(shape: str, law: str) -> None:
    rows = rows_of(shape, law)
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
def test_frames_are_right_angled_and_look_at_the_obstacle(shape: str) -> None:
    dim, geometry = SHAPES[shape]
    low = {"foundation": plane(dim) | {"point": [0.0] * (dim - 1) + [-0.2], "normal": [0.1, *[0.0] * (dim - 2), 2.0]}}
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
def test_neighbours_take_over_where_motion_is_prescribed(shape: str) -> None:
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


def test_a_node_on_a_symmetry_plane_keeps_friction_along_the_plane() -> None:
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
def test_a_node_and_its_periodic_image_share_one_multiplier(dim: int) -> None:
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


def test_two_contacts_in_one_corner_ask_nothing_twice() -> None:
    ground = {"foundation": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}}
    both = {"base": contact("bottom"), "side": contact("left", "wall")}
    simulation = prepare(scene_of(obstacles=ground | WALL, contacts=both))
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


def test_parallel_planes_on_adjoining_sides_hold_a_corner_once() -> None:
    # both obstacles face up and right: the corner of bottom and left has one normal motion for the two
    ground = {"foundation": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.1, 1.0]}}
    pit = {"wall": {"shape": "plane", "point": [0.0, -1.0], "normal": [0.2, 2.0]}}
    both = {"base": contact("bottom"), "side": contact("left", "wall", mu=0.0)}
    hold = {"lid": {"boundary": "block.top", "displacement": {"x": 0.0, "y": -0.1}}}
    simulation = prepare(scene_of(obstacles=ground | pit, contacts=both, supports=hold))
    rank, rows = full_row_rank(simulation)
    assert rank == rows
    base, side = simulation.system.contacts
    assert len(base.W_n) == len(base.surface.nodes)
    assert len(side.W_n) == len(side.surface.nodes) - 2  # the corner, and the held end at the top
    assert side.dropped == 2


@pytest.mark.parametrize("shape", ["graded triangles", "tetrahedra"])
def test_rows_on_the_contact_dofs_measure_what_rows_on_the_nodes_do(shape: str) -> None:
    dim, geometry = SHAPES[shape]
    hold = {"clamp": {"boundary": "block.left", "displacement": {"x": 0.0}}}
    scene = scene_of(dim, geometry, contacts={"base": contact()}, supports=hold, periodic={})
    system = prepare(scene).system
    (rows,) = system.contacts
    surface = prepare_surface(system, prepare(scene).stepper.chain.volume)
    q = system.T.createVecRight()
    q.array[:] = np.random.default_rng(2).normal(size=q.getSize())
    (u,) = system.interface.displacement(system.T * q)
    expected = np.concatenate([rows.N_n @ u.ravel(), rows.N_t @ u.ravel()])
    assert_allclose(surface.N @ q.array[system.interface.dofs], expected, atol=1e-13)


def test_rounding_does_not_choose_the_frame() -> None:
    """At the pole of a ball two components of the normal are rounding, in other units another one."""
    pole, other = np.array([[1e-17, 3e-17, -1.0], [3e-17, -1e-17, -1.0]])
    assert_allclose(*frames_of(np.array([pole, other])), atol=1e-15)


FACES: dict[str, dict[str, Any]] = {
    "unilateral": {"law": "unilateral"},
    "compliance": {"law": "compliance", "c_n": 9.0},
}


def rows(slave: str, master: str, operator: str, law: str, order: int = 1) -> ContactRows:
    """The contact of two cylinders of radius 1."""
    data = {
        "model": "plane strain",
        "geometry": {
            "builder": "cylinders", "radius": 1.0, "mesh_size": 0.2, "contact_mesh_size": 0.05, "order": order,
        },
        "bodies": {body: {"E": 1.0, "nu": 0.3} for body in ("upper", "lower")},
        "contacts": {
            "face": {
                "surface": f"{slave}.arc", "against": f"{master}.arc", "normal": FACES[law], "operator": operator,
                "friction": {"law": "coulomb", "mu": 0.3},
            }
        },
        "supports": {
            "top": {"boundary": "upper.top", "displacement": {"x": 0.0, "y": -0.01}},
            "base": {"boundary": "lower.base", "displacement": {"x": 0.0, "y": 0.0}},
        },
    }  # fmt: skip
    (found,) = system_of(from_dict(data)).contacts
    return found


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("operator", ["mortar", "node-to-segment"])
@pytest.mark.parametrize(("slave", "master", "sign"), [("upper", "lower", -1), ("lower", "upper", 1)])
def test_normals_of_equal_cylinders_are_those_of_the_plane_between_them(
    slave: str, master: str, sign: int, operator: str, order: int
) -> None:
    found = rows(slave, master, operator, "unilateral", order)
    x = found.surface.points[:, 0]
    near = (np.abs(x) > 0.02) & (np.abs(x) < 0.2)
    normals = found.frames[near, 0]
    # own normals lean by x; the partner along them is farther out by gap * x = x³
    assert np.all(np.abs(normals[:, 0]) <= 0.6 * np.abs(x[near]) ** 3 + 1e-4)
    assert_allclose(normals[:, 1], sign, rtol=1e-4)
    assert_allclose(
        found.node_gap[near], x[near] ** 2, rtol=0.1 if order == 1 else 0.04, atol=1e-3
    )  # 2 (1 - cos) but for facets


def test_points_of_a_compliance_have_those_normals_too() -> None:
    found = rows("upper", "lower", "mortar", "compliance")
    n = found.surface.points.shape[0]
    basis = found.N_n[:, 1 : 2 * n : 2]  # times the normals' y, of which the mean has no need
    x = basis @ found.surface.points[:, 0] / np.asarray(basis.sum(axis=1)).ravel()
    across = np.asarray(found.N_n[:, : 2 * n : 2].sum(axis=1)).ravel()  # normal part of a motion of the slave along x
    near = np.abs(x) < 0.15
    assert near.sum() > 5
    assert np.abs(across[near]).max() <= 0.01  # its own would be 0.15


def test_friction_on_a_symmetry_plane_acts_within_it() -> None:
    """Averaged normals at the edge of a quarter lean out of it: pressing alone would count as sliding."""
    found = quarter()
    points, normals = found.surface.points, found.frames[:, 0]
    facing = (found.node_weights > 0) & (np.linalg.norm(points[:, :2], axis=1) < 0.2)
    for axis in (0, 1):
        on = facing & (np.abs(points[:, axis]) < 1e-12)
        assert on.sum() > 2
        assert_allclose(normals[on, axis], 0, atol=1e-12)
    # on a plane one direction is left, inside both, at the pole none
    own = found.share_t.tocsc()[:, facing & (points[:, 0] > 1e-12) & (points[:, 1] > 1e-12)]
    assert np.all(found.free[own.indices].sum(axis=1) == 2)
    edge = found.share_t.tocsc()[:, facing & (np.abs(points[:, 0]) < 1e-12) & (points[:, 1] > 1e-12)]
    assert np.all(found.free[edge.indices].sum(axis=1) == 1)


def quarter() -> ContactRows:
    """The contact of a quarter of two balls."""
    planes = {"x_plane": {"x": 0.0}, "y_plane": {"y": 0.0}}
    held = {f"{b}_{p}": {"boundary": f"{b}.{p}", "displacement": planes[p]} for b in ("upper", "lower") for p in planes}
    data = {
        "model": "3d",
        "geometry": {
            "builder": "spheres", "radius": 1.0, "lower_radius": 1.5, "symmetry": "quarter", "mesh_size": 0.5,
            "contact_mesh_size": 0.06, "contact_radius": 0.2,
        },
        "bodies": {body: {"E": 1.0, "nu": 0.3} for body in ("upper", "lower")},
        "contacts": {
            "face": {"surface": "lower.cap", "against": "upper.cap", "friction": {"law": "coulomb", "mu": 0.3}}
        },
        "supports": held | {
            "top": {"boundary": "upper.top", "displacement": {"z": -0.01}},
            "base": {"boundary": "lower.base", "displacement": {"z": 0.0}},
        },
    }  # fmt: skip
    (found,) = system_of(from_dict(data)).contacts
    return found


def test_a_node_of_which_little_faces_the_master_presses_nothing() -> None:
    # at the rim of what faces the other ball its gap is extrapolated: it pressed a million times as hard as the pole
    sizes = ["geometry.mesh_size=0.75", "geometry.lower_mesh_size=0.9", "geometry.contact_mesh_size=0.075"]
    simulation = prepare(read("spheres", [*sizes, "geometry.order=1", "steps.count=2"]))
    (rows,) = simulation.system.contacts
    assert rows.node_gap[rows.node_weights > 0].min() > -1e-3  # straight facets of .075 m cut the balls by h^2 / 8 R
    *_, step = simulation.steps()
    pole = step.contacts["pole"]
    far = np.linalg.norm(rows.surface.points[:, :2], axis=1) > 0.4
    assert far.any()
    assert not pole.pressure[far].any()
    assert 0.001 < pole.normal_force < 0.01


def test_nodes_far_beyond_the_part_that_faces_the_master_press_nothing() -> None:
    # a tenth of the outermost facets is covered: their midside nodes weigh 3 % of their own weights, but what they see
    # is extrapolated over half a facet, a gap of -8 m where all is apart
    sizes = ["geometry.mesh_size=2", "geometry.lower_mesh_size=2.74", "geometry.contact_mesh_size=0.1"]
    simulation = prepare(read("cylinders", sizes))
    (rows,) = simulation.system.contacts
    assert rows.gap.min() > -1e-12
    assert rows.node_gap.min() > -1e-12
    *_, step = simulation.steps()
    line = step.contacts["line"]
    assert not line.pressure[np.abs(rows.surface.points[:, 0]) > 1.0].any()  # half the width of contact is 0.68
    assert_allclose(line.normal_force, 10.0, rtol=0.01)  # as on the scene's own mesh


def test_a_rim_that_the_master_faces_in_part_weighs_what_is_faced() -> None:
    # of the outermost facets a tenth is faced, by which their outer corners would weigh -0.004 m
    simulation = prepare(read("cylinders", ["geometry.contact_mesh_size=0.4"]))
    (rows,) = simulation.system.contacts
    for weights in (rows.W_n, rows.W_t, rows.node_weights[rows.node_weights != 0]):
        assert weights.min() > 0.1
        assert_allclose(weights.sum(), rows.W_n.sum(), rtol=1e-12)


@pytest.mark.parametrize(("shape", "degree"), [("interval", 2), ("triangle", 2), ("quadrilateral", 1)])
def test_nodes_carry_on_whole_facets_and_up_to_an_edge_near_by(shape: str, degree: int) -> None:
    for edge in (1.0, 0.95):  # of the second of two facets nine tenths are covered
        found = mortar_coupling(Facing(below(shape, degree, (2, 2)), _up_to(shape, edge), 0.5))
        assert found.carries.all()


@pytest.mark.parametrize("shape", ["interval", "quadrilateral"])
def test_nodes_that_only_extrapolation_reaches_carry_nothing(shape: str) -> None:
    # a tenth of the last facet is covered: 0.028 of its midside node's weight, which its weight alone would not tell
    slave = below(shape, 2, (2, 2))
    master = _up_to(shape, 0.55)
    found = mortar_coupling(Facing(slave, master, 0.5))
    beyond = (slave.points[:, :-1] > 0.7).any(axis=1)
    assert (_integrals(slave, master)[beyond] > 0.01 * slave.node_weights()[beyond]).any()
    assert_array_equal(found.carries, ~beyond)


def test_a_corner_that_two_extrapolations_reach_carries_nothing() -> None:
    # phi = (1 - x)(1 - 2 x) has no less than -1/24 over half a facet: in two directions at once its weight is positive
    slave = below("quadrilateral", 2, (1, 1))
    master = _up_to("quadrilateral", 0.5)
    found = mortar_coupling(Facing(slave, master, 0.5))
    corner = slave.points[:, :-1].min(axis=1) == 1
    assert _integrals(slave, master)[corner] > 0.01 * slave.node_weights()[corner]
    assert not found.carries[corner].any()


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("shape", ["interval", "triangle", "quadrilateral"])
def test_a_spot_inside_a_facet_has_one_multiplier(shape: str, degree: int) -> None:
    slave, spot = below(shape, degree, (2, 2)), np.array([0.1, 0.11])
    found = mortar_coupling(Facing(slave, above(shape, 1, (1, 1), box=(spot, spot + 0.01)), 0.5))
    assert found.carries.sum() == 1  # for all of the facet: what the nodes see is extrapolated, their mean is not
    assert_allclose(found.gap[found.carries], 0.1)  # not an extrapolated one


@pytest.mark.parametrize("low", [0.4, 0.6, 0.65])
def test_a_round_side_that_faces_part_of_a_facet_turns_no_normal_round(low: float) -> None:
    """Its normals, extrapolated to the far end of the facet, are those of a side that is averted."""

    def bend(x: Array) -> Array:
        angle = np.radians(85) * (x[:, 0] - low) / 0.2
        return np.column_stack([low + 0.2 * np.sin(angle), 0.5 - 0.2 * np.cos(angle)])

    master = above("interval", 1, (8, 1), bend, ((low,), (low + 0.2,)))
    found = mortar_coupling(Facing(below("interval", 1, (1, 1)), master, 1.0))
    assert_allclose(found.weights.sum(), 0.2, rtol=0.01)
    assert (found.normals[found.carries, 1] > 0.8).all()
    assert found.gap[found.carries].min() > 0.2  # it was .01: all points are .3 apart


def test_of_nodes_that_differ_by_rounding_the_first_has_the_least() -> None:
    slave, random = below("quadrilateral", 2, (1, 1)), np.random.default_rng(1)
    for _ in range(20):
        values = 3.0 * (1 + 1e-15 * random.integers(-2, 3, len(slave.nodes)))
        assert_array_equal(np.flatnonzero(_least(slave, values)), [0])
    values[4], values[0] = 2.9, np.inf
    assert_array_equal(np.flatnonzero(_least(slave, values)), [4])


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("shape", ["interval", "triangle", "quadrilateral"])
@pytest.mark.parametrize("edge", [0.51, 0.55, 0.6, 0.75, 0.9, 0.99])
def test_no_node_of_a_partly_faced_rim_weighs_less_than_nothing(shape: str, degree: int, edge: float) -> None:
    slave, master = below(shape, degree, (2, 2)), _up_to(shape, edge)
    found = mortar_coupling(Facing(slave, master, 0.5))
    assert_array_equal(found.weights > 0, found.carries)
    assert found.weights.min() >= 0
    assert_allclose(found.weights.sum(), edge ** (slave.dim - 1), rtol=1e-12)  # of 1 x 1, what the master faces
    # a unit pressure: its forces on either side are as large
    n = len(slave.points)
    forces = found.relative.T @ found.weights
    assert_allclose([forces[:n].sum(), forces[n:].sum()], [found.weights.sum(), -found.weights.sum()], rtol=1e-12)
    # a motion that is linear is none between the bodies, whoever stands for whom
    slope = np.arange(1.0, slave.dim)
    moved = np.concatenate([surface.points[:, :-1] @ slope + 3.0 for surface in (slave, master)])
    assert_allclose(found.relative @ moved, 0, atol=1e-9)
    assert_allclose(found.gap[found.carries], 0.1, rtol=1e-9)


def _integrals(slave: Surface, master: Surface) -> Any:
    """What nodes weigh before anything is handed over (n,)."""
    return mortar_integrals(slave, master, overlap(slave, master, 0.5, 8))[0]


def _up_to(shape: str, edge: float) -> Surface:
    """A flat master that ends at `edge` in each direction."""
    return above(shape, 1, (1, 1), box=((-1.0, -1.0), (edge, edge)))


def polyline(points: list[tuple[float, float]]) -> Surface:
    """Walked with the body to the right: outward is to the left."""
    number = np.arange(len(points))
    facets = np.column_stack([number[:-1], number[1:]])
    return Surface("interval", 1, number, number, np.array(points), facets, -np.ones(len(facets)), axisymmetric=False)
