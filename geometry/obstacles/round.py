"""Rigid cylinders and spheres: a surface at a constant distance from a core (axis or centre), outside or inside."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from stickslip.geometry.arrays import ROUNDING, Array
from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.keys import Key, Vector
from stickslip.geometry.obstacles.obstacle import Obstacle, unit
from stickslip.geometry.shape import Model


@dataclass(frozen=True, kw_only=True)
class Round:
    """A round obstacle; each kind defines the vector from its core."""

    radius: Annotated[float, Key("m", "of the obstacle")]
    inside: Annotated[bool, Key("-", "true: a bore, the body lies inside it")] = False

    def __post_init__(self) -> None:
        super().__post_init__()  # type: ignore[misc]
        require(self.radius > 0, "radius", self.radius, "must be positive, in metres")

    def from_core(self, x: Sequence[Any]) -> list[Any]:
        """Components of the shortest vector [m] from the core to the point with coordinates `x`."""
        raise NotImplementedError

    def distance(self, x: Sequence[Any], sqrt: Callable[[Any], Any]) -> Any:
        """Signed distance [m] of the point with coordinates `x`, positive where the body may be."""
        outside = sqrt(sum(a * a for a in self.from_core(x))) - self.radius
        return -outside if self.inside else outside

    def normals(self, points: Array) -> Array:
        """Unit normals (m, d) out of the obstacle at the points closest to `points` (m, d); zero on the core."""
        arm = np.stack(self.from_core(list(points.T)), axis=1)
        length = np.linalg.norm(arm, axis=1, keepdims=True)
        outward = np.divide(arm, length, out=np.zeros_like(arm), where=length > 0)
        return np.asarray(-outward if self.inside else outward)


@dataclass(frozen=True, kw_only=True)
class Cylinder(Round, Obstacle):
    """An infinitely long cylinder; without `axis` it stands along z, in plane models only."""

    vectors: ClassVar[tuple[str, ...]] = ("point", "axis")
    point: Annotated[Vector, Key("m", "a point of the axis")]
    axis: Annotated[Vector | None, Key("-", "direction of the axis; absent in plane models")] = None
    shape: Annotated[Literal["cylinder"], Key("-", "kind of obstacle")] = "cylinder"

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.axis is None or any(self.axis), "axis", self.axis, "must not be zero")

    def check_model(self, model: Model) -> None:
        if model in ("3d", "axisymmetric"):
            require(self.axis is not None, "axis", None, "missing, the direction of the cylinder's axis")
        else:
            require(self.axis is None, "axis", self.axis, "a plane model's cylinder stands along z; remove the key")
        super().check_model(model)
        if model == "axisymmetric" and self.axis is not None:
            require(self.axis[0] == 0, "axis", list(self.axis), "expected [0.0, 1.0], the axis of symmetry")
            require(self.point[0] == 0, "point", list(self.point), "must lie on the axis of symmetry, x = 0")

    def alike_along(self, way: Array) -> bool:
        axis = np.zeros(len(way)) if self.axis is None else unit(self.axis)
        return bool(np.linalg.norm(way - axis @ way * axis) <= ROUNDING * np.linalg.norm(way))

    def from_core(self, x: Sequence[Any]) -> list[Any]:
        """Components of the shortest vector [m] from the axis to the point with coordinates `x`.

        >>> import numpy as np
        >>> Cylinder(point=(0.0, 0.0), radius=1.0).signed_gap(np.array([[3.0, 4.0]]))
        array([4.])
        """
        arm = [a - b for a, b in zip(x, self.point, strict=True)]
        if self.axis is None:
            return arm
        direction = [float(c) for c in unit(self.axis)]
        along = sum(a * c for a, c in zip(arm, direction, strict=True))
        return [a - along * c for a, c in zip(arm, direction, strict=True)]


@dataclass(frozen=True, kw_only=True)
class Sphere(Round, Obstacle):
    """A sphere: in 3D, or in axisymmetric models with its centre on the axis."""

    vectors: ClassVar[tuple[str, ...]] = ("center",)
    center: Annotated[Vector, Key("m", "centre")]
    shape: Annotated[Literal["sphere"], Key("-", "kind of obstacle")] = "sphere"

    def check_model(self, model: Model) -> None:
        super().check_model(model)
        if model in ("plane strain", "plane stress"):
            raise SceneError('shape = "sphere": there is none in a plane model; use "cylinder"')
        if model == "axisymmetric":
            require(self.center[0] == 0, "center", list(self.center), "must lie on the axis of symmetry, x = 0")

    def from_core(self, x: Sequence[Any]) -> list[Any]:
        """Components of the vector [m] from the centre to the point with coordinates `x`.

        >>> import numpy as np
        >>> Sphere(center=(0.0, 0.0, 1.0), radius=1.0, inside=True).signed_gap(np.array([[0.0, 0.0, 0.5]]))
        array([0.5])
        """
        return [a - b for a, b in zip(x, self.center, strict=True)]
