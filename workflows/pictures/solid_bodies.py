"""Deformed bodies on a stage of VTK: cells in the colours of their values, outlines, what was there before in grey."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm, Normalize

from stickslip.geometry.arrays import Array
from stickslip.solvers.results.step_result import MeshData
from stickslip.workflows.pictures.render import SHADED, grid_of, render, surface_of
from stickslip.workflows.pictures.rigid import Rigid, stand, surfaces
from stickslip.workflows.pictures.sheet import COLOURS, show_image
from stickslip.workflows.pictures.view import View

FEW_CELLS = 6000  # largest number of cells whose edges are drawn
EDGES: dict[str, Any] = {"color": "#222222", "line_width": 2.5}
GHOST: dict[str, Any] = {"color": "#8c8c8c", "line_width": 2.0}


class SolidBodies:
    """The bodies of a solid model and the obstacles around them."""

    def __init__(self, mesh: MeshData, displacement: Array, obstacles: Sequence[Rigid], scale: float) -> None:
        """
        Args:
            displacement: (nodes, 3) [m].
            scale: factor on the displacement, with which they are seen as a whole.
        """
        self._mesh, self._displacement = mesh, displacement
        both = np.vstack([mesh.points, mesh.points + scale * displacement])
        self._obstacles = [one for one in surfaces(both, obstacles, scale) if one.n_points]
        self.view = View.isometric(np.vstack([both, *(surface.points for surface in self._obstacles)]))

    def show(self, axes: Any, view: View, width: int, scale: float, values: Array, norm: Normalize) -> None:
        """Draw them in axes of so many pixels; see `PlaneBodies.show`."""
        bodies = body_on_stage(self._mesh, self._mesh.points + scale * self._displacement, values, norm)

        def add(stage: Any) -> None:
            bodies(stage)
            for surface in self._obstacles:
                stand(stage, surface)

        show_image(axes, view, render(view, width, add), None)


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
            outline = outline_of(grid, solid)
            if outline.n_cells:
                stage.add_mesh(outline, lighting=False, **look)

    return add


def outline_of(grid: Any, solid: bool) -> Any:
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
