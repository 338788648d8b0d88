"""Couplings of two bodies, whatever the operator: no side is preferred."""

from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_allclose

from geometry.mesh import build_mesh
from solvers.counters import Counters
from solvers.operators.rows import ContactRows
from solvers.system import assemble
from workflows.scene import from_dict

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
