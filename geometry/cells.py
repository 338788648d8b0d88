"""Cells of an overlay of two surfaces, in one layer: what lies behind a nearer master facet does not count."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from geometry.surface import Surface

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
TOLERANCE = 1e-14  # in reference coordinates
EDGE = 1e-9  # of a cell: a centre on the edge between two cells is covered


@dataclass(frozen=True)
class Cells:
    """c intervals or triangles, each on one slave facet and facing one master facet."""

    slave_facet: Ints  # (c,)
    master_facet: Ints  # (c,)
    corners: Array  # (c, d, d-1) in slave reference coordinates
    directions: Array | None = None  # (c, d) of projection; None: along the slave's interpolated normals

    def __getitem__(self, rows: Any) -> Cells:
        along = None if self.directions is None else self.directions[rows]
        return Cells(self.slave_facet[rows], self.master_facet[rows], self.corners[rows], along)

    def at(self, points: Array) -> Array:
        """Slave reference coordinates (c, g, d-1) of points (g, d-1) of the reference interval or triangle."""
        return np.asarray(self.corners[:, :1] + points @ (self.corners[:, 1:] - self.corners[:, :1]))

    @property
    def areas(self) -> Array:
        """Area by that of the reference interval or triangle (c,)."""
        return np.asarray(np.abs(np.linalg.det(self.corners[:, 1:] - self.corners[:, :1])))


def nearest(cells: Cells, master: Surface, gap: Callable[[Cells, Array], Array]) -> Bools:
    """Which cells (c,) no nearer master facet covers, judged at their centres.

    Cells that hang together by master nodes are one layer, as all face the slave: few slave facets meet several.

    Args:
        gap: of cells at one place each (c, d-1) in slave coordinates [m].
    """
    kept = np.ones(len(cells.slave_facet), bool)
    layer, rows = _layers(cells, master)
    i, j = _together(cells.slave_facet[rows])
    i, j = rows[i], rows[j]
    i, j = i[layer[i] != layer[j]], j[layer[i] != layer[j]]
    centres = cells.corners.mean(axis=1)
    arms = cells.corners[j, 1:] - cells.corners[j, :1]
    share = np.linalg.solve(np.swapaxes(arms, 1, 2), (centres[i] - cells.corners[j, 0])[:, :, None])[:, :, 0]
    covers = (share > -EDGE).all(axis=1) & (share.sum(axis=1) < 1 + EDGE)
    i, j = i[covers], j[covers]
    own, other = (np.abs(gap(cells[k], centres[i])) for k in (i, j))
    kept[i[(other < own) | ((other == own) & (j < i))]] = False
    return kept


def cut_apart(cells: Cells, master: Surface) -> Cells:
    """Intervals of several layers cut at each other's ends."""
    rows = _layers(cells, master)[1]
    i, j = _together(cells.slave_facet[rows])
    ends = np.sort(cells.corners[rows, :, 0], axis=1)
    points = np.clip(ends[j], ends[i][:, :1], ends[i][:, 1:]).ravel()
    owner = np.repeat(i, 2)
    order = np.lexsort((points, owner))
    points, owner = points[order], owner[order]
    cut = (owner[1:] == owner[:-1]) & (np.diff(points) > TOLERANCE)
    parts = cells[rows[owner[1:][cut]]]
    whole = cells[np.setdiff1d(np.arange(len(cells.slave_facet)), rows)]
    return Cells(
        np.concatenate([whole.slave_facet, parts.slave_facet]),
        np.concatenate([whole.master_facet, parts.master_facet]),
        np.concatenate([whole.corners, np.stack([points[:-1][cut], points[1:][cut]], axis=1)[:, :, None]]),
    )


def _layers(cells: Cells, master: Surface) -> tuple[Ints, Ints]:
    """The layer (c,) of each cell, and the cells on slave facets that meet more than one."""
    count, nodes = len(cells.slave_facet), master.facets[cells.master_facet]
    key = cells.slave_facet[:, None] * len(master.points) + nodes
    met, column = np.unique(key, return_inverse=True)
    row = np.repeat(np.arange(count), nodes.shape[1])
    size = count + len(met)
    graph = sparse.coo_matrix((np.ones(len(row)), (row, count + column.ravel())), shape=(size, size))
    layer = connected_components(graph, directed=False)[1][:count].astype(np.int64)
    pairs = np.unique(np.stack([cells.slave_facet, layer], axis=1), axis=0)
    facets, layers = np.unique(pairs[:, 0], return_counts=True)
    return layer, np.flatnonzero(np.isin(cells.slave_facet, facets[layers > 1]))


def _together(keys: Ints) -> tuple[Ints, Ints]:
    """All pairs of rows with the same key, each row with itself too.

    >>> _together(np.array([7, 3, 7]))
    (array([0, 0, 1, 2, 2]), array([0, 2, 1, 0, 2]))
    """
    _, inverse, counts = np.unique(keys, return_inverse=True, return_counts=True)
    order, start = np.argsort(inverse, kind="stable"), np.cumsum(counts) - counts
    many = counts[inverse]
    i = np.repeat(np.arange(len(keys)), many)
    step = np.arange(len(i)) - np.repeat(np.cumsum(many) - many, many)
    return i, order[start[inverse[i]] + step]
