"""Couplings of two bodies, whatever the operator: no side is preferred."""

from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_allclose, assert_array_equal

from shared.overlays import above, below
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.geometry.surfaces.overlap import overlap
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.contact.mortar import _least, mortar_coupling, mortar_integrals
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.system.system import assemble
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict, read

LAWS: dict[str, dict[str, Any]] = {"unilateral": {"law": "unilateral"}, "compliance": {"law": "compliance", "c_n": 9.0}}


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
                "surface": f"{slave}.arc", "against": f"{master}.arc", "normal": LAWS[law], "operator": operator,
                "friction": {"law": "coulomb", "mu": 0.3},
            }
        },
        "supports": {
            "top": {"boundary": "upper.top", "displacement": {"x": 0.0, "y": -0.01}},
            "base": {"boundary": "lower.base", "displacement": {"x": 0.0, "y": 0.0}},
        },
    }  # fmt: skip
    scene = from_dict(data)
    (found,) = assemble(resolve(scene), build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF), Counters()).contacts
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
    assert near.sum() > 10
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
    scene = from_dict(data)
    (found,) = assemble(resolve(scene), build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF), Counters()).contacts
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
        found = mortar_coupling(below(shape, degree, (2, 2)), _up_to(shape, edge), 0.5)
        assert found.carries.all()


@pytest.mark.parametrize("shape", ["interval", "quadrilateral"])
def test_nodes_that_only_extrapolation_reaches_carry_nothing(shape: str) -> None:
    # a tenth of the last facet is covered: 0.028 of its midside node's weight, which its weight alone would not tell
    slave = below(shape, 2, (2, 2))
    master = _up_to(shape, 0.55)
    found = mortar_coupling(slave, master, 0.5)
    beyond = (slave.points[:, :-1] > 0.7).any(axis=1)
    assert (_integrals(slave, master)[beyond] > 0.01 * slave.node_weights()[beyond]).any()
    assert_array_equal(found.carries, ~beyond)


def test_a_corner_that_two_extrapolations_reach_carries_nothing() -> None:
    # phi = (1 - x)(1 - 2 x) has no less than -1/24 over half a facet: in two directions at once its weight is positive
    slave = below("quadrilateral", 2, (1, 1))
    master = _up_to("quadrilateral", 0.5)
    found = mortar_coupling(slave, master, 0.5)
    corner = slave.points[:, :-1].min(axis=1) == 1
    assert _integrals(slave, master)[corner] > 0.01 * slave.node_weights()[corner]
    assert not found.carries[corner].any()


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("shape", ["interval", "triangle", "quadrilateral"])
def test_a_spot_inside_a_facet_has_one_multiplier(shape: str, degree: int) -> None:
    slave, spot = below(shape, degree, (2, 2)), np.array([0.1, 0.11])
    found = mortar_coupling(slave, above(shape, 1, (1, 1), box=(spot, spot + 0.01)), 0.5)
    assert found.carries.sum() == 1  # for all of the facet: what the nodes see is extrapolated, their mean is not
    assert_allclose(found.gap[found.carries], 0.1)  # not an extrapolated one


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
    found = mortar_coupling(slave, master, 0.5)
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
