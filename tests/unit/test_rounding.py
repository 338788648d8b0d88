"""A stiffness without the entries that rounding alone has left."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import sparse

from shared.matrices import whole
from stickslip.geometry.protocols import Mat, Sparse
from stickslip.solvers.fem.rigid_fields import rigid_fields
from stickslip.solvers.linear.rounding import without_rounding
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.system.system import System

SystemOf = Callable[[Scene], System]
TOP = {"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0, "z": -0.01}}}
BASE = {"base": {"surface": "block.bottom", "against": "foundation"}}


def entries(matrix: Mat) -> Sparse:
    """A PETSc matrix of one rank, of scipy."""
    indptr, indices, data = matrix.getValuesCSR()
    found: Sparse = sparse.csr_matrix((data, indices, indptr), shape=matrix.size)
    return found


def test_boxes_lose_a_third_of_their_entries_and_no_accuracy(
    scene_of: Callable[..., Scene], system_of: SystemOf
) -> None:
    system = system_of(scene_of(3, {"cells": "tensor", "mesh_size": 0.125}, contacts=BASE, supports=TOP))
    K = whole(system)
    before, size = entries(K), K.getDiagonal().array.max()
    found = without_rounding(K)
    assert found.block_size == 3
    after = entries(found)
    assert after.nnz < 0.75 * before.nnz
    assert abs(after - before).max() < 3e-14 * size

    points = system.nodes.points
    rigid = rigid_fields(points, points.mean(axis=0), 1.0, False).reshape(before.shape[0], -1)
    forces_before, forces_after = (np.linalg.norm(K_u) for K_u in (before @ rigid, after @ rigid))
    assert forces_after < 1.2 * forces_before  # 1.9 if what is left out were not added to the node's own entries


def test_rows_are_looked_at_in_parts(
    monkeypatch: pytest.MonkeyPatch, scene_of: Callable[..., Scene], system_of: SystemOf
) -> None:
    K = whole(system_of(scene_of(3, {"cells": "tensor", "mesh_size": 0.25}, contacts=BASE, supports=TOP)))
    parts = K.copy()
    expected = without_rounding(K).getValuesCSR()
    monkeypatch.setattr("stickslip.solvers.linear.rounding.CHUNK", 7)
    for found, wanted in zip(without_rounding(parts).getValuesCSR(), expected, strict=True):
        assert_array_equal(found, wanted)


@pytest.mark.parametrize(
    ("changes", "less"), [({}, True), ({"supports": {}}, False), ({"cells": "simplex"}, False)],
    ids=["held boxes", "a body that floats", "tetrahedra"],
)  # fmt: skip
def test_only_held_bodies_of_boxes_are_changed(
    changes: dict[str, Any], less: bool, scene_of: Callable[..., Scene], system_of: SystemOf
) -> None:
    shape = {"cells": changes.get("cells", "tensor"), "mesh_size": 0.2}
    system = system_of(scene_of(3, shape, contacts=BASE, supports=changes.get("supports", TOP)))
    K = whole(system)
    free = np.setdiff1d(np.arange(K.size[0]), system.constraints.eliminated())
    kept, every = (entries(matrix)[free][:, free].count_nonzero() for matrix in (system.K_B, K))
    assert (kept < 0.8 * every) is less
    u = K.createVecRight()
    u.array[:] = np.random.default_rng(0).standard_normal(u.getLocalSize())
    assert_allclose((system.K * u).array, (K * u).array, rtol=0, atol=1e-13 * K.norm())
