"""faces.png shows the faces or edges of a user's file with their numbers; another picture, two sides that touch."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from matplotlib import colormaps
from scipy.ndimage import distance_transform_edt, label

from stickslip.geometry.arrays import Array
from stickslip.geometry.units import SI, Units
from stickslip.geometry.user_files.outline import Facets, Outline, simplices
from stickslip.geometry.user_files.touching import Pair
from stickslip.workflows.pictures.render import render
from stickslip.workflows.pictures.sheet import CURVES, DPI, Sheet, show_image
from stickslip.workflows.pictures.view import Image, View

TEXT: dict[str, Any] = {"fontsize": 7, "ha": "center", "va": "center", "color": "#111111"}
PAPER: dict[str, Any] = {"boxstyle": "round,pad=0.15", "facecolor": "white", "alpha": 0.75, "linewidth": 0}
Draw = Callable[[Any, View, int], None]  # into axes that show a view, so many pixels wide


def draw_numbers(path: Path, entities: Sequence[Facets], title: str, units: Units = SI) -> Path:
    """Draw faces from two sides (3D), or edges (2D), each with its number."""
    points = np.concatenate([e.corners.reshape(-1, 3) for e in entities])
    solid = entities[0].corners.shape[1] > 2
    views = [View.isometric(points), _from_behind(points)] if solid else [View.facing(points)]

    def draw(axes: Any, view: View, width: int) -> None:
        (_draw_faces if solid else _draw_edges)(axes, view, entities, width)

    sheet = _side_by_side(views, 5.2, draw, units)
    word = "faces, from the front and from behind" if solid else "edges"
    sheet.head(title, f"numbers of {word}", 0.3)
    return sheet.save(path)


def _side_by_side(views: Sequence[View], side: float, draw: Draw, units: Units = SI) -> Sheet:
    """A sheet with views next to each other, the longer side of each [inch]."""
    widths = [min(side, side * view.aspect) for view in views]
    height = max(w / view.aspect for w, view in zip(widths, views, strict=True))
    sheet, left = Sheet(max(5.0, 0.3 + sum(w + 0.3 for w in widths)), height + 1.1, units=units), 0.3
    for view, width in zip(views, widths, strict=True):
        draw(sheet.axes(left, 0.3, width, width / view.aspect), view, round(width * DPI))
        left += width + 0.3
    return sheet


def _from_behind(points: Array) -> View:
    """The view opposite to the isometric one; it shows the faces that the isometric view hides."""
    front = View.isometric(points)
    back = np.cross(front.right, front.up)
    right = -front.right
    return View.around(points, right, np.cross(-back, right))


def _draw_faces(axes: Any, view: View, entities: Sequence[Facets], width: int) -> None:
    shades = np.array([colormaps["Set3"](i % 12)[:3] for i in range(len(entities))])
    codes = np.array([[(i + 1) // 256, (i + 1) % 256, 128] for i in range(len(entities))]) / 255

    def add(colours: Array, **look: Any) -> Image:
        def act(stage: Any) -> None:
            for facets, colour in zip(entities, colours, strict=True):
                _mesh(stage, [facets], color=colour.tolist(), **look)

        return render(view, width, act)

    show_image(axes, view, add(shades, lighting=True, ambient=0.5, diffuse=0.5), None)
    flat = add(codes, lighting=False)
    for i, x, y in visible_places(flat, len(entities)):
        right = view.low[0] + (x + 0.5) / flat.shape[1] * view.size[0]
        up = view.high[1] - (y + 0.5) / flat.shape[0] * view.size[1]
        axes.text(right, up, str(entities[i].number), bbox=PAPER, **TEXT)


def visible_places(flat: Image, count: int) -> Iterator[tuple[int, int, int]]:
    """Index of each visible entity, with column and row of the innermost pixel of its largest visible part.

    Parts where that is less than four pixels from the edge get no number.
    """
    found = flat[..., 0].astype(int) * 256 + flat[..., 1] - 1
    found[flat[..., 2] != 128] = -1
    for i in range(count):
        parts, _ = label(found == i)
        if not parts.any():
            continue
        largest = parts == np.argmax(np.bincount(parts.ravel())[1:]) + 1
        depth = distance_transform_edt(np.pad(largest, 1))[1:-1, 1:-1]
        y, x = np.unravel_index(int(np.argmax(depth)), depth.shape)
        if depth[y, x] >= 4:
            yield i, int(x), int(y)


def _draw_edges(axes: Any, view: View, entities: Sequence[Facets], width: int) -> None:
    for facets in entities:
        _lines(axes, view, facets.corners, color="#2f6db3", lw=1.2, marker=".", ms=1)
        middle = facets.corners[len(facets.corners) // 2, :, :2].mean(axis=0)
        axes.text(*middle, str(facets.number), bbox=PAPER, **TEXT)
    axes.set_xlabel("x [m]", fontsize=8)
    axes.set_ylabel("y [m]", fontsize=8)


def draw_pair(path: Path, outline: Outline, pair: Pair, names: tuple[str, str]) -> Path:
    """Draw where a pair lies in the assembly, and from near; in 2D only the edges.

    Args:
        names: of its sides.
    """
    everything = np.concatenate([face.corners.reshape(-1, 3) for face in outline.entities])
    touching, solid = pair.points, pair.one.corners.shape[1] == 3
    middle = (touching.min(axis=0) + touching.max(axis=0)) / 2
    # sides that touch in a point are drawn too
    extent = max(np.ptp(touching, axis=0).max(), np.ptp(pair.one.corners, axis=(0, 1)).max() / 100)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in ((-1, 1) if solid else (0,))])
    near = middle + 0.75 * float(extent) * corners
    views = [(View.isometric if solid else View.facing)(points) for points in (everything, near)]

    def draw(axes: Any, view: View, width: int) -> None:
        if solid:
            show_image(axes, view, render(view, width, lambda stage: _add_pair(stage, outline, pair)), None)
            return
        for face in outline.entities:
            _lines(axes, view, face.corners, color="#888888", lw=0.8)
        for side, colour in zip((pair.one, pair.other), CURVES, strict=False):
            _lines(axes, view, side.corners, color=colour, lw=2.0)

    sheet = _side_by_side(views, 4.2, draw)
    said = f"{pair.kind}; in the assembly, and from near; blue and orange: the sides, red: where they touch"
    sheet.head(f"{names[0]} and {names[1]}", said, 0.3)
    return sheet.save(path)


def _add_pair(stage: Any, outline: Outline, pair: Pair) -> None:
    rest = [face for face in outline.entities if not {pair.one.body, pair.other.body} & set(face.bodies)]
    if rest:
        _mesh(stage, rest, color="#888888", opacity=0.04)
    for side, colour in zip((pair.one, pair.other), CURVES, strict=False):
        _mesh(stage, [face for face in outline.entities if side.body in face.bodies], color=colour, opacity=0.12)
        _mesh(stage, side.faces, color=colour, opacity=0.4)
    stage.add_mesh(pv.PolyData(np.asarray(pair.points, float)), color="#b00020", point_size=5.0)


def _mesh(stage: Any, faces: Iterable[Facets], **look: Any) -> None:
    corners = simplices(face.corners for face in faces)
    rows = np.column_stack([np.full(len(corners), 3), np.arange(3 * len(corners)).reshape(-1, 3)])
    stage.add_mesh(pv.PolyData(np.asarray(corners.reshape(-1, 3), float), rows.ravel()), **look)


def _lines(axes: Any, view: View, corners: Array, **look: Any) -> None:
    """Draw edges (f, 2, 3) in axes that show the view."""
    axes.plot(*np.moveaxis(corners[:, :, :2], 2, 0).transpose(0, 2, 1), **look)
    axes.set_xlim(view.low[0], view.high[0])
    axes.set_ylim(view.low[1], view.high[1])
