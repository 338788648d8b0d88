"""Whether a largest pressure, or a stress in a cell, has a limit, or grows without end as the mesh is refined: at a
corner, at the end of a punch.

Such a pressure falls off like a negative power of the distance: by much to the nearest nodes, by far less to those
behind, or it waves there. Where it is smooth, or falls to zero at the edge of contact, the fall grows with the distance
or stays. At the end of a side a smaller fall is enough. The largest pressure may be a smooth one yet: others that are
nearly as high are looked at, too.
"""

from __future__ import annotations

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import ROUNDING, Array, Bools, Ints
from stickslip.geometry.protocols import Sparse
from stickslip.geometry.surfaces.surface import Surface

STEEP = 0.15  # part by which the nearest nodes have less; smooth pressures: .10 at most on the meshes that were tried
END = 0.05  # the same at the end of a side
HIGH = 0.8  # of the largest pressure: where one as high as that grows, it is the largest on a finer mesh
CONVEX = 1.5  # times the next fall; r^(-1/2) has 2.3, r^(-1/10) 1.8
WAVES = 1.2  # times the next rise, if that is steep: pressures that alternate from node to node have 1


def grows(side: Surface, pressure: Array) -> bool:
    """Whether the largest pressure (n,) [Pa] of a side of n nodes, or another one nearly as high, grows without end."""
    if not len(pressure):
        return False
    near, rim = side.neighbours().tocsr(), _rim(side)
    high = np.flatnonzero(pressure >= HIGH * pressure.max(initial=0.0))
    around = [pressure[near.indices[near.indptr[k] : near.indptr[k + 1]]] for k in high]
    highest = pressure[high] >= [others.max(initial=0.0) for others in around]
    falls = [others.min(initial=np.inf) for others in around] < (1 - END) * pressure[high]
    return any(_grows_at(peak, side, pressure, near, rim) for peak in high[highest & falls])


def _grows_at(peak: int, side: Surface, pressure: Array, near: Sparse, rim: Bools) -> bool:
    """Whether the pressure at a node falls off to all sides like one that grows without end."""
    first = np.arange(len(pressure)) == peak
    # relative: neighbours that share a multiplier, as where two contacts meet
    front = first | ((near @ first.astype(float) > 0) & (pressure >= (1 - ROUNDING) * pressure[peak]))
    ends = bool(rim[front].any())
    behind = [rim] if ends and side.dim == 3 else []  # along an edge it may be as high: so those behind it, too
    return any(_falls(pressure, near, front, layer, END if ends else STEEP) for layer in (front, *behind))


def _falls(pressure: Array, near: Sparse, front: Bools, layer: Bools, steep: float) -> bool:
    """Whether a largest pressure (n,) falls off like a power of the distance from nodes `front`, and from `layer`."""
    rings, seen = [float(pressure[front].max())], front
    for _ in range(2):
        seen = seen | layer
        front = (near @ front.astype(float) > 0) & ~seen
        if not front.any():
            return False
        rings.append(float(pressure[front].max()))
        layer = front | (near @ layer.astype(float) > 0)
    first, second = -np.diff(rings)
    more = WAVES if second < -STEEP * rings[0] else CONVEX
    return bool(rings[-1] > 0 and first > steep * rings[0] and first > more * abs(second))


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


def _rim(side: Surface) -> Bools:
    """Nodes (n,) at which a side ends: on a line between two corners, in 2D at a corner, of one facet alone."""
    corners = dx.borders(side.shape)
    ends = side.facets[:, corners]
    rows = np.sort(ends, axis=2).reshape(-1, corners.shape[1])
    _, line, count = np.unique(rows, axis=0, return_inverse=True, return_counts=True)
    alone = (count[line.ravel()] == 1).reshape(ends.shape[:2])
    found = np.zeros(len(side.points), bool)
    found[ends[alone]] = True
    if side.degree == 2 and side.dim == 3:
        middles = len(dx.reference_nodes(side.shape, 1)) + np.arange(len(corners))
        found[side.facets[:, middles][alone]] = True
    return found
