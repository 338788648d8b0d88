"""Solid bodies, and whatever else VTK draws, in parallel projection, as images that matplotlib can show to scale."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import pyvista as pv
from matplotlib.colors import LogNorm, Normalize
from vtkmodules.vtkCommonCore import vtkLogger
from vtkmodules.vtkFiltersGeometry import vtkDataSetSurfaceFilter

from stickslip.geometry.arrays import Array, Ints
from stickslip.solvers.results.step_result import MeshData
from stickslip.workflows.formats.mesh_file import shape_of
from stickslip.workflows.formats.steps import three
from stickslip.workflows.pictures.rigid import Rigid, stand, surfaces
from stickslip.workflows.pictures.sheet import COLOURS, show_image
from stickslip.workflows.pictures.view import FEW_CELLS, Image, View

SHADED: dict[str, Any] = {"lighting": True, "ambient": 0.6, "diffuse": 0.45}  # edges show, colours stay near the bar's
OFF_SCREEN = ("libEGL.so.1", "libOSMesa.so.8")  # VTK crashes where it finds none of them
EDGES: dict[str, Any] = {"color": "#222222", "line_width": 2.5}
GHOST: dict[str, Any] = {"color": "#8c8c8c", "line_width": 2.0}


def grid_of(points: Array, cells: Ints, shape: str) -> pv.UnstructuredGrid:
    """Cells in dolfinx's order, points (n, 2 or 3), as a grid of VTK; sides of order 2 are curved."""
    kind = shape_of(shape, cells)
    return pv.UnstructuredGrid({kind.vtk: cells[:, kind.order]}, three(points))


def surface_of(grid: pv.UnstructuredGrid) -> pv.PolyData:
    """Outer faces of cells with all data; by VTK, since pyvista's own filter warns in one version and lacks in another
    the argument that stops it."""
    found = vtkDataSetSurfaceFilter()
    found.SetInputData(grid)
    found.Update()
    return pv.wrap(found.GetOutput())


def render(view: View, width: int, add: Callable[[Any], None]) -> Image:
    """Draw what `add` puts on the stage, `width` pixels wide, on white.

    Raises:
        RuntimeError: there is neither a display nor a library that draws without.
    """
    if not os.environ.get("DISPLAY") and not any(map(_loads, OFF_SCREEN)):
        raise RuntimeError("without a display VTK needs a library: Debian's libegl1 or libosmesa6")
    window = (width, max(1, round(width / view.aspect)))
    with _quiet():
        stage: Any = pv.Plotter(off_screen=True, window_size=list(window), lighting="none")
        try:
            stage.set_background("white")
            stage.enable_anti_aliasing("ssaa")
            _light(stage, view)
            add(stage)
            _aim(stage, view)
            return np.asarray(stage.screenshot(return_img=True), np.uint8)
        finally:
            stage.close()


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _aim(stage: Any, view: View) -> None:
    back = np.cross(view.right, view.up)
    bounds = np.reshape(stage.bounds, (3, 2))
    middle = bounds.mean(axis=1)
    centre = view.right * (view.low + view.high)[0] / 2 + view.up * (view.low + view.high)[1] / 2
    centre = centre + back * (middle @ back)
    distance = 2 * (float(np.linalg.norm(bounds[:, 1] - bounds[:, 0])) + float(view.size.max()))
    camera = stage.camera
    camera.parallel_projection = True
    camera.focal_point, camera.position, camera.up = centre, centre + distance * back, view.up
    camera.parallel_scale = float(view.size[1]) / 2
    stage.renderer.reset_camera_clipping_range()


def _light(stage: Any, view: View) -> None:
    """One light above the viewer on the left, a weaker one on the right, so that edges between faces are visible."""
    back = np.cross(view.right, view.up)
    for left, above, strength in ((0.6, 0.9, 0.7), (-0.9, 0.1, 0.35)):
        position = back - left * view.right + above * view.up
        stage.add_light(
            pv.Light(position=position, focal_point=(0, 0, 0), intensity=strength, light_type="scene light")
        )


@contextmanager
def _quiet() -> Iterator[None]:
    """Context without VTK's messages: without a display it writes to stderr before it uses another way to draw."""
    before = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(before)


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
        """Draw them in axes of so many pixels, with grey outlines of the undeformed ones; see `PlaneBodies.show`."""
        cells = grid_of(self._mesh.points, self._mesh.cells, self._mesh.shape)
        cells.cell_data["values"] = np.maximum(values, float(norm.vmin or 0.0)) if isinstance(norm, LogNorm) else values
        cells.point_data["moved"] = self._mesh.points + scale * self._displacement
        before = surface_of(cells)  # only the surface is visible
        after = before.copy()
        after.points = after.point_data["moved"]
        edges: dict[str, Any] = {"edge_color": "#333333", "edge_opacity": 0.25}
        edges["show_edges"] = len(self._mesh.cells) <= FEW_CELLS
        colours = {"cmap": COLOURS, "clim": (norm.vmin, norm.vmax), "log_scale": isinstance(norm, LogNorm)}

        def add(stage: Any) -> None:
            stage.add_mesh(after, scalars="values", **colours, **SHADED, **edges, show_scalar_bar=False)
            for grid, look in ((after, EDGES), (before, GHOST)):
                outline = outline_of(grid)
                if outline.n_cells:
                    stage.add_mesh(outline, lighting=False, **look)
            for surface in self._obstacles:
                stand(stage, surface)

        show_image(axes, view, render(view, width, add), None)


def outline_of(grid: Any) -> Any:
    """Sharp edges of a solid."""
    # cells may be mirror images: normals are made consistent before angles are measured
    grid = grid.compute_normals(point_normals=False, consistent_normals=True)
    only: dict[str, bool] = {"boundary_edges": False, "manifold_edges": False, "non_manifold_edges": False}
    return grid.extract_feature_edges(feature_angle=30.0, feature_edges=True, **only)
