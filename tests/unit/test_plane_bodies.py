"""Cells of plane bodies as pixels: no gap between neighbours, and each pixel in its cell."""

import numpy as np
import pytest
from matplotlib.colors import Normalize
from matplotlib.path import Path as Outline
from scipy.spatial import Delaunay

from stickslip.geometry.arrays import Array
from stickslip.solvers.results.step_result import MeshData
from stickslip.workflows.pictures.body_picture import PlaneBodies, cells_at_pixels
from stickslip.workflows.pictures.sheet import Sheet

ROWS, COLUMNS = 60, 90


def triangles(points: Array) -> Array:
    return points[Delaunay(points).simplices]


def spread(seed: int) -> Array:
    """Points that fill the picture, its corners among them."""
    inside = np.random.default_rng(seed).uniform(0, 1, (200, 2)) * [COLUMNS, ROWS]
    return np.vstack([inside, [[0, 0], [COLUMNS, 0], [0, ROWS], [COLUMNS, ROWS]]])


def middles() -> Array:
    y, x = np.mgrid[:ROWS, :COLUMNS] + 0.5
    return np.stack([x, y], axis=-1)


@pytest.mark.parametrize("seed", range(5))
def test_each_pixel_shows_the_cell_that_it_is_in(seed: int) -> None:
    corners = triangles(spread(seed))
    found = cells_at_pixels(corners, ROWS, COLUMNS)
    assert found.min() >= 0  # no gap
    for cell in np.unique(found)[::10]:
        assert Outline(corners[cell]).contains_points(middles()[found == cell], radius=1e-9 * COLUMNS).all()


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4, np.pi / 2])
def test_neighbours_leave_no_gap_where_edges_meet_middles_of_pixels(angle: float) -> None:
    n = np.arange(-80, 81) + 0.5
    x, y = np.meshgrid(n, n)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    nodes = np.stack([x, y], axis=-1) @ turn + [COLUMNS / 2, ROWS / 2]
    cells = np.stack([nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]], axis=2).reshape(-1, 4, 2)
    assert cells_at_pixels(cells, ROWS, COLUMNS).min() >= 0
    assert cells_at_pixels(cells[:, ::-1], ROWS, COLUMNS).min() >= 0  # the other way round


def test_cells_outside_and_cells_without_area_are_not_seen() -> None:
    outside = np.array([[[-9.0, -9.0], [-1.0, -9.0], [-1.0, -1.0]], [[99.0, 2.0], [120.0, 2.0], [120.0, 70.0]]])
    flat = np.array([[[3.0, 3.5], [8.0, 3.5], [5.0, 3.5]], [[3.5, 3.0], [3.5, 8.0], [3.5, 5.0]]])
    assert (cells_at_pixels(np.concatenate([outside, flat]), ROWS, COLUMNS) == -1).all()


@pytest.mark.parametrize("scale", [0.0, 1.0])
def test_bodies_are_where_their_displacement_brings_them(scale: float) -> None:
    mesh = MeshData(
        points=np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]),
        cells=np.array([[0, 1, 2, 3]]),
        shape="quadrilateral",
        body=np.zeros(1, np.int64),
        bodies=("block",),
        surfaces={},
    )
    bodies = PlaneBodies(mesh, np.tile([2.0, 0.0], (4, 1)), (), scale)
    axes = Sheet(3.0, 3.0).axes(0.5, 0.5, 2.0, 2.0 / bodies.view.aspect)
    bodies.show(axes, bodies.view, 400, scale, np.array([1.0]), Normalize(0.0, 1.0))
    image = axes.images[0].get_array()
    coloured = (np.ptp(image.astype(int), axis=2) > 50).any(axis=0).nonzero()[0]
    low, high = bodies.view.extent[:2]
    ends = low + (high - low) * (coloured[[0, -1]] + [0, 1]) / image.shape[1]
    assert ends == pytest.approx([2.0 * scale, 1.0 + 2.0 * scale], abs=(high - low) / 400)
