"""A rigid cone: an indenter, or a conical socket."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from stickslip.geometry.arrays import TINY, Array
from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.keys import Key, Vector
from stickslip.geometry.obstacles.obstacle import Obstacle, unit
from stickslip.geometry.shape import Model


@dataclass(frozen=True, kw_only=True)
class Cone(Obstacle):
    """Infinitely long; 3D, or axisymmetric about the axis of symmetry."""

    vectors: ClassVar[tuple[str, ...]] = ("apex", "axis")
    apex: Annotated[Vector, Key("m", "the tip")]
    axis: Annotated[Vector, Key("-", "direction in which the cone widens, of any length")]
    half_angle: Annotated[float, Key("-", "angle between the axis and the surface, in degrees")]
    inside: Annotated[bool, Key("-", "true: a conical socket, the body lies inside it")] = False
    shape: Annotated[Literal["cone"], Key("-", "kind of obstacle")] = "cone"

    def __post_init__(self) -> None:
        super().__post_init__()
        require(any(self.axis), "axis", list(self.axis), "must not be zero")
        require(0 < self.half_angle < 90, "half_angle", self.half_angle, "must lie between 0 and 90 degrees")

    def check_model(self, model: Model) -> None:
        if model in ("plane strain", "plane stress"):
            raise SceneError('shape = "cone": there is none in a plane model; use two of shape = "plane"')
        super().check_model(model)
        if model == "axisymmetric":
            require(self.axis[0] == 0, "axis", list(self.axis), "expected [0.0, 1.0] or [0.0, -1.0], along the axis")
            require(self.apex[0] == 0, "apex", list(self.apex), "must lie on the axis of symmetry, x = 0")

    def distance(self, x: Sequence[Any], sqrt: Callable[[Any], Any]) -> Any:
        """From the surface; from the apex where that is nearest, behind it.

        >>> Cone(apex=(0.0, 0.0), axis=(0.0, 1.0), half_angle=45.0).signed_gap(np.array([[0.0, 1.0], [0.0, -1.0]]))
        array([-0.70710678,  1.        ])
        """
        arm = [a - b for a, b in zip(x, self.apex, strict=True)]
        direction = [float(c) for c in unit(self.axis)]
        depth = sum(a * c for a, c in zip(arm, direction, strict=True))
        radial = [a - depth * c for a, c in zip(arm, direction, strict=True)]
        # [m²] under a root: where the rest of it is zero its slope is zero too, a number
        radius = sqrt(sum(a * a for a in radial) + TINY)
        sine, cosine = self._sine_and_cosine
        away, along = cosine * radius - sine * depth, cosine * depth + sine * radius
        behind = (along - sqrt(along * along + TINY)) / 2  # along, if that is negative: there `away` is positive
        outside = away + sqrt(away * away + behind * behind + TINY) - sqrt(away * away + TINY)
        return -outside if self.inside else outside

    def normals(self, points: Array) -> Array:
        """On the axis, where a whole circle of the surface is nearest, along it."""
        arm, direction = points - np.array(self.apex), unit(self.axis)
        depth, length = arm @ direction, np.linalg.norm(arm, axis=1)
        radial = arm - depth[:, None] * direction
        radius = np.linalg.norm(radial, axis=1)
        sine, cosine = self._sine_and_cosine
        normals = np.tile(-direction, (len(points), 1))
        surface = (radius > 0) & (cosine * depth + sine * radius >= 0)
        behind = (length > 0) & (cosine * depth + sine * radius < 0)
        normals[surface] = cosine * radial[surface] / radius[surface, None] - sine * direction
        normals[behind] = arm[behind] / length[behind, None]
        return np.asarray(-normals if self.inside else normals)

    @property
    def _sine_and_cosine(self) -> tuple[float, float]:
        """Of the half angle."""
        angle = np.radians(self.half_angle)
        return float(np.sin(angle)), float(np.cos(angle))
