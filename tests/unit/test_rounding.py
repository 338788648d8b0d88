"""A stiffness without the entries that rounding alone has left."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.matrices import dense, whole
from stickslip.solvers.fem.rigid_fields import rigid_fields
from stickslip.solvers.linear.rounding import without_rounding
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.system.system import System

SystemOf = Callable[[Scene], System]
TOP = {"top": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0, "z": -0.01}}}
BASE = {"base": {"surface": "block.bottom", "against": "foundation"}}


def test_boxes_lose_a_third_of_their_entries_and_no_accuracy(
    scene_of: Callable[..., Scene], system_of: SystemOf
) -> None:
    system = system_of(scene_of(3, {"cells": "tensor", "mesh_size": 0.25}, contacts=BASE, supports=TOP))
    K = whole(system)
    before, many, size = dense(K), K.getInfo()["nz_used"], K.getDiagonal().array.max()
    found = without_rounding(K)
    assert found.block_size == 3
    assert found.getInfo()["nz_used"] < 0.75 * many
    after = dense(found)
    assert_allclose(after, before, rtol=0, atol=3e-14 * size)
    assert np.count_nonzero(after) <= found.getInfo()["nz_used"]

    points = system.nodes.points
    rigid = rigid_fields(points, points.mean(axis=0), 1.0, False).reshape(len(before), -1)
    assert np.abs(before @ rigid).max() < 3e-15 * size
    assert np.abs(after @ rigid).max() < 3e-15 * size


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
    kept, every = (np.count_nonzero(dense(matrix)[np.ix_(free, free)]) for matrix in (system.K_B, K))
    assert (kept < 0.8 * every) is less
    u = K.createVecRight()
    u.array[:] = np.random.default_rng(0).standard_normal(u.getLocalSize())
    assert_allclose((system.K * u).array, (K * u).array, rtol=0, atol=1e-13 * K.norm())
