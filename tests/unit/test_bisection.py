"""Cells for each rank: sets as large as each other, flat cuts, and what lies on the other side of them."""

from itertools import combinations

import numpy as np
import pytest
from scipy.spatial import Delaunay

from stickslip.geometry.bisection import bisection, sets_beside


def grid(*shape: int) -> np.ndarray:
    return np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in shape), indexing="ij"), axis=-1).reshape(-1, len(shape))


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8, 64])
def test_sets_are_as_large_as_each_other(count: int) -> None:
    points = np.random.default_rng(1).normal(size=(1001, 3))
    sizes = np.bincount(bisection(points, count), minlength=count)
    assert sizes.max() - sizes.min() <= 1 + np.log2(count)


def test_more_sets_than_points_leave_some_empty() -> None:
    assert np.unique(bisection(grid(3, 1), 5)).size == 3
    assert not len(bisection(np.zeros((0, 2)), 5))


def test_a_layer_of_cells_at_one_height_is_cut_along_a_line() -> None:
    noise = np.random.default_rng(2).normal(scale=1e-15, size=(9 * 9 * 9, 3))  # as gmsh leaves it
    found = bisection(grid(9, 9, 9) + noise, 2).reshape(9, 9, 9)
    cut = sum(int(np.count_nonzero(np.diff(found, axis=axis))) for axis in range(3))
    assert cut <= 9 * 9 + 9 + 1  # a plane, with a step of one cell across it and one along the line


def test_cuts_are_across_the_longest_extent() -> None:
    found = bisection(grid(8, 2, 1), 4).reshape(8, 2)
    assert (found == np.arange(8)[:, None] // 2).all()


@pytest.mark.parametrize("dim", [2, 3])
def test_cells_beside_another_set_are_those_that_share_a_facet_with_it(dim: int) -> None:
    cells = Delaunay(np.random.default_rng(3).random((60, dim))).simplices.astype(np.int64)
    sets = np.random.default_rng(4).integers(0, 4, len(cells))
    expected = {
        pair
        for i, j in combinations(range(len(cells)), 2)
        if sets[i] != sets[j] and len(set(cells[i]) & set(cells[j])) == dim
        for pair in ((i, sets[j]), (j, sets[i]))
    }
    assert set(zip(*sets_beside(cells, sets, dim), strict=True)) == expected


def test_hexahedra_that_share_an_edge_alone_are_not_beside_each_other() -> None:
    corners = np.array([[0, 1, 2, 3, 4, 5, 6, 7], [6, 7, 8, 9, 10, 11, 12, 13], [4, 5, 6, 7, 14, 15, 16, 17]])
    cell, beside = sets_beside(corners, np.array([0, 1, 2]), 3)
    assert list(zip(cell, beside, strict=True)) == [(0, 2), (2, 0)]


def test_one_set_has_none_beside_it() -> None:
    cell, beside = sets_beside(np.array([[0, 1, 3, 2]]), np.zeros(1, np.int64), 2)
    assert not len(cell)
    assert not len(beside)
