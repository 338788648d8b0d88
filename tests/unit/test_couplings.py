"""Couplings of two bodies, whatever the operator: no side is preferred."""

from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_allclose

from geometry.mesh import build_mesh
from solvers.counters import Counters
from solvers.operators.rows import ContactRows
from solvers.simulation import prepare
from solvers.system import assemble
from workflows.scene import from_dict, read

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
    (found,) = assemble(scene, build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF), Counters()).contacts
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
    (found,) = assemble(scene, build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF), Counters()).contacts
    return found


def test_a_node_of_which_little_faces_the_master_presses_nothing() -> None:
    # at the rim of what faces the other ball its gap is extrapolated: it pressed a million times as hard as the pole
    sizes = ["geometry.mesh_size=0.75", "geometry.lower_mesh_size=0.9", "geometry.contact_mesh_size=0.075"]
    simulation = prepare(read("spheres", sizes))
    (rows,) = simulation.system.contacts
    assert rows.node_gap[rows.node_weights > 0].min() > -1e-3  # straight facets of .075 m cut the balls by h^2 / 8 R
    *_, step = simulation.steps()
    pole = step.contacts["pole"]
    far = np.linalg.norm(rows.surface.points[:, :2], axis=1) > 0.4
    assert far.any()
    assert not pole.pressure[far].any()
    assert 0.001 < pole.normal_force < 0.01
