"""contact_NAME.png of a solid model: pressure with traction arrows, and the status, on the contact surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv
from matplotlib.colors import to_rgb

from stickslip.geometry.arrays import ROUNDING, SLIGHT, Array, Ints
from stickslip.geometry.units import SI, Units
from stickslip.solvers.results.step_result import OPEN, ContactState
from stickslip.workflows.formats.mesh_file import corner_cells
from stickslip.workflows.pictures.render import SHADED, grid_of, render
from stickslip.workflows.pictures.rigid import Rigid, stand, surfaces
from stickslip.workflows.pictures.sheet import COLOURS, DPI, LINE, STATUS_COLOURS, Sheet, show_image, span
from stickslip.workflows.pictures.view import FEW_CELLS, View, focus

Facets = Ints
Surface = tuple[Array, Facets, str]  # nodes, facets, their shape


def draw_surface(
    folder: Path,
    name: str,
    surface: Surface,
    contact: ContactState,
    head: str,
    units: Units = SI,
    obstacles: Sequence[Rigid] = (),
) -> Path:
    """Draw the pressure with arrows of tangential traction, and next to it the status: open, slip or stick.

    A curved surface, seen from above, lies on the obstacles as all was before it moved.
    """
    (points, facets, shape), contact = _closer(surface, contact)
    view, labels = view_of(points)
    beside = [] if labels else [one for one in surfaces(points, obstacles, 0.0) if one.n_points]
    if beside:
        view = View.isometric(np.vstack([points, *(one.points for one in beside)]))
    norm = span(contact.pressure)
    grid = grid_of(points, facets, shape)
    grid.point_data["pressure"] = contact.pressure
    arrows, longest = _arrows(points, contact, view)
    dual, owners = dual_cells(points, facets, shape)
    dual.cell_data["colour"] = np.array(
        [np.round(255 * np.array(to_rgb(STATUS_COLOURS[int(s)]))) for s in contact.status[owners]]
    ).astype(np.uint8)
    flat = labels is not None
    lit: dict[str, Any] = {"lighting": False} if flat else SHADED
    edges = grid.extract_all_edges() if len(facets) <= FEW_CELLS // 2 else None

    def add_edges(stage: Any) -> None:
        for one in beside:
            stand(stage, one)
        if edges is not None:
            stage.add_mesh(edges, color="#333333", line_width=1.0, opacity=0.25, lighting=False)

    def add_pressure(stage: Any) -> None:
        stage.add_mesh(
            grid, scalars="pressure", cmap=COLOURS, clim=(norm.vmin, norm.vmax), **lit, show_scalar_bar=False
        )
        add_edges(stage)
        if arrows is not None:
            stage.add_mesh(arrows, color="#d7301f", lighting=False)

    def add_status(stage: Any) -> None:
        stage.add_mesh(dual, scalars="colour", rgb=True, **lit)
        add_edges(stage)

    width, height = (3.6, 3.6 / view.aspect) if view.aspect > 1 else (3.6 * view.aspect, 3.6)
    left, foot, gap = (0.75, 1.25, 0.75) if flat else (0.3, 0.95, 0.4)
    sheet = Sheet(left + max(2 * width + gap, 5.0) + 0.3, foot + height + 0.75 + LINE, units=units)
    first = sheet.axes(left, foot, width, height)
    second = sheet.axes(left + width + gap, foot, width, height)
    show_image(first, view, render(view, round(width * DPI), add_pressure), labels)
    show_image(second, view, render(view, round(width * DPI), add_status), labels)
    if (contact.status != OPEN).any():
        sheet.colour_bar(sheet.axes(left, 0.5, width, 0.12), norm, "pressure [Pa]", orientation="horizontal")
    else:
        sheet.figure.text(left / sheet.width, 0.5 / sheet.height, "open everywhere", fontsize=9)
    sheet.status_legend(second, loc="upper center", bbox_to_anchor=(0.5, -(foot - 0.75) / height), borderpad=0)
    arrow_text = f"; arrows: tangential traction, longest {longest:.3g} {units.pressure}" if arrows is not None else ""
    title, caption, numbers = head.split("\n")
    sheet.head(title, f"{caption}{arrow_text}\n{numbers}", left)
    return sheet.save(folder / f"contact_{name}.png")


def view_of(points: Array) -> tuple[View, tuple[str, str] | None]:
    """View along an axis and labels of the others, if the surface is nearly flat and normal to it; else isometric.

    Args:
        points: (n, 3) [m].
    """
    spread = np.ptp(points, axis=0)
    thin = int(np.argmin(spread))
    if spread[thin] > spread.max() / 4:
        return View.isometric(points), None
    across, up = (i for i in range(3) if i != thin)
    return View.facing(points, across, up), ("xyz"[across], "xyz"[up])


def _closer(surface: Surface, contact: ContactState) -> tuple[Surface, ContactState]:
    """The facets near the touching nodes, see `focus`, and the state of the contact at their nodes."""
    points, facets, shape = surface
    facets = facets[focus(points, contact.status != OPEN)[facets].any(axis=1)]
    nodes, numbers = np.unique(facets, return_inverse=True)
    fields = {name: getattr(contact, name)[nodes] for name in ("pressure", "traction", "status")}
    return (points[nodes], numbers.reshape(facets.shape), shape), replace(contact, **fields)


def dual_cells(points: Array, facets: Facets, shape: str) -> tuple[pv.PolyData, Ints]:
    """Cut each facet into one quadrilateral for each corner; returns these and the node that each belongs to."""
    corners, _ = corner_cells(shape, facets)
    x = points[corners]
    centre = x.mean(axis=1, keepdims=True)
    after, before = (x + np.roll(x, -1, axis=1)) / 2, (x + np.roll(x, 1, axis=1)) / 2
    quads = np.stack([x, after, np.broadcast_to(centre, x.shape), before], axis=2).reshape(-1, 3)
    cells = np.column_stack([np.full(corners.size, 4), np.arange(4 * corners.size).reshape(-1, 4)])
    return pv.PolyData(quads, faces=cells.ravel()), corners.ravel()


def _arrows(points: Array, contact: ContactState, view: View) -> tuple[Any, float]:
    """Arrows of sigma_T at some of the nodes, moved slightly towards the viewer, and the largest |sigma_T| [Pa]."""
    size = np.linalg.norm(contact.traction, axis=1)
    longest = float(size.max(initial=0.0))
    chosen = _spread(points, 250)
    chosen = chosen[size[chosen] > SLIGHT * longest]
    if longest == 0.0 or not len(chosen):
        return None, 0.0
    extent = float(np.ptp(points, axis=0).max())
    towards = np.cross(view.right, view.up) * 0.02 * extent
    cloud = pv.PolyData(points[chosen] + towards)
    cloud.point_data["traction"] = contact.traction[chosen] / longest
    shape = pv.Arrow(tip_length=0.35, tip_radius=0.12, shaft_radius=0.035)
    return cloud.glyph(orient="traction", scale="traction", factor=0.12 * extent, geom=shape), longest


def _spread(points: Array, count: int) -> Ints:
    """About `count` of the points, the first in each box of a regular grid."""
    if len(points) <= count:
        return np.arange(len(points))
    low, extent = points.min(axis=0), np.ptp(points, axis=0)
    box = extent.max() / np.sqrt(count)
    keys = np.floor((points - low) / box + ROUNDING).astype(np.int64)
    return np.sort(np.unique(keys, axis=0, return_index=True)[1])
