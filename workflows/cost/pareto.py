"""The Pareto front: runs for which no other run is both faster and more accurate."""

from __future__ import annotations

from collections.abc import Sequence


def front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the points (cost, error) on the front, by rising cost.

    >>> front([(1.0, 0.1), (2.0, 0.2), (3.0, 0.01), (3.0, 0.02)])
    [0, 2]
    """
    found: list[int] = []
    least = float("inf")
    for index in sorted(range(len(points)), key=lambda i: points[i]):
        if points[index][1] < least:
            found.append(index)
            least = points[index][1]
    return found
