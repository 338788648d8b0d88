"""Plane bodies as an image and lines, by numpy and matplotlib alone: their cells fill the pixels row by row."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize

from stickslip.geometry.arrays import Array, Ints
from stickslip.solvers.results.step_result import MeshData
from stickslip.workflows.formats.shapes import corner_cells
from stickslip.workflows.formats.steps import three
from stickslip.workflows.pictures.rigid import Rigid, shade
from stickslip.workflows.pictures.sheet import COLOURS, show_image
from stickslip.workflows.pictures.view import Image, View

FINER = 2  # an image is the mean of so many pixels in both directions
FEW_CELLS = 6000  # largest number of cells whose edges are drawn
EDGES: dict[str, Any] = {"colors": "#222222", "linewidths": 0.7}
GHOST: dict[str, Any] = {"colors": "#8c8c8c", "linewidths": 0.5}
GRID: dict[str, Any] = {"colors": "#333333", "linewidths": 0.36, "alpha": 0.18}


class PlaneBodies:
    """The bodies of a plane model; which cell a pixel shows is found once for all colours."""

    def __init__(self, mesh: MeshData, displacement: Array, obstacles: Sequence[Rigid], scale: float) -> None:
        """
        Args:
            displacement: (nodes, 2) [m].
            scale: factor on the displacement, with which they are seen as a whole.
        """
        self._points, self._displacement, self._obstacles = mesh.points, displacement, obstacles
        self.view = View.facing(three(np.vstack([mesh.points, mesh.points + scale * displacement])))
        self._cells, _ = corner_cells(mesh.shape, mesh.cells)
        self._shown: dict[tuple[float, ...], Ints] = {}

    def show(self, axes: Any, view: View, width: int, scale: float, values: Array, norm: Normalize) -> None:
        """Draw them in axes that show the view, with obstacles, and grey outlines of the undeformed bodies.

        Args:
            width: of the axes [pixels].
            scale: factor on the displacement.
            values: by which the cells are coloured (cells,).
            norm: range of the colours.
        """
        found, moved = self._cell_at(view, width, scale), self._points + scale * self._displacement
        show_image(axes, view, _coloured(found, values, norm), ("x", "y"))
        if len(self._cells) <= FEW_CELLS:
            axes.add_collection(LineCollection(list(moved[self._edges[0]]), **GRID))
        for points, look in ((moved, EDGES), (self._points, GHOST)):
            axes.add_collection(LineCollection(list(points[self._edges[1]]), capstyle="round", **look))
        shade(axes, view, self._obstacles, scale)

    def _cell_at(self, view: View, width: int, scale: float) -> Ints:
        """Index of the cell at each of the finer pixels; -1: none."""
        key = (*view.extent, width, scale)
        if key not in self._shown:
            columns, rows = FINER * width, FINER * max(1, round(width / view.aspect))
            moved = self._points + scale * self._displacement
            places = (moved - view.low) / view.size * (columns, rows)
            places[:, 1] = rows - places[:, 1]  # the first row is on top
            self._shown[key] = cells_at_pixels(places[self._cells], rows, columns)
        return self._shown[key]

    @cached_property
    def _edges(self) -> tuple[Ints, Ints]:
        """Nodes (e, 2) of all edges, and of those of one cell alone."""
        ends = np.sort(np.stack([self._cells, np.roll(self._cells, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
        keys, counts = np.unique(ends @ [len(self._points), 1], return_counts=True)
        every = np.stack(np.divmod(keys, len(self._points)), axis=-1)
        return every, every[counts == 1]


def cells_at_pixels(corners: Array, rows: int, columns: int) -> Ints:
    """Index of the cell that covers the middle of each pixel (rows, columns); the last one of several, -1 for none.

    Args:
        corners: of convex cells (c, k, 2), in order around each, as column and row, which count from the edge.

    >>> cells_at_pixels(np.array([[[0.0, 0.0], [3.0, 0.0], [0.0, 3.0]]]), 3, 4)
    array([[ 0,  0, -1, -1],
           [ 0, -1, -1, -1],
           [-1, -1, -1, -1]])
    """
    found = np.full((rows, columns), -1)
    y = corners[..., 1]
    cell, row = _counted(_first(y.min(axis=1), rows), _first(y.max(axis=1), rows))
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)
    upwards = ends[:, :, :1, 1] <= ends[:, :, 1:, 1]  # both cells of an edge find the same place on it
    ends = np.where(upwards[..., None], ends, ends[:, :, ::-1])[cell]
    (x, y), (x_end, y_end) = np.moveaxis(ends, (2, 3), (0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (row[:, None] + 0.5 - y) / (y_end - y)
        crossed = np.where((share >= 0) & (share <= 1), x + share * (x_end - x), np.nan)
    left, right = np.fmin.reduce(crossed, axis=1), np.fmax.reduce(crossed, axis=1)
    span, column = _counted(_first(left, columns), _first(right, columns))
    found[row[span], column] = cell[span]
    return found


def _first(places: Array, count: int) -> Ints:
    """The first of `count` pixels whose middle is not before these places."""
    return np.asarray(np.ceil(np.nan_to_num(places) - 0.5).clip(0, count), np.int64)


def _counted(first: Ints, last: Ints) -> tuple[Ints, Ints]:
    """Each number from `first` to before `last`, and which of the ranges it is of.

    >>> _counted(np.array([3, 0]), np.array([5, 1]))
    (array([0, 0, 1]), array([3, 4, 0]))
    """
    count = np.maximum(last - first, 0)
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) - (np.cumsum(count) - count - first)[owner]


def _coloured(found: Ints, values: Array, norm: Normalize) -> Image:
    """The image of cells (rows, columns) in the colours of their values, on white."""
    colours = np.full((len(values) + 1, 3), 255, np.uint16)
    clipped = np.clip(values, norm.vmin, norm.vmax)
    colours[:-1] = np.round(255 * colormaps[COLOURS](norm(clipped))[:, :3])
    pixels = colours[found]
    total = sum(pixels[i::FINER, k::FINER] for i in range(FINER) for k in range(FINER))
    return np.asarray(total // FINER**2, np.uint8)
