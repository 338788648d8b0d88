"""A rigid surface over the plane: the graph of a formula, or of measured heights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.arrays import CLOSE, EXACT, STEPS, Array
from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.expression import Expression, check_varying
from stickslip.geometry.field import FieldTable, HeightMap
from stickslip.geometry.keys import Key
from stickslip.geometry.obstacles.obstacle import AXES, Obstacle
from stickslip.geometry.shape import Model


@dataclass(frozen=True, kw_only=True)
class Graph(Obstacle):
    """y = height over x, or z = height over x and y in 3D; the body lies above it."""

    written_in_operators: ClassVar = False
    height: Annotated[
        str | Annotated[HeightMap, FieldTable],
        Key("m", "y over x, or z over x and y: an expression, or a map { csv, over, height } of measured heights"),
    ]
    under: Annotated[bool, Key("-", "true: the body lies under it")] = False
    shape: Annotated[Literal["graph"], Key("-", "kind of obstacle")] = "graph"

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.height, HeightMap):
            require(self.height.plus == 0, "height.plus", self.height.plus, "move the obstacle by displacement")
        else:
            check_varying(self.height, "height")

    def check_model(self, model: Model) -> None:
        super().check_model(model)
        own = AXES[: 2 if model == "3d" else 1]
        if isinstance(self.height, HeightMap):
            require(set(self.height.over) <= set(own), "height.over", list(self.height.over), f"expected {list(own)}")
        else:
            others = sorted(Expression(self.height).names - {*own, "pi"})
            require(not others, "height", f'"{self.height}"', f"{', '.join(others)}: it is a formula of {list(own)}")

    def check_points(self, points: Array) -> None:
        if isinstance(self.height, HeightMap):
            self.height(points, "height")
        elif not np.isfinite(self._heights(points[:, :-1])).all():
            where = ", ".join(f"{x:.6g}" for x in points[np.argmin(np.isfinite(self._heights(points[:, :-1])))])
            raise SceneError(f'height = "{self.height}": has no finite value at ({where})')

    def signed_gap(self, points: Array) -> Array:
        """Distance (m,) [m] of `points` (m, d) from the nearest point of the surface, positive where the body may be.

        >>> Graph(height="x").signed_gap(np.array([[0.0, 2.0], [1.0, 1.0]])).round(6)
        array([1.414214, 0.      ])
        """
        foot, _ = self._nearest(points)
        above = np.sign(points[:, -1] - self._heights(points[:, :-1]))
        return np.asarray(np.linalg.norm(points - foot, axis=1) * above * (-1 if self.under else 1))

    def normals(self, points: Array) -> Array:
        _, slope = self._nearest(points)
        upward = np.append(-slope, np.ones((len(points), 1)), axis=1)
        upward /= np.linalg.norm(upward, axis=1, keepdims=True)
        return np.asarray(-upward if self.under else upward)

    def _nearest(self, points: Array) -> tuple[Array, Array]:
        """Nearest points of the surface (m, d) [m], by Gauss and Newton's method, and the slopes there (m, d-1).

        Far away, where several are nearest, it is one of them.
        """
        at, found = points[:, :-1], points[:, :-1].copy()
        reach = CLOSE * (np.abs(at - at[:1]).max(initial=0.0) or 1.0)
        for _ in range(STEPS):
            slope, above = self._slopes(found, reach), points[:, -1] - self._heights(found)
            r = at - found + above[:, None] * slope
            step = r - slope * (np.einsum("mk,mk->m", slope, r) / (1 + (slope**2).sum(axis=1)))[:, None]
            found = self._clipped(found + step)
            if not np.nanmax(np.abs(step), initial=0.0) > EXACT * np.abs(points).max(initial=0.0):
                break
        return np.column_stack([found, self._heights(found)]), self._slopes(found, reach)

    def _heights(self, at: Array) -> Array:
        if isinstance(self.height, HeightMap):
            return self.height.heights(at)
        return Expression(self.height)(at, time=1.0, end=1.0)

    def _slopes(self, at: Array, reach: float) -> Array:
        """Derivatives (m, d-1) [-] of the height, by central differences; NaN beyond a map."""
        slopes = []
        for k, axis in enumerate(np.eye(at.shape[1])):
            before, behind = self._clipped(at - reach * axis), self._clipped(at + reach * axis)
            rise, width = self._heights(behind) - self._heights(before), (behind - before)[:, k]
            slopes.append(rise / np.where(width > 0, width, np.nan))
        return np.stack(slopes, axis=1)

    def _clipped(self, at: Array) -> Array:
        return self.height.clipped(at) if isinstance(self.height, HeightMap) else at
