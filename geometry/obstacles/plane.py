"""A rigid half-space, bounded by a plane."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from stickslip.geometry.arrays import ROUNDING, Array
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key, Vector
from stickslip.geometry.obstacles.obstacle import Obstacle, unit


@dataclass(frozen=True, kw_only=True)
class Plane(Obstacle):
    """The half-space behind a plane; `normal` points out of it."""

    vectors: ClassVar[tuple[str, ...]] = ("point", "normal")
    point: Annotated[Vector, Key("m", "a point of the plane")]
    normal: Annotated[Vector, Key("-", "direction out of the obstacle, of any length")]
    shape: Annotated[Literal["plane"], Key("-", "kind of obstacle")] = "plane"

    def __post_init__(self) -> None:
        super().__post_init__()
        require(any(self.normal), "normal", list(self.normal), "a plane's normal must not be zero")

    def distance(self, x: Sequence[Any], sqrt: Callable[[Any], Any]) -> Any:
        """Signed distance [m] of the point with coordinates `x` from the plane, positive outside.

        >>> Plane(point=(0.0, 0.0), normal=(0.0, 2.0)).signed_gap(np.array([[3.0, 0.5]]))
        array([0.5])
        """
        return sum((a - b) * float(n) for a, b, n in zip(x, self.point, unit(self.normal), strict=True))

    def alike_along(self, way: Array) -> bool:
        return bool(abs(unit(self.normal) @ way) <= ROUNDING * np.linalg.norm(way))

    def normals(self, points: Array) -> Array:
        return np.tile(unit(self.normal), (len(points), 1))
