"""faces.png shows the faces or edges of a user's file with their numbers; another picture, two sides that touch."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from matplotlib import colormaps
from scipy.ndimage import distance_transform_edt, label

from stickslip.geometry.arrays import Array
from stickslip.geometry.units import SI, Units
from stickslip.geometry.user_files.outline import Facets, Outline
from stickslip.geometry.user_files.touching import Pair, simplices
from stickslip.workflows.pictures.render import render
from stickslip.workflows.pictures.sheet import CURVES, DPI, Sheet, show_image
from stickslip.workflows.pictures.view import Image, View

SIDE = 5.2  # largest width of a view [inch]
LEAST = 4  # distance to the edge in pixels; visible parts that are narrower get no number
TEXT: dict[str, Any] = {"fontsize": 7, "ha": "center", "va": "center", "color": "#111111"}
PAPER: dict[str, Any] = {"boxstyle": "round,pad=0.15", "facecolor": "white", "alpha": 0.75, "linewidth": 0}
WIDTH = 4.2  # of a view [inch]
COLOURED, GLASS, CLEAR = 0.4, 0.12, 0.04  # opacity of the two sides, of their bodies, and of the others
POINT = 5.0  # [pixels] of the points that touch
POINTED = 0.01  # of the smaller side is drawn at least, where sides touch in a point
NEAR = 1.5  # the near view is so many times as wide as the smaller side


def draw_numbers(path: Path, entities: Sequence[Facets], title: str, units: Units = SI) -> Path:
    """Draw faces from two sides (3D), or edges (2D), each with its number."""
    points = np.concatenate([e.corners.reshape(-1, 3) for e in entities])
    solid = entities[0].corners.shape[1] > 2
    views = [View.isometric(points), _from_behind(points)] if solid else [View.facing(points)]
    width = min(SIDE, SIDE * views[0].aspect)
    height = width / min(view.aspect for view in views)
    sheet = Sheet(max(4.5, 0.3 + len(views) * (width + 0.3)), height + 1.1, units=units)
    for i, view in enumerate(views):
        axes = sheet.axes(0.3 + i * (width + 0.3), 0.3, width, width / view.aspect)
        if solid:
            _draw_faces(axes, view, entities, round(width * DPI))
        else:
            _draw_edges(axes, view, entities)
    word = "faces, from the front and from behind" if solid else "edges"
    sheet.head(title, f"numbers of {word}", 0.3)
    return sheet.save(path)


def _from_behind(points: Array) -> View:
    """The view opposite to the isometric one; it shows the faces that the isometric view hides."""
    front = View.isometric(points)
    back = np.cross(front.right, front.up)
    right = -front.right
    return View.around(points, right, np.cross(-back, right))


def _draw_faces(axes: Any, view: View, entities: Sequence[Facets], width: int) -> None:
    shades = np.array([colormaps["Set3"](i % 12)[:3] for i in range(len(entities))])
    lit = render(view, width, lambda stage: _add(stage, entities, shades, lighting=True, ambient=0.5, diffuse=0.5))
    codes = np.array([[(i + 1) // 256, (i + 1) % 256, 128] for i in range(len(entities))]) / 255
    flat = render(view, width, lambda stage: _add(stage, entities, codes, lighting=False))
    show_image(axes, view, lit, None)
    for i, x, y in visible_places(flat, len(entities)):
        right = view.low[0] + (x + 0.5) / flat.shape[1] * view.size[0]
        up = view.high[1] - (y + 0.5) / flat.shape[0] * view.size[1]
        axes.text(right, up, str(entities[i].number), bbox=PAPER, **TEXT)


def _add(stage: Any, entities: Sequence[Facets], colours: Array, **look: Any) -> None:
    for facets, colour in zip(entities, colours, strict=True):
        f, k = facets.corners.shape[:2]
        rows = np.column_stack([np.full(f, k), np.arange(f * k).reshape(f, k)])
        surface = pv.PolyData(np.asarray(facets.corners.reshape(-1, 3), float), rows.ravel())
        stage.add_mesh(surface, color=colour.tolist(), **look)


def visible_places(flat: Image, count: int) -> Iterator[tuple[int, int, int]]:
    """Index of each visible entity, with column and row of the innermost pixel of its largest visible part."""
    found = flat[..., 0].astype(int) * 256 + flat[..., 1] - 1
    found[flat[..., 2] != 128] = -1
    for i in range(count):
        parts, _ = label(found == i)
        if not parts.any():
            continue
        largest = parts == np.argmax(np.bincount(parts.ravel())[1:]) + 1
        depth = distance_transform_edt(np.pad(largest, 1))[1:-1, 1:-1]
        y, x = np.unravel_index(int(np.argmax(depth)), depth.shape)
        if depth[y, x] >= LEAST:
            yield i, int(x), int(y)


def _draw_edges(axes: Any, view: View, entities: Sequence[Facets]) -> None:
    for facets in entities:
        x = facets.corners[:, :, :2]
        axes.plot(*np.moveaxis(x, 2, 0).transpose(0, 2, 1), color="#2f6db3", lw=1.2, marker=".", ms=1)
        middle = x.mean(axis=1)[len(x) // 2]
        axes.text(*middle, str(facets.number), bbox=PAPER, **TEXT)
    left, right, bottom, top = view.extent
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    axes.set_xlabel("x [m]", fontsize=8)
    axes.set_ylabel("y [m]", fontsize=8)


def draw_pair(path: Path, outline: Outline, pair: Pair, names: tuple[str, str]) -> Path:
    """Draw where a pair lies in the assembly, and from near; in 2D only the edges.

    Args:
        names: of its sides.
    """
    everything = np.concatenate([face.corners.reshape(-1, 3) for face in outline.entities])
    touching = pair.points
    solid = pair.one.corners.shape[1] == 3
    middle = (touching.min(axis=0) + touching.max(axis=0)) / 2
    extent = max(np.ptp(touching, axis=0).max(), POINTED * np.ptp(pair.one.corners, axis=(0, 1)).max())
    reach = NEAR * float(extent) / 2
    around = middle + reach * np.array(
        [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in ((-1, 1) if solid else (0,))]
    )
    views = [(View.isometric if solid else View.facing)(points) for points in (everything, around)]
    width = [min(WIDTH, WIDTH * view.aspect) for view in views]
    height = max(w / view.aspect for w, view in zip(width, views, strict=True))
    sheet = Sheet(max(5.0, 0.9 + sum(width)), height + 1.1)
    left = 0.3
    for view, wide in zip(views, width, strict=True):
        axes = sheet.axes(left, 0.3, wide, wide / view.aspect)
        if solid:
            show_image(axes, view, render(view, round(wide * DPI), lambda stage: _add_pair(stage, outline, pair)), None)
        else:
            _draw_pair_edges(axes, view, outline, pair)
        left += wide + 0.3
    sheet.head(
        f"{names[0]} and {names[1]}",
        f"{pair.kind}; in the assembly, and from near; blue and orange: the sides, red: where they touch",
        0.3,
    )
    return sheet.save(path)


def _add_pair(stage: Any, outline: Outline, pair: Pair) -> None:
    rest = [face for face in outline.entities if not {pair.one.body, pair.other.body} & set(face.bodies)]
    if rest:
        _mesh(stage, rest, color="#888888", opacity=CLEAR)
    for side, colour in ((pair.one, CURVES[0]), (pair.other, CURVES[1])):
        _mesh(stage, [face for face in outline.entities if side.body in face.bodies], color=colour, opacity=GLASS)
        _mesh(stage, side.faces, color=colour, opacity=COLOURED)
    stage.add_mesh(pv.PolyData(np.asarray(pair.points, float)), color="#b00020", point_size=POINT)


def _mesh(stage: Any, faces: Iterable[Facets], **look: Any) -> None:
    corners = simplices(face.corners for face in faces)
    rows = np.column_stack([np.full(len(corners), 3), np.arange(3 * len(corners)).reshape(-1, 3)])
    stage.add_mesh(pv.PolyData(np.asarray(corners.reshape(-1, 3), float), rows.ravel()), **look)


def _draw_pair_edges(axes: Any, view: View, outline: Outline, pair: Pair) -> None:
    def draw(corners: Array, colour: str, width: float) -> None:
        axes.plot(*np.moveaxis(corners[:, :, :2], 2, 0).transpose(0, 2, 1), color=colour, lw=width)

    for face in outline.entities:
        draw(face.corners, "#888888", 0.8)
    for side, colour in ((pair.one, CURVES[0]), (pair.other, CURVES[1])):
        draw(side.corners, colour, 2.0)
    left, right, bottom, top = view.extent
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
