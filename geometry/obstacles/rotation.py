"""Rotation of a rigid obstacle about an axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from stickslip.geometry.amplitude import Amplitude, check
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key, Noun


@dataclass(frozen=True, kw_only=True)
class Rotation(Noun):
    """Turn about an axis through a point, right-handed; in plane models about z.

    Contact is found in the reference configuration: a point x of the obstacle moves by angle axis x (x - point), so a
    roller that spins about its own axis slides by radius times angle, whatever the angle.
    """

    angle: Annotated[Amplitude, Key("rad", "in time")]
    point: Annotated[tuple[float, ...], Key("m", "a point of the axis")]
    axis: Annotated[tuple[float, ...] | None, Key("-", "direction of the axis, 3D only")] = None

    def __post_init__(self) -> None:
        check(self.angle, "angle")
        require(self.axis is None or any(self.axis), "axis", self.axis, "must not be zero")

    def displacement(self, points: Array, angle: float) -> Array:
        """Motion (m, d) [m] of the obstacle's points (m, d).

        >>> Rotation(angle=0.1, point=(0.0, 0.0)).displacement(np.array([[2.0, 0.0]]), 0.1)
        array([[-0. ,  0.2]])
        """
        arm = points - np.array(self.point)
        if self.axis is None:
            return np.asarray(angle * np.stack([-arm[:, 1], arm[:, 0]], axis=1))
        return np.asarray(angle * np.cross(unit(self.axis), arm))


def unit(vector: tuple[float, ...]) -> Array:
    """A direction of length 1."""
    return np.asarray(np.array(vector) / np.linalg.norm(vector))
