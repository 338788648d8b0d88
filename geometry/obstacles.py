"""Rigid obstacles: the distance of a point from a shape that needs no mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from geometry.amplitude import Amplitude, check, value_at
from geometry.errors import require
from geometry.keys import Choice, Key

Array = NDArray[np.float64]
Axis = Literal["x", "y", "z"]
AXES: tuple[Axis, ...] = ("x", "y", "z")


class Obstacle(Choice):
    """A rigid shape; its normal points out of it, towards the body."""

    tag: ClassVar[str] = "shape"

    def signed_gap(self, points: Array) -> Array:
        """Distance (m,) [m] of `points` (m, d), positive outside the obstacle."""
        raise NotImplementedError

    def normals(self, points: Array) -> Array:
        """Unit normals (m, d) out of the obstacle at the points closest to `points`."""
        raise NotImplementedError

    def check_dimension(self, dim: int) -> None:
        """Refuse data whose number of components is not the model's."""
        raise NotImplementedError

    def displacement_at(self, time: float, end: float, dim: int) -> Array:
        """Prescribed motion (d,) [m]."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class Plane(Obstacle):
    """Half-space below a plane."""

    point: Annotated[tuple[float, ...], Key("m", "a point of the plane")]
    normal: Annotated[tuple[float, ...], Key("-", "direction out of the obstacle, of any length")]
    shape: Annotated[Literal["plane"], Key("-", "kind of obstacle")] = "plane"
    displacement: Annotated[Mapping[Axis, Amplitude], Key("m", "prescribed motion by component, in time")] = field(
        default_factory=dict
    )

    def __post_init__(self) -> None:
        require(any(self.normal), "normal", list(self.normal), "a plane's normal must not be zero")
        for axis, amplitude in self.displacement.items():
            check(amplitude, f"displacement.{axis}")

    def check_dimension(self, dim: int) -> None:
        for key in ("point", "normal"):
            found = getattr(self, key)
            require(len(found) == dim, key, list(found), f"expected {dim} components in this model")
        require(dim == 3 or "z" not in self.displacement, "displacement.z", "given", "a plane model has x and y only")

    def signed_gap(self, points: Array) -> Array:
        """
        >>> Plane(point=(0.0, 0.0), normal=(0.0, 2.0)).signed_gap(np.array([[3.0, 0.5]]))
        array([0.5])
        """
        return np.asarray((points - np.array(self.point)) @ self._unit())

    def normals(self, points: Array) -> Array:
        return np.tile(self._unit(), (len(points), 1))

    def displacement_at(self, time: float, end: float, dim: int) -> Array:
        return np.array([value_at(self.displacement.get(a, 0.0), time, end) for a in AXES[:dim]])

    def _unit(self) -> Array:
        normal = np.array(self.normal)
        return np.asarray(normal / np.linalg.norm(normal))
