"""deformed.png and stress_error.png: the deformed bodies, coloured by von Mises stress, and by its error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import EXACT, Array, Bools, Ints
from stickslip.geometry.units import SI, Units
from stickslip.solvers.results.step_result import OPEN, MeshData, StepResult
from stickslip.workflows.formats.mesh_file import corner_cells
from stickslip.workflows.formats.steps import StoredStep, three
from stickslip.workflows.pictures.rigid import Rigid, shade
from stickslip.workflows.pictures.sheet import COLOURS, DPI, LINE, STATUS_COLOURS, Sheet, decades, show_image, span
from stickslip.workflows.pictures.view import FEW_CELLS, Image, View, close_up, focus

FINER = 2  # an image is the mean of so many pixels in both directions
EDGES: dict[str, Any] = {"colors": "#222222", "linewidths": 0.7}
GHOST: dict[str, Any] = {"colors": "#8c8c8c", "linewidths": 0.5}
GRID: dict[str, Any] = {"colors": "#333333", "linewidths": 0.36, "alpha": 0.18}


class Bodies(Protocol):
    """Bodies as they are drawn, see `PlaneBodies` and `SolidBodies`."""

    view: View

    def show(self, axes: Any, view: View, width: int, scale: float, values: Array, norm: Normalize) -> None: ...


class BodyPictures:
    """Pictures of the deformed bodies in a step, in one window; rank 0 only."""

    def __init__(
        self, mesh: MeshData, result: StepResult, title: str, obstacles: Sequence[Rigid] = (), units: Units = SI
    ) -> None:
        """
        Args:
            obstacles: at the time of the step.
            units: of the labels.
        """
        self._mesh, self._result, self._title, self._units = mesh, result, title, units
        self._solid, self._scale = mesh.points.shape[1] == 3, displacement_scale(mesh, result)
        self._bodies: Bodies
        if self._solid:
            from stickslip.workflows.pictures.render import SolidBodies  # with VTK

            self._bodies = SolidBodies(mesh, result.displacement, obstacles, self._scale)
        else:
            self._bodies = PlaneBodies(mesh, result.displacement, obstacles, self._scale)

    def draw_stress(self, folder: Path) -> Path:
        """Draw deformed.png: von Mises stress, the obstacles, and the outline of the undeformed bodies in grey."""
        values = self._result.von_mises
        label = f"von Mises stress [Pa], largest {float(values.max(initial=0.0)):.3g}"
        return self._draw(folder / "deformed.png", values, self._stresses, label)

    @cached_property
    def _stresses(self) -> Normalize:
        """Range of the colours of von Mises stress."""
        values = self._result.von_mises
        norm, peak = span(values), float(values.max(initial=0.0))
        most = float(np.quantile(values, 0.99)) if len(values) else peak
        # a corner would leave one colour for all else
        return Normalize(norm.vmin, most) if 0 < most < peak / 1.5 else norm

    def view_of_contact(self, name: str, touching: Bools) -> View:
        """Window on a contact of a plane model, as wide as high or up to 2.2 times wider.

        Args:
            touching: nodes (n,) of its line that it is about, see `focus`.
        """
        nodes = self._mesh.slaves[name]
        points = (self._mesh.points + self._result.displacement)[nodes]
        shown = View.facing(three(points[focus(points, touching)]))
        half = shown.size / 2
        half = np.maximum(half, [half[1], half[0] / 2.2])
        middle = (shown.low + shown.high) / 2
        return View(shown.right, shown.up, middle - half, middle + half)

    def show_contact(self, axes: Any, view: View, name: str, width: int) -> None:
        """Show a contact of a plane model where it is: bodies, obstacles, and the status along its line."""
        self._bodies.show(axes, view, width, 1.0, self._result.von_mises, self._stresses)
        lines, colours = status_line(self._mesh, name, self._result.displacement, self._result.contacts[name].status)
        axes.add_collection(LineCollection(lines, colors=colours, linewidths=3.0, zorder=3), autolim=False)

    def draw_error(self, folder: Path) -> Path:
        """Draw stress_error.png: what the mesh leaves in the stress of each cell, on a logarithmic scale."""
        error, label = self._result.stress_error, "error of the stress, by the mesh [Pa]"
        said = f"the mesh leaves {100 * self._result.mesh_error:.2g} % of the displacement, in the energy norm"
        return self._draw(folder / "stress_error.png", error, decades(error), label, said)

    def _draw(self, path: Path, values: Array, norm: Normalize, label: str, more: str = "") -> Path:
        """Draw the bodies in the colours of values (cells,); `more` is added to the caption."""
        result, scale, view, solid = self._result, self._scale, self._bodies.view, self._solid
        close = None if solid else close_up(view, _touching(self._mesh, result))
        width, height = (6.0, 6.0 / view.aspect) if view.aspect > 1.3 else (4.6 * view.aspect, 4.6)
        beside = view.aspect <= 1.6
        left = 0.25 if solid else 0.8
        foot = (0.2 if solid else 0.55) + (0.0 if beside else 0.75)
        side = min(height, 4.0)
        wide = max(4.5, left + width + (1.3 if beside else 0.4))
        sheet = Sheet(
            wide + (side + 1.0 if close else 0.0), foot + height + 0.75 + LINE * bool(more), units=self._units
        )
        self._bodies.show(sheet.axes(left, foot, width, height), view, round(width * DPI), scale, values, norm)
        if close:
            axes = sheet.axes(sheet.width - side - 0.2, foot, side, side)
            self._bodies.show(axes, close, round(side * DPI), 1.0, values, norm)
            axes.set_title("contact, true displacement", fontsize=9, loc="left")
        bar = (left + width + 0.2, foot + 0.1 * height, 0.15, 0.8 * height) if beside else (left, 0.5, width, 0.13)
        more_above = "max" if values.max(initial=0.0) > float(norm.vmax or 0.0) else "neither"
        sheet.colour_bar(sheet.axes(*bar), norm, label, "vertical" if beside else "horizontal", more_above)
        drawn = "true displacement" if scale == 1 else f"displacement × {plain(scale)}"
        caption = f"t = {result.time:g} s, {drawn}; grey: undeformed"
        sheet.head(self._title, "\n".join(filter(None, (caption, more))), left)
        return sheet.save(path)


def status_line(mesh: MeshData, name: str, motion: Array, status: NDArray[np.int8]) -> tuple[list[Array], list[str]]:
    """The deformed contact line, each half of a facet (2, 2) [m] in the colour of the node at its end."""
    points, facets = (mesh.points + motion)[mesh.slaves[name]], mesh.surfaces[name][1]
    along = (facets[:, 0], *facets[:, 2:].T, facets[:, 1])  # dolfinx numbers middle nodes last
    pairs = np.concatenate([np.stack(pair, axis=1) for pair in pairwise(along)])
    middle = points[pairs].mean(axis=1)
    ends = [np.stack([points[pairs[:, k]], middle], axis=1) for k in (0, 1)]
    return [*np.concatenate(ends)], [STATUS_COLOURS[int(s)] for s in status[pairs].T.ravel()]


def _touching(mesh: MeshData, result: StepResult) -> Array:
    """Places (k, 3) [m] of the contact points that touch."""
    nodes = [rows[result.contacts[name].status != OPEN] for name, rows in mesh.slaves.items()]
    each = np.concatenate([np.zeros(0, np.int64), *nodes])
    return three(mesh.points[each] + result.displacement[each])


def displacement_scale(mesh: MeshData, result: StepResult | StoredStep) -> float:
    """A round factor (1, 2 or 5 times a power of ten) that makes displacements visible; 1 if they already are.

    They are from 2 % of the bodies' size on; smaller ones become up to 8 % of it. A rigid motion of all nodes counts
    like any other displacement, and none is made smaller. The factor is limited where what touches had an initial gap
    or interference, because only the true displacement closes it: by half a per cent of the size.
    """
    largest = float(np.abs(result.displacement).max(initial=0.0))
    size = float(np.ptp(mesh.points, axis=0).max())
    if not 0 < largest < math.inf or largest >= 0.02 * size:
        return 1.0
    closed = max(
        (np.abs(gap[result.contacts[name].status != OPEN]).max(initial=0.0) for name, gap in mesh.gaps.items()),
        default=0.0,
    )
    wanted = 0.08 * size / largest
    return round_below(min(wanted, 1 + 0.005 * size / closed) if closed else wanted)


def round_below(wanted: float) -> float:
    """The largest of 1, 2, 5 times powers of ten that is not above."""
    decade = 10.0 ** math.floor(math.log10(wanted))
    return max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= wanted * (1 + EXACT))


def plain(scale: float) -> str:
    """A factor as text: below a million in groups of three digits, without an exponent."""
    return f"{scale:,.0f}".replace(",", " ") if 1 <= scale < 1e6 else f"{scale:g}"


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
        self._cells, self._corners = mesh.cells, corner_cells(mesh.shape, mesh.cells)[0]
        degree = dx.degree_of(mesh.shape, mesh.cells.shape[1])
        places, self._pieces, self._sides = straight_pieces(self._corners.shape[1], degree**2)
        self._basis = dx.reference_basis(mesh.shape, degree, places)[0]
        self._shown: dict[tuple[float, ...], Ints] = {}

    def show(self, axes: Any, view: View, width: int, scale: float, values: Array, norm: Normalize) -> None:
        """Draw them in axes that show the view, with obstacles, and grey outlines of the undeformed bodies.

        Args:
            width: of the axes [pixels].
            scale: factor on the displacement.
            values: by which the cells are coloured (cells,).
            norm: range of the colours.
        """
        show_image(axes, view, _coloured(self._cell_at(view, width, scale), values, norm), ("x", "y"))
        now, before = (self._edges_at(part * self._displacement) for part in (scale, 0.0))
        if len(self._cells) <= FEW_CELLS:
            axes.add_collection(LineCollection(list(now[self._edges[0]]), **GRID))
        for lines, look in ((now, EDGES), (before, GHOST)):
            axes.add_collection(LineCollection(list(lines[self._edges[1]]), capstyle="round", **look))
        shade(axes, view, self._obstacles, scale)
        axes.set_xlim(view.low[0], view.high[0])  # what is drawn besides reaches farther
        axes.set_ylim(view.low[1], view.high[1])

    def _cell_at(self, view: View, width: int, scale: float) -> Ints:
        """Index of the cell at each of the finer pixels; -1: none."""
        key = (*view.extent, width, scale)
        if key not in self._shown:
            columns, rows = FINER * width, FINER * max(1, round(width / view.aspect))
            places = (self._at(scale * self._displacement) - view.low) / view.size * (columns, rows)
            places[..., 1] = rows - places[..., 1]  # the first row is on top
            pieces = places[:, self._pieces].reshape(-1, self._pieces.shape[1], 2)
            found = cells_at_pixels(pieces, rows, columns)
            self._shown[key] = np.where(found < 0, -1, found // len(self._pieces))
        return self._shown[key]

    def _at(self, displacement: Array) -> Array:
        """Places (c, q, 2) [m] of the points of `straight_pieces` in all cells, moved by (nodes, 2) [m]."""
        return np.asarray(np.einsum("qk,ckd->cqd", self._basis, (self._points + displacement)[self._cells]))

    def _edges_at(self, displacement: Array) -> Array:
        """Lines (c k, n + 1, 2) [m] along the edges of all cells."""
        return self._at(displacement)[:, self._sides].reshape(-1, self._sides.shape[1], 2)

    @cached_property
    def _edges(self) -> tuple[Ints, Ints]:
        """Which of these lines are an edge each, and which the edges of one cell alone."""
        ends = np.sort(np.stack([self._corners, np.roll(self._corners, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
        _, every, counts = np.unique(ends @ [len(self._points), 1], return_index=True, return_counts=True)
        return every, every[counts == 1]


def straight_pieces(corners: int, n: int) -> tuple[Array, Ints, Ints]:
    """Straight pieces of a reference triangle or square, whose sides are curved on the mesh, n along each edge.

    Returns:
        Points (q, 2), the pieces (s, k) in order around each, and the edges (k, n + 1) from corner to corner.

    >>> straight_pieces(3, 1)[1:]
    (array([[0, 1, 2]]), array([[0, 1],
           [1, 2],
           [2, 0]]))
    """
    grid = [(i, j) for j in range(n + 1) for i in range(n + 1) if corners == 4 or i + j <= n]
    number = {place: k for k, place in enumerate(grid)}
    around = [(0, 0), (1, 0), (1, 1), (0, 1)] if corners == 4 else [(0, 0), (1, 0), (0, 1)]
    kinds = [around] if corners == 4 else [around, [(1, 0), (1, 1), (0, 1)]]
    each = ([(i + a, j + b) for a, b in kind] for i, j in grid for kind in kinds)
    pieces = [[number[place] for place in piece] for piece in each if all(place in number for place in piece)]
    ways = zip(around, [*around[1:], around[0]], strict=True)
    edges = [[number[a * (n - t) + c * t, b * (n - t) + d * t] for t in range(n + 1)] for (a, b), (c, d) in ways]
    return np.array(grid) / n, np.array(pieces), np.array(edges)


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
