"""Areas of contact with an edge between nodes: the edge of a touching area lies inside a facet.

Beyond the edge of a smooth contact the gap grows like the power 3/2 of the distance, and so does the slip beyond the
edge of a stuck part. So gap^(2/3) is linear: it is extrapolated to zero from the nodes outside.

Source: of the power K. L. Johnson, Contact Mechanics (1985), sections 4.2 and 7.2.
"""

from __future__ import annotations

import numpy as np

from geometry.arrays import Array, Bools, Ints
from geometry.surfaces.surface import Surface

POWER = 2 / 3
PARTS: dict[str, list[tuple[int, ...]]] = {
    "interval": [(0, 1)],
    "triangle": [(0, 1, 2)],
    "quadrilateral": [(0, 1, 2), (1, 3, 2)],
}  # corners of simplices


def beyond_nodes(side: Surface, inside: Bools, outside: Array, among: Bools | None = None) -> float:
    """What the area inside a smooth edge has beyond the shares of the nodes inside it [m^(d-1)].

    Args:
        side: of order 1 (corners count alone), n nodes.
        inside: (n,) nodes that belong to the area.
        outside: (n,) gap or slip of the nodes that do not [m].
        among: (n,) facets that have other nodes than these are left out; None: none is.
    """
    level = np.where(inside, 0.0, np.maximum(outside, 0.0) ** POWER)
    simplices = np.concatenate([side.facets[:, list(part)] for part in PARTS[side.shape]])
    if among is not None:
        simplices = simplices[among[simplices].all(axis=1)]
    mixed = simplices[inside[simplices].any(axis=1) & ~inside[simplices].all(axis=1)]
    slope = _slopes(side, ~inside if among is None else among & ~inside, level, np.unique(mixed))
    return float(sum(_part(side, nodes, inside, level, slope) for nodes in mixed))


def _slopes(side: Surface, chosen: Bools, level: Array, nodes: Ints) -> Array:
    """Gradients (n, d) of the level at those of some nodes that are chosen, by least squares from chosen neighbours.

    Zero where there is none.
    """
    matrix = side.neighbours().tocsr()
    slope = np.zeros_like(side.points)
    for k in nodes[chosen[nodes]]:
        near = matrix.indices[matrix.indptr[k] : matrix.indptr[k + 1]]
        near = near[chosen[near]]
        if len(near):
            slope[k] = np.linalg.lstsq(side.points[near] - side.points[k], level[near] - level[k], rcond=1e-6)[0]
    return slope


def _part(side: Surface, nodes: Array, inside: Bools, level: Array, slope: Array) -> float:
    """Area inside the edge of a simplex that it crosses, minus the shares of its nodes that are inside."""
    x, within = side.points[nodes], inside[nodes]
    count, whole = int(within.sum()), _size(x)
    weight = 2 * np.pi * float(x[:, 0].mean()) if side.axisymmetric else 1.0
    lone = np.flatnonzero(within if count == 1 else ~within)[0]  # in 3D two edges of the triangle meet there
    share = 1.0
    for other in np.flatnonzero(np.arange(len(nodes)) != lone):
        a, b = (lone, other) if count == 1 else (other, lone)  # from inside to outside
        fall = slope[nodes[b]] @ (x[b] - x[a])
        at = 1 - level[nodes[b]] / fall if fall > 0 else 0.5  # of the way from a to b
        at = float(np.clip(at, 0.0, 1.0))
        share *= at if count == 1 else 1 - at
    inner = share if count == 1 else 1 - share
    return (inner - count / len(nodes)) * whole * weight


def _size(x: Array) -> float:
    """Length of a segment (2, d) or area of a triangle (3, 3) [m^(d-1)]."""
    sides = x[1:] - x[0]
    return float(np.sqrt(np.linalg.det(sides @ sides.T))) / (len(x) - 1)
