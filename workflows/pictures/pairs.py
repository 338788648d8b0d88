"""The picture of two sides that touch: through their bodies, which are drawn as glass, and from the assembly's view."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from stickslip.geometry.arrays import Array
from stickslip.geometry.user_files.outline import Facets, Outline
from stickslip.geometry.user_files.touching import Pair, simplices
from stickslip.workflows.pictures.render import render
from stickslip.workflows.pictures.sheet import CURVES, DPI, Sheet, show_image
from stickslip.workflows.pictures.view import View

WIDTH = 4.2  # of a view [inch]
COLOURED, GLASS, CLEAR = 0.4, 0.12, 0.04  # opacity of the two sides, of their bodies, and of the others
POINT = 5.0  # [pixels] of the points that touch
POINTED = 0.01  # of the smaller side is drawn at least, where sides touch in a point
NEAR = 1.5  # the near view is so many times as wide as the smaller side


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
            show_image(axes, view, render(view, round(wide * DPI), lambda stage: _add(stage, outline, pair)), None)
        else:
            _draw_edges(axes, view, outline, pair)
        left += wide + 0.3
    sheet.head(
        f"{names[0]} and {names[1]}",
        f"{pair.kind}; in the assembly, and from near; blue and orange: the sides, red: where they touch",
        0.3,
    )
    return sheet.save(path)


def _add(stage: Any, outline: Outline, pair: Pair) -> None:
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


def _draw_edges(axes: Any, view: View, outline: Outline, pair: Pair) -> None:
    def draw(corners: Array, colour: str, width: float) -> None:
        axes.plot(*np.moveaxis(corners[:, :, :2], 2, 0).transpose(0, 2, 1), color=colour, lw=width)

    for face in outline.entities:
        draw(face.corners, "#888888", 0.8)
    for side, colour in ((pair.one, CURVES[0]), (pair.other, CURVES[1])):
        draw(side.corners, colour, 2.0)
    left, right, bottom, top = view.extent
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
