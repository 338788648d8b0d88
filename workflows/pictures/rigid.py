"""Rigid obstacles in a picture: the surface where their signed distance is zero, where they are as drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stickslip.geometry.amplitude import value_at
from stickslip.geometry.arrays import Array
from stickslip.geometry.obstacles.obstacle import Obstacle
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.pictures.view import View

FINE = {2: 600, 3: 60}  # samples along the longer side, by dimension
GREY, EDGE = "#b8b8b8", "#555555"


@dataclass(frozen=True)
class Rigid:
    """An obstacle at the time of a step."""

    obstacle: Obstacle
    motion: Array  # (d,) translation since t = 0 [m]
    angle: float  # of its rotation [rad]

    def signed_gap(self, points: Array, scale: float) -> Array:
        """Distance (m,) [m] of places (m, d) in the picture from it, its motion times `scale`; negative inside."""
        moved, rotation, dim = points - scale * self.motion, self.obstacle.rotation, points.shape[1]
        if rotation is not None:
            centre = np.array(rotation.point)
            turn = np.eye(dim) + rotation.displacement(centre + np.eye(dim), scale * self.angle).T
            moved = centre + np.linalg.solve(turn, (moved - centre).T).T
        return self.obstacle.signed_gap(moved)


def rigids(scene: Scene, step: StepResult) -> tuple[Rigid, ...]:
    """All obstacles of a scene, where they are in a step."""

    def angle(obstacle: Obstacle) -> float:
        return value_at(obstacle.rotation.angle, step.time, scene.steps.end) if obstacle.rotation else 0.0

    placed = scene.obstacles.items()
    return tuple(Rigid(each, step.obstacles[name].displacement, angle(each)) for name, each in placed)


def shade(axes: Any, view: View, each: Sequence[Rigid], scale: float) -> None:
    """Shade the obstacles of a plane model in axes that show the view, and draw their edges."""
    counts = np.maximum(2, (FINE[2] * view.size / view.size.max()).astype(int))
    x, y = (np.linspace(a, b, n) for a, b, n in zip(view.low, view.high, counts, strict=True))
    points = np.stack([part.ravel() for part in np.meshgrid(x, y)], axis=1)
    for rigid in each:
        gap = rigid.signed_gap(points, scale).reshape(len(y), len(x))  # NaN beyond a map
        low = float(np.nanmin(gap, initial=0.0))
        if low < 0 < np.nanmax(gap, initial=0.0):
            axes.contourf(x, y, gap, levels=[low, 0.0], colors=[GREY], alpha=0.45)
            axes.contour(x, y, gap, levels=[0.0], colors=[EDGE], linewidths=0.9)


def surfaces(points: Array, each: Sequence[Rigid], scale: float) -> list[Any]:
    """Surfaces of the obstacles near the points (n, 3) [m] of bodies as drawn; of a plane model lines."""
    import pyvista as pv  # late: plane pictures do without VTK

    plane = not np.ptp(points[:, 2])
    low, high = points.min(axis=0), points.max(axis=0)
    # around solid bodies in which obstacles are drawn
    room = 0.06 * float((high - low).max()) * np.array([1.0, 1.0, float(not plane)])
    size = high - low + 2 * room
    counts = np.maximum(1 if plane else 3, (FINE[3 - plane] * size / size.max()).astype(int))
    spacing = np.divide(size, counts - 1, out=np.ones(3), where=counts > 1)
    grid = pv.ImageData(dimensions=tuple(counts), spacing=tuple(spacing), origin=tuple(low - room))
    contour: Any = grid.contour  # pyvista's annotation names other arrays
    places = np.asarray(grid.points, float)[:, : 3 - plane]
    gaps = (rigid.signed_gap(places, scale) for rigid in each)
    return [contour([0.0], scalars=gap) if gap.min() < 0 < gap.max() else pv.PolyData() for gap in gaps]


def stand(stage: Any, surface: Any) -> None:
    """Put a surface of an obstacle on a stage, translucent."""
    stage.add_mesh(surface, color=GREY, opacity=0.4, ambient=0.6, diffuse=0.45)
