"""The nodes of a contact line of a plane model, in order along the line."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from stickslip.geometry.arrays import ROUNDING, Array, Bools, Ints


@dataclass(frozen=True)
class Line:
    """The nodes of a contact line, in order along the line; a closed line returns to its start."""

    nodes: Ints  # (k,)
    starts: Bools  # (k,) a new piece starts here
    tangents: Array  # (k, 2) unit vectors
    arc: Array  # (k,) length along the line [m]; pieces follow each other without a gap
    place: Array  # (k,) abscissa of the plot [m]
    label: str


def walk(points: Array, facets: Ints) -> Line:
    """Order the nodes of a contact line: points (n, 2), facets (f, 2 or 3) in dolfinx's order.

    The abscissa is x or y where the line is straight along that axis, else the arc length.
    """
    neighbours: dict[int, list[int]] = {}
    for facet in facets:
        chain = [facet[0], *facet[2:], facet[1]]
        for a, b in pairwise(chain):
            neighbours.setdefault(int(a), []).append(int(b))
            neighbours.setdefault(int(b), []).append(int(a))
    ends = [j for j, near in neighbours.items() if len(near) != 2]
    nodes: list[int] = []
    starts: list[bool] = []
    tangents: list[Array] = []
    done: set[int] = set()
    for first in sorted(ends, key=lambda j: tuple(points[j])) + sorted(neighbours):
        if first in done:
            continue
        piece, here = [first], first
        while True:
            done.add(here)
            onward = [j for j in neighbours[here] if j not in done]
            if not onward:
                break
            here = onward[0]
            piece.append(here)
        if len(piece) > 2 and first in neighbours[piece[-1]]:  # a closed line
            piece.append(first)
        nodes += piece
        starts += [True] + [False] * (len(piece) - 1)
        tangents += list(_tangents(points[piece]))
    order = np.array(nodes, np.int64)
    begin = np.array(starts, bool)
    lengths = np.linalg.norm(np.diff(points[order], axis=0, prepend=points[order[:1]]), axis=1)
    arc = np.cumsum(np.where(begin, 0.0, lengths))
    spread = np.ptp(points, axis=0)
    along = int(np.argmax(spread))
    if spread[1 - along] <= ROUNDING * spread[along]:
        return Line(order, begin, np.array(tangents), arc, points[order, along], f"{'xy'[along]} [m]")
    return Line(order, begin, np.array(tangents), arc, arc, "arc length [m]")


def _tangents(points: Array) -> Array:
    """Unit tangents (k, 2) at the nodes of one piece, in the order of the nodes."""
    if len(points) == 1:
        return np.array([[1.0, 0.0]])
    along = np.gradient(points, axis=0)
    if np.array_equal(points[0], points[-1]):
        along[0] = along[-1] = points[1] - points[-2]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    return np.asarray(along / np.where(length > 0, length, 1.0))
