"""deformed.png and stress_error.png: the deformed bodies, coloured by von Mises stress, and by its error."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.colors import LogNorm, Normalize

from stickslip.geometry.arrays import Array
from stickslip.geometry.units import SI, Units
from stickslip.solvers.results.step_result import OPEN, MeshData, StepResult
from stickslip.workflows.formats.steps import StoredStep, three
from stickslip.workflows.pictures.focus import close_up
from stickslip.workflows.pictures.render import SHADED, View, grid_of, render, surface_of
from stickslip.workflows.pictures.rigid import Rigid, shade, stand, surfaces
from stickslip.workflows.pictures.sheet import COLOURS, DPI, LINE, Sheet, decades, show_image, span

VISIBLE = 0.02  # relative to the size of the bodies: displacements from there on are drawn to scale
DRAWN = 0.08  # smaller ones are scaled so that the largest is about this fraction of the size
APART = 0.005  # relative to the size: largest gap or overlap with which touching bodies are drawn
MOST, ABOVE = 0.99, 1.5  # share of the cells that the colours tell apart, if the largest value is so many times higher
CLOSE_UP = 4.0  # largest side of the second view, of the contact alone [inch]
FEW_CELLS = 6000  # largest number of cells whose edges are drawn
EDGES: dict[str, Any] = {"color": "#222222", "line_width": 2.5}
GHOST: dict[str, Any] = {"color": "#8c8c8c", "line_width": 2.0}


class Coloured(NamedTuple):
    """What the cells are coloured by."""

    values: Array  # (cells,)
    norm: Normalize
    label: str


def draw_body(
    folder: Path, mesh: MeshData, result: StepResult, title: str, obstacles: Sequence[Rigid] = (), units: Units = SI
) -> Path:
    """Draw deformed.png: von Mises stress, the obstacles, and the outline of the undeformed bodies in grey."""
    norm, peak = span(result.von_mises), float(result.von_mises.max(initial=0.0))
    most = float(np.quantile(result.von_mises, MOST)) if len(result.von_mises) else peak
    label = f"von Mises stress [Pa], largest {peak:.3g}"
    if 0 < most < peak / ABOVE:  # a corner would leave one colour for all else
        norm = Normalize(norm.vmin, most)
    coloured = Coloured(result.von_mises, norm, label)
    return _draw(folder / "deformed.png", mesh, result, title, coloured, obstacles, units)


def draw_error(
    folder: Path, mesh: MeshData, result: StepResult, title: str, obstacles: Sequence[Rigid] = (), units: Units = SI
) -> Path:
    """Draw stress_error.png: what the mesh leaves in the stress of each cell, on a logarithmic scale."""
    error = result.stress_error
    coloured = Coloured(error, decades(error), "error of the stress, by the mesh [Pa]")
    said = f"the mesh leaves {100 * result.mesh_error:.2g} % of the displacement, in the energy norm"
    return _draw(folder / "stress_error.png", mesh, result, title, coloured, obstacles, units, said)


def _draw(
    path: Path,
    mesh: MeshData,
    result: StepResult,
    title: str,
    coloured: Coloured,
    obstacles: Sequence[Rigid],
    units: Units,
    more: str = "",
) -> Path:
    """Draw the deformed bodies in the colours; `more` is added to the caption."""
    solid = mesh.points.shape[1] == 3
    scale, norm = displacement_scale(mesh, result), coloured.norm
    both = np.vstack([three(mesh.points), three(mesh.points + scale * result.displacement)])
    rigid = [one for one in surfaces(both, obstacles, scale) if one.n_points] if solid else []
    both = np.vstack([both, *(surface.points for surface in rigid)])
    view = View.isometric(both) if solid else View.facing(both)
    close = None if solid else close_up(view, _touching(mesh, result))
    width, height = (6.0, 6.0 / view.aspect) if view.aspect > 1.3 else (4.6 * view.aspect, 4.6)
    beside = view.aspect <= 1.6
    left = 0.25 if solid else 0.8
    foot = (0.2 if solid else 0.55) + (0.0 if beside else 0.75)
    side = min(height, CLOSE_UP)
    wide = max(4.5, left + width + (1.3 if beside else 0.4))
    sheet = Sheet(wide + (side + 1.0 if close else 0.0), foot + height + 0.75 + LINE * bool(more), units=units)

    def show(left: float, view: View, width: float, height: float, scale: float) -> Any:
        bodies = body_on_stage(mesh, three(mesh.points + scale * result.displacement), coloured.values, norm)

        def add(stage: Any) -> None:
            bodies(stage)
            for surface in rigid:
                stand(stage, surface)

        axes = sheet.axes(left, foot, width, height)
        show_image(axes, view, render(view, round(width * DPI), add), None if solid else ("x", "y"))
        if not solid:
            shade(axes, view, obstacles, scale)
        return axes

    show(left, view, width, height, scale)
    if close:
        axes = show(sheet.width - side - 0.2, close, side, side, 1.0)
        axes.set_title("contact, true displacement", fontsize=9, loc="left")
    bar = (left + width + 0.2, foot + 0.1 * height, 0.15, 0.8 * height) if beside else (left, 0.5, width, 0.13)
    more_above = "max" if coloured.values.max(initial=0.0) > float(norm.vmax or 0.0) else "neither"
    sheet.colour_bar(sheet.axes(*bar), norm, coloured.label, "vertical" if beside else "horizontal", more_above)
    drawn = "true displacement" if scale == 1 else f"displacement × {plain(scale)}"
    caption = f"t = {result.time:g} s, {drawn}; grey: undeformed"
    sheet.head(title, "\n".join(filter(None, (caption, more))), left)
    return sheet.save(path)


def _touching(mesh: MeshData, result: StepResult) -> Array:
    """Places (k, 3) [m] of the contact points that touch."""
    nodes = [rows[result.contacts[name].status != OPEN] for name, rows in mesh.slaves.items()]
    each = np.concatenate([np.zeros(0, np.int64), *nodes])
    return three(mesh.points[each] + result.displacement[each])


def body_on_stage(mesh: MeshData, moved: Array, values: Array, norm: Normalize) -> Callable[[Any], None]:
    """A function that adds the bodies to a stage, deformed, with grey outlines of the undeformed bodies.

    Args:
        moved: places of the nodes as drawn (n, 3) [m].
        values: (cells,) [Pa].
        norm: range of the colours [Pa].
    """
    solid = mesh.points.shape[1] == 3
    cells = grid_of(mesh.points, mesh.cells, mesh.shape)
    cells.cell_data["values"] = np.maximum(values, float(norm.vmin or 0.0)) if isinstance(norm, LogNorm) else values
    cells.point_data["moved"] = moved
    before = surface_of(cells) if solid else cells  # only the surface is visible
    after = before.copy()
    after.points = after.point_data["moved"]

    def add(stage: Any) -> None:
        stage.add_mesh(
            after,
            scalars="values",
            cmap=COLOURS,
            clim=(norm.vmin, norm.vmax),
            log_scale=isinstance(norm, LogNorm),
            **(SHADED if solid else {"lighting": False}),
            show_edges=len(mesh.cells) <= FEW_CELLS,
            edge_color="#333333",
            edge_opacity=0.25,
            show_scalar_bar=False,
        )
        for grid, look in ((after, EDGES), (before, GHOST)):
            outline = _outline(grid, solid)
            if outline.n_cells:
                stage.add_mesh(outline, lighting=False, **look)

    return add


def displacement_scale(mesh: MeshData, result: StepResult | StoredStep) -> float:
    """A round factor (1, 2 or 5 times a power of ten) that makes displacements visible; 1 if they already are.

    A rigid motion of all nodes counts like any other displacement, and none is made smaller. The factor is limited
    where what touches had an initial gap or interference, because only the true displacement closes it.
    """
    largest = float(np.abs(result.displacement).max(initial=0.0))
    size = float(np.ptp(mesh.points, axis=0).max())
    if not 0 < largest < math.inf or largest >= VISIBLE * size:
        return 1.0
    closed = max(
        (np.abs(gap[result.contacts[name].status != OPEN]).max(initial=0.0) for name, gap in mesh.gaps.items()),
        default=0.0,
    )
    wanted = DRAWN * size / largest
    if wanted * closed > APART * size:
        wanted = min(wanted, 1 + APART * size / closed)
    decade = 10.0 ** math.floor(math.log10(wanted))
    return max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= wanted * (1 + 1e-12))


def _outline(grid: Any, solid: bool) -> Any:
    """Border of a plane body, or sharp edges of a solid."""
    if solid:  # cells may be mirror images: normals are made consistent before angles are measured
        grid = grid.compute_normals(point_normals=False, consistent_normals=True)
    return grid.extract_feature_edges(
        feature_angle=30.0,
        boundary_edges=not solid,
        feature_edges=solid,
        manifold_edges=False,
        non_manifold_edges=False,
    )


def plain(scale: float) -> str:
    """A factor as text: below a million in groups of three digits, without an exponent."""
    return f"{scale:,.0f}".replace(",", " ") if 1 <= scale < 1e6 else f"{scale:g}"
