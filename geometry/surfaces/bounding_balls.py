"""Coarse contact search: pairs of facets whose bounding balls meet along a direction, by k-d trees."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from stickslip.geometry.arrays import Array, Ints

BLOCK = 2000  # balls at a time: bounds the memory
SAMPLES = 64  # balls that cover the path of one ball to its reach, at most


def candidate_pairs(
    centres: Array, radii: Array, directions: Array, targets: Array, target_radii: Array, reach: float
) -> Iterator[tuple[Ints, Ints]]:
    """Pairs (ball, target) that may meet when the ball moves along its direction, by at most `reach` either way.

    The path of a ball is covered with larger balls, so that some of the pairs do not meet. Targets are sorted into
    trees by size, since one large target in a tree widens the search around all the small ones.

    Args:
        centres, radii: of the balls (m, d), (m,) [m].
        directions: unit vectors (m, d).
        targets, target_radii: balls to meet (t, d), (t,) [m].
        reach: [m].

    Yields:
        Numbers of balls and of targets (c,), block by block of balls.
    """
    level = np.floor(np.log2(target_radii / target_radii.min()))
    classes = [np.flatnonzero(level == value) for value in np.unique(level)]
    trees = [(cKDTree(targets[rows]), rows, target_radii[rows].max()) for rows in classes]
    for start in range(0, len(centres), BLOCK):
        rows = np.arange(start, min(start + BLOCK, len(centres)))
        keys = [
            _pairs_in_tree(tree, centres[rows], radii[rows] + size, directions[rows], reach) for tree, _, size in trees
        ]
        ball = np.concatenate([rows[i] for i, _ in keys])
        target = np.concatenate([members[j] for (_, j), (_, members, _) in zip(keys, trees, strict=True)])
        yield ball, target


def _pairs_in_tree(tree: cKDTree, centres: Array, thick: Array, directions: Array, reach: float) -> tuple[Ints, Ints]:
    """Pairs (ball, target) of one tree; `thick` (m,) are the sums of the radii [m]."""
    count = min(int(np.ceil(reach / np.median(thick))), SAMPLES)
    ball = np.hypot(thick, reach / (2 * max(count, 1)))
    keys = []
    for offset in np.linspace(-reach, reach, 2 * count + 1):
        found = tree.query_ball_point(centres + offset * directions, ball, return_sorted=False)
        rows = np.repeat(np.arange(len(centres)), [len(entry) for entry in found])
        keys.append(rows * tree.n + np.concatenate(found).astype(np.int64))
    key = np.unique(np.concatenate(keys))
    return key // tree.n, key % tree.n
