"""Base of rigid obstacles: each answers how far a point is from it, which needs no mesh, and how it moves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from stickslip.geometry.amplitude import Amplitude, check
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError, require, require_components
from stickslip.geometry.keys import TABLE, Choice, Key, Noun, Vector
from stickslip.geometry.shape import Model, dimensions


@dataclass(frozen=True, kw_only=True)
class Rotation(Noun):
    """Turn about an axis through a point, right-handed; in plane models about z.

    Contact is found in the reference configuration: a point x of the obstacle moves by angle axis x (x - point), so a
    roller that spins about its own axis slides by radius times angle, whatever the angle.
    """

    angle: Annotated[Amplitude, Key("rad", "in time")]
    point: Annotated[Vector, Key("m", "a point of the axis")]
    axis: Annotated[Vector | None, Key("-", "direction of the axis, 3D only")] = None

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


def unit(vector: Vector) -> Array:
    """A direction of length 1."""
    return np.asarray(np.array(vector) / np.linalg.norm(vector))


Axis = Literal["x", "y", "z"]
AXES: tuple[Axis, ...] = ("x", "y", "z")
ByAxis = Mapping[Axis, Amplitude]


@dataclass(frozen=True, kw_only=True)
class Obstacle(Choice):
    """A rigid shape; its normal points out of it, towards the body."""

    tag: ClassVar[str] = "shape"
    vectors: ClassVar[tuple[str, ...]] = ()  # keys with one component an axis
    written_in_operators: ClassVar[bool] = True  # whether `distance` is, so that UFL can take it

    displacement: Annotated[ByAxis, Key("m", "prescribed motion by component, in time"), TABLE] = field(
        default_factory=dict
    )
    force: Annotated[
        ByAxis, Key("N", "force on the obstacle by component, in time; it then moves freely along that axis"), TABLE
    ] = field(default_factory=dict)
    rotation: Annotated[Rotation | None, Key("-", "{ angle, point, axis }: prescribed rotation")] = None

    def __post_init__(self) -> None:
        for place, amplitude in self.amplitudes().items():
            check(amplitude, ".".join(place))
        for axis in self.force:
            if axis in self.displacement:
                raise SceneError(f"force.{axis}: displacement.{axis} is prescribed too; keep one of the two")

    def amplitudes(self) -> dict[tuple[str, str], Amplitude]:
        """Its values in time by key and component."""
        found = {(key, axis): a for key in ("displacement", "force") for axis, a in getattr(self, key).items()}
        return found | ({("rotation", "angle"): self.rotation.angle} if self.rotation is not None else {})

    def distance(self, x: Sequence[Any], sqrt: Callable[[Any], Any]) -> Any:
        """Signed distance [m] of a point with coordinates `x`, positive outside.

        Written with operators alone, so that arrays of numbers and symbols of UFL take the same path.
        """
        raise NotImplementedError

    def check_points(self, points: Array) -> None:
        """Refuse points (m, d) of a side where the shape is not given.

        Raises:
            SceneError: one of them, and where it is given.
        """

    def signed_gap(self, points: Array) -> Array:
        """Distance (m,) [m] of `points` (m, d), positive outside the obstacle."""
        return np.asarray(self.distance(list(points.T), np.sqrt))

    def normals(self, points: Array) -> Array:
        """Unit normals (m, d) out of the obstacle at the points closest to `points`."""
        raise NotImplementedError

    def alike_along(self, way: Array) -> bool:
        """Whether it is in its own place after a motion by a vector (d,)."""
        return not way.any()

    def check_model(self, model: Model) -> None:
        """Refuse data that the model does not have, or lacks."""
        dim = dimensions(model)
        for key in self.vectors:
            require_components(getattr(self, key), key, dim, "here")
        for key in ("displacement", "force"):
            for axis in getattr(self, key):
                require(axis in AXES[:dim], f"{key}.{axis}", "given", "a plane model has x and y only")
                off_axis = model == "axisymmetric" and axis == "x"
                require(not off_axis, f"{key}.x", "given", "breaks the symmetry; the obstacle moves in y alone")
        if self.rotation is not None:
            require(model != "axisymmetric", "rotation", "given", "an axisymmetric model has none")
            require_components(self.rotation.point, "rotation.point", dim, "here")
            axis = self.rotation.axis
            require(dim == 3 or axis is None, "rotation.axis", axis, "a plane model turns about z; remove the key")
            require(dim == 2 or axis is not None, "rotation.axis", None, "missing, expected 3 components")
            require(dim == 2 or len(axis or ()) == 3, "rotation.axis", axis, "expected 3 components")

    def motion(self, points: Array, translation: Array, angle: float, tied: bool = False) -> Array:
        """Motion (m, d) [m] of the obstacle where it is closest to `points`; at `points`, if they are tied to it.

        Args:
            translation: (d,) [m].
            angle: of its rotation [rad]; without one it is not used.
        """
        moved = np.tile(translation, (len(points), 1))
        if self.rotation is None:
            return moved
        carried = points if tied else points - self.signed_gap(points)[:, None] * self.normals(points)
        return moved + self.rotation.displacement(carried, angle)

    def driven(self) -> tuple[Axis, ...]:
        """Axes along which a force moves the obstacle."""
        return tuple(axis for axis in AXES if axis in self.force)
