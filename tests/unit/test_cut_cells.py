"""Cells of a user's own mesh are cut where they are too large: conforming, nested, sides and bodies carried over."""

from itertools import combinations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.mesh_sizes import USUAL, SizeField, volumes
from stickslip.geometry.user_files.meshing import cut_to_sizes
from stickslip.geometry.user_files.raw_mesh import LOCAL_FACETS, RawMesh, check_neighbours


def square(n: int) -> tuple[Array, Ints]:
    x = np.arange(n + 1) / n
    points = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((n + 1, n + 1))], axis=-1).reshape(-1, 3)
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    a, b, c, d = first, first + n + 1, first + n + 2, first + 1
    return points, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def cube(n: int) -> tuple[Array, Ints]:
    """Six tetrahedra about the diagonal of each of n³ cubes."""
    x = np.arange(n + 1) / n
    points = np.stack(np.meshgrid(x, x, x, indexing="ij"), axis=-1).reshape(-1, 3)
    step = np.array([(n + 1) ** 2, n + 1, 1])
    corner = np.array([step @ i for i in np.ndindex(n, n, n)])
    cells = []
    for order in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2)):
        ways = np.cumsum([0, *step[list(order)]])
        nodes = corner[:, None] + ways
        cells.append(nodes if order in ((0, 1, 2), (1, 2, 0), (2, 0, 1)) else nodes[:, [0, 2, 1, 3]])
    return points, np.concatenate(cells)


def mesh(d: int) -> RawMesh:
    """Two bodies, left and right of x = 1/2, and the side x = 0 of the left one."""
    points, cells = square(4) if d == 2 else cube(2)
    kind = {2: 2, 3: 4}[d]
    left = points[cells][:, :, 0].mean(axis=1) < 0.5
    facets = cells[left][:, np.array(LOCAL_FACETS[kind])].reshape(-1, d)
    facets = facets[np.all(points[facets][:, :, 0] == 0, axis=1)]
    return RawMesh(d, kind, points, {"left": cells[left], "right": cells[~left]}, {"left.wall": facets})


def measure(points: Array, facets: Ints) -> float:
    x = points[facets]
    if x.shape[1] == 2:
        return float(np.linalg.norm(x[:, 1] - x[:, 0], axis=1).sum())
    return float(np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1).sum() / 2)


@pytest.mark.parametrize("d", [2, 3])
def test_cells_are_cut_where_they_are_too_large_and_still_fit(d: int) -> None:
    whole = mesh(d)
    places = whole.points[:, :d]
    wanted = (0.04 if d == 2 else 0.08) + 0.3 * np.linalg.norm(places, axis=1)
    cells = np.concatenate(list(whole.cells.values()))
    found = cut_to_sizes(whole, SizeField(places, cells, wanted))
    check_neighbours(found.kind, found.cells)
    assert_allclose(found.points[: len(whole.points)], whole.points)
    for rows in found.cells.values():
        assert volumes(found.points[:, :d], rows).sum() == pytest.approx(0.5)
    assert len(found.cells["left"]) > 2 * len(whole.cells["left"])
    rows = np.concatenate(list(found.cells.values()))
    x = found.points[rows][:, :, :d]
    turned = np.linalg.det(x[:, 1:] - x[:, :1])
    assert np.all(turned > 0)
    ends = np.array(list(combinations(range(d + 1), 2)))
    edges = np.linalg.norm(x[:, ends[:, 0]] - x[:, ends[:, 1]], axis=2)
    assert np.min(turned / edges.max(axis=1) ** d) > 0.2 * np.min(_shape(whole, d))  # angles stay
    # on the outer boundary, and there alone, is a facet that one cell has: nothing hangs
    local = np.sort(rows[:, np.array(LOCAL_FACETS[found.kind])].reshape(-1, d), axis=1)
    facets, times = np.unique(local, axis=0, return_counts=True)
    assert measure(found.points, facets[times == 1]) == pytest.approx({2: 4.0, 3: 6.0}[d])
    wall = found.facets["left.wall"]
    assert measure(found.points, wall) == pytest.approx(1.0)
    assert np.all(found.points[wall][:, :, 0] == 0)
    assert len(wall) > len(whole.facets["left.wall"])
    assert {tuple(row) for row in np.sort(wall, axis=1)} <= {tuple(row) for row in facets[times == 1]}
    sizes = (volumes(found.points[:, :d], rows) / USUAL[d]) ** (1 / d)
    assert sizes[np.argmin(np.linalg.norm(x.mean(axis=1), axis=1))] < 0.5 * sizes.max()


def _shape(of: RawMesh, d: int) -> Array:
    x = of.points[np.concatenate(list(of.cells.values()))][:, :, :d]
    ends = np.array(list(combinations(range(d + 1), 2)))
    longest = np.linalg.norm(x[:, ends[:, 0]] - x[:, ends[:, 1]], axis=2).max(axis=1)
    return np.asarray(np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) / longest**d)


def test_a_mesh_that_is_fine_enough_stays() -> None:
    whole = mesh(2)
    cells = np.concatenate(list(whole.cells.values()))
    found = cut_to_sizes(whole, SizeField(whole.points[:, :2], cells, np.full(len(whole.points), 0.5)))
    assert found.points is whole.points
    assert all(np.array_equal(found.cells[body], whole.cells[body]) for body in whole.cells)
