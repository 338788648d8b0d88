"""Cells for each rank, by recursive coordinate bisection (Berger & Bokhari, IEEE Trans. Comput. C-36, 1987)."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import Array, Ints

TILT = np.array([1.0, 1e-4, 1e-8])  # the cuts lean a little: no two cells of a regular mesh are at the same height


def bisection(points: Array, count: int) -> Ints:
    """Which of `count` sets, as large as each other, each of the points (n, d) is in.

    Each cut is across the longest extent of what it cuts.

    >>> bisection(np.array([[0.0, 0.0], [3.0, 0.0], [1.0, 0.0], [2.0, 0.0]]), 2)
    array([0, 1, 0, 1])
    """
    found = np.zeros(len(points), np.int64)
    if count > 1 and len(points):
        first = count // 2
        size = len(points) * first // count
        longest = np.argsort(-np.ptp(points, axis=0), kind="stable")
        order = np.argpartition(points[:, longest] @ TILT[: points.shape[1]], size)
        found[order[:size]] = bisection(points[order[:size]], first)
        found[order[size:]] = first + bisection(points[order[size:]], count - first)
    return found


def sets_beside(cells: Ints, sets: Ints, dim: int) -> tuple[Ints, Ints]:
    """Cells that have a facet in common with cells of other sets, and one such set with each.

    Args:
        cells: (n, k) corners of cells of one shape.
        sets: (n,) the set of each cell.
        dim: dimension of the cells.

    >>> sets_beside(np.array([[0, 1, 2], [1, 2, 3], [2, 3, 4]]), np.array([0, 0, 1]), 2)
    (array([1, 2]), array([1, 0]))
    """
    of_corner = np.empty(int(cells.max(initial=0)) + 1, np.int64)
    of_corner[cells] = sets[:, None]  # of one of the cells around it
    between = np.zeros(len(of_corner), bool)
    between[cells[of_corner[cells] != sets[:, None]]] = True
    near = np.flatnonzero(between[cells].any(axis=1))
    row, corner = np.nonzero(between[cells[near]])
    around = sparse.csr_matrix(
        (np.ones(len(row), np.int64), (row, cells[near][row, corner])), (len(near), len(between))
    )
    shared = (around @ around.T).tocoo()
    left, right = near[shared.row], sets[near[shared.col]]
    beside = (shared.data >= dim) & (sets[left] != right)  # no two cells share `dim` corners and no facet
    cell, other = np.unique(np.stack([left[beside], right[beside]]), axis=1)
    return cell, other
