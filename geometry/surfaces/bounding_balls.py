"""Which facets may meet: those whose balls come close to each other along a direction."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from geometry.arrays import Array, Ints

BLOCK = 2000  # balls looked at together: bounds the memory
SAMPLES = 64  # at most, from a ball's centre to its reach


def near(
    centres: Array, radii: Array, directions: Array, targets: Array, target_radii: Array, reach: float
) -> Iterator[tuple[Ints, Ints]]:
    """Pairs (ball, target) that meet when the ball moves by at most `reach` either way along its direction.

    The path of a ball is covered with balls; targets of very different sizes have trees of their own, else the largest
    one would make neighbours of all the small ones. Some of the pairs do not meet.
    """
    level = np.floor(np.log2(target_radii / target_radii.min()))
    classes = [np.flatnonzero(level == value) for value in np.unique(level)]
    trees = [(cKDTree(targets[rows]), rows, target_radii[rows].max()) for rows in classes]
    for start in range(0, len(centres), BLOCK):
        rows = np.arange(start, min(start + BLOCK, len(centres)))
        keys = [_meet(tree, centres[rows], radii[rows] + size, directions[rows], reach) for tree, _, size in trees]
        ball = np.concatenate([rows[i] for i, _ in keys])
        target = np.concatenate([own[j] for (_, j), (_, own, _) in zip(keys, trees, strict=True)])
        yield ball, target


def _meet(tree: cKDTree, centres: Array, thick: Array, directions: Array, reach: float) -> tuple[Ints, Ints]:
    count = min(int(np.ceil(reach / np.median(thick))), SAMPLES)
    ball = np.hypot(thick, reach / (2 * max(count, 1)))
    keys = []
    for offset in np.linspace(-reach, reach, 2 * count + 1):
        found = tree.query_ball_point(centres + offset * directions, ball, return_sorted=False)
        rows = np.repeat(np.arange(len(centres)), [len(entry) for entry in found])
        keys.append(rows * tree.n + np.concatenate(found).astype(np.int64))
    key = np.unique(np.concatenate(keys))
    return key // tree.n, key % tree.n
