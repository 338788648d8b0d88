"""What the mesh report says of cells and gaps, against closed forms."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from stickslip.geometry.mesh.cell_quality import worst_quality
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.run.mesh_report import can_touch


@pytest.mark.parametrize(
    ("dim", "cells", "order", "expected"),
    [
        (2, "tensor", 1, 1.0),
        (3, "tensor", 2, 1.0),
        (2, "simplex", 1, np.sqrt(3) / 2),  # half a square: 2 |J| / |J|^2 = 4 A / (sum of squared edges / sqrt(3))
        (2, "simplex", 2, np.sqrt(3) / 2),
    ],
)
def test_quality_of_squares_cubes_and_their_halves(
    dim: int, cells: str, order: int, expected: float, scene_of: Callable[..., Scene]
) -> None:
    scene = scene_of(dim, {"cells": cells, "order": order})
    mesh = build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF)
    assert worst_quality(mesh.domain, mesh.degree) == pytest.approx(expected)


def test_a_flattened_cell_has_a_poor_quality(scene_of: Callable[..., Scene]) -> None:
    scene = scene_of(2, {"cells": "tensor"})
    mesh = build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF)
    mesh.domain.geometry.x[:, 1] *= 0.1
    assert worst_quality(mesh.domain, mesh.degree) == pytest.approx(
        2 * 0.1 / (1 + 0.1**2)
    )  # a rectangle of sides 1 and 0.1


def test_prescribed_motion_closes_gaps_up_to_its_size(scene_of: Callable[..., Scene]) -> None:
    supports = {"top": {"boundary": "block.top", "displacement": {"y": [[0, 0], [0.5, -0.2], [1, 0]]}}}
    scene = scene_of(supports=supports)
    assert can_touch(scene, np.array([-0.1, 0.0, 0.19, 0.21]), 2.0).tolist() == [True, True, True, False]


POINT = {"boundary": "block.top", "point": [0.5, 0.5]}
ROLLER = {"shape": "plane", "point": [0.0, -1.0], "normal": [0.0, 1.0]}


@pytest.mark.parametrize(
    ("tables", "closes"),
    [
        ({"loads": {"top": {"boundary": "block.top", "pressure": 1.0}}}, True),
        ({"obstacles": {"foundation": ROLLER | {"force": {"y": 1.0}}}}, True),
        ({"remote_points": {"lid": POINT | {"coupling": "distributing", "force": {"y": -1.0}}}}, True),
        ({"remote_points": {"lid": POINT | {"coupling": "distributing", "moment": {"z": -1.0}}}}, True),
        ({"remote_points": {"lid": POINT | {"coupling": "rigid", "rotation": {"z": 0.1}}}}, True),
        ({"remote_points": {"lid": POINT | {"coupling": "distributing", "force": {"y": 0.0}}}}, False),
        ({}, False),
    ],
)
def test_what_pushes_closes_the_smallest_gap_and_indents_a_little(
    tables: dict[str, Any], closes: bool, scene_of: Callable[..., Scene]
) -> None:
    gap = np.array([0.5, 0.519, 0.521])  # 1 % of 2 m beyond the smallest
    assert can_touch(scene_of(**tables), gap, 2.0).tolist() == [closes, closes, False]
