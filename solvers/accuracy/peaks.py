"""Whether a largest pressure, or a stress in a cell, has a limit, or grows without end as the mesh is refined: at a
corner, at the end of a punch.

Such a pressure falls off like a negative power of the distance: by much to the nearest nodes, by far less to those
behind, or it waves there. Where it is smooth, or falls to zero at the edge of contact, the fall grows with the distance
or stays. At the end of a side a smaller fall is enough.
"""

from __future__ import annotations

import numpy as np

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.surfaces.surface import Surface

STEEP = 0.15  # part by which the nearest nodes have less; smooth pressures: .10 at most on the meshes that were tried
END = 0.05  # the same at the end of a side
SAME = 1e-9  # relative: neighbours that share a multiplier, as where two contacts meet
CORNERS = {"interval": 2, "triangle": 3, "quadrilateral": 4}
CONVEX = 1.5  # times the next fall; r^(-1/2) has 2.3, r^(-1/10) 1.8


def grows(side: Surface, pressure: Array) -> bool:
    """Whether the largest pressure (n,) [Pa] of a side of n nodes grows without end."""
    if not len(pressure):
        return False
    peak, near = int(np.argmax(pressure)), side.neighbours()
    first = np.arange(len(pressure)) == peak
    seen = first | ((near @ first.astype(float) > 0) & (pressure >= (1 - SAME) * pressure[peak]))
    rings, ends = [float(pressure[peak])], any(_ends(side, int(node)) for node in np.flatnonzero(seen))
    for _ in range(2):
        ring = (near @ seen.astype(float) > 0) & ~seen
        if not ring.any():
            return False
        rings.append(float(pressure[ring].max()))
        seen |= ring
    fall, second = -np.diff(rings)
    return bool(rings[-1] > 0 and fall > (END if ends else STEEP) * rings[0] and fall > CONVEX * abs(second))


def grows_in(cells: Ints, stress: Array, cell: int) -> bool:
    """Whether the stress in a cell, or close by, grows without end.

    Args:
        cells: (n, k) nodes of the cells.
        stress: (n, 3, 3) [Pa].
        cell: number of the cell.
    """
    size, nodes, seen = np.linalg.norm(stress, axis=(1, 2)), cells[cell], np.zeros(len(cells), bool)
    rings = list[float]()
    for _ in range(3):
        ring = np.isin(cells, nodes).any(axis=1) & ~seen
        if not ring.any():
            return False
        rings.append(float(size[ring].max()))
        nodes, seen = cells[ring].ravel(), seen | ring
    first, second = -np.diff(rings)
    return bool(first > STEEP * rings[0] and first > CONVEX * abs(second))


def _ends(side: Surface, node: int) -> bool:
    """Whether a side ends at a node: one of the lines that meet there belongs to one facet alone."""
    corners = side.facets[:, : CORNERS[side.shape]]
    found, place = np.nonzero(corners == node)
    if side.dim == 2:
        return len(found) == 1
    others = corners[found]
    near = others != node
    if side.shape == "quadrilateral":
        near[np.arange(len(found)), 3 - place] = False  # across
    return bool((np.unique(others[near], return_counts=True)[1] == 1).any())
