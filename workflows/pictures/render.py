"""Renders a VTK scene in parallel projection, as an image that matplotlib can show to scale."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pyvista as pv
from vtkmodules.vtkCommonCore import vtkLogger
from vtkmodules.vtkFiltersGeometry import vtkDataSetSurfaceFilter

from stickslip.geometry.arrays import Array, Ints
from stickslip.workflows.formats.shapes import corner_cells
from stickslip.workflows.formats.steps import three
from stickslip.workflows.pictures.view import Image, View

SHADED: dict[str, Any] = {"lighting": True, "ambient": 0.6, "diffuse": 0.45}  # edges show, colours stay near the bar's
OFF_SCREEN = ("libEGL.so.1", "libOSMesa.so.8")  # VTK crashes where it finds none of them


def grid_of(points: Array, cells: Ints, shape: str) -> pv.UnstructuredGrid:
    """Cells in dolfinx's order, points (n, 2 or 3), as a grid of VTK with straight sides."""
    corners, kind = corner_cells(shape, cells)
    return pv.UnstructuredGrid({kind: corners}, three(points))


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
