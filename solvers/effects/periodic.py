"""Periodic sides: two sides have the same displacement, turned with the side if it is that of a cyclic sector; the dofs
of one of them are eliminated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from stickslip.geometry.errors import require, require_components
from stickslip.geometry.keys import Key, Vector
from stickslip.geometry.shape import Turn
from stickslip.solvers.effects.effect import Effect
from stickslip.solvers.scene.scene import EffectTable, Scene


@dataclass(frozen=True, kw_only=True)
class Periodic(EffectTable):
    """Two sides with the same displacement; their meshes match.

    With an `angle` the body is a sector of a cyclic one, whose displacement turns from sector to sector with the sides.
    """

    boundary: Annotated[str, Key("-", "side whose dofs are eliminated")]
    with_: Annotated[str, Key("-", "opposite side; the key is `with`")]

    angle: Annotated[
        float, Key("-", "that turns `with` to `boundary`, in degrees, counterclockwise; 0: it is shifted")
    ] = 0.0
    point: Annotated[Vector | None, Key("m", "of the axis of the turn; absent: the origin")] = None
    axis: Annotated[Vector | None, Key("-", "its direction, 3D only; absent: z")] = None

    def __post_init__(self) -> None:
        require(self.boundary != self.with_, "with", self.with_, "a side cannot be periodic with itself")
        require(abs(self.angle) < 360, "angle", self.angle, "must be less than a full turn, in degrees")
        require(self.axis is None or any(self.axis), "axis", self.axis, "must not be zero")
        for key, given in (("point", self.point), ("axis", self.axis)):
            require(self.angle != 0 or given is None, key, given, "a side that is shifted has no axis; give its angle")

    def check(self, scene: Scene, key: str) -> None:
        scene.require_side(self.boundary, f"{key}.boundary")
        scene.require_side(self.with_, f"{key}.with")
        require(not self.angle or not scene.axisymmetric, f"{key}.angle", self.angle, "an axisymmetric model has none")
        require(self.axis is None or scene.dim == 3, f"{key}.axis", self.axis, "a plane model turns about z")
        for name, given, size in (("point", self.point, scene.dim), ("axis", self.axis, 3)):
            if given is not None:
                require_components(given, f"{key}.{name}", size, "here")

    def periodic_pairs(self) -> tuple[tuple[str, str], ...]:
        return ((self.boundary, self.with_),)

    def turns(self) -> Mapping[str, Turn]:
        if not self.angle:
            return {}
        return {
            self.boundary: Turn(angle=self.angle, point=self.point or (0.0,) * 3, axis=self.axis or (0.0, 0.0, 1.0))
        }


class _Periodic(Effect):
    name = "periodic"
    table = Mapping[str, Periodic]

    def adds(self, scene: Scene) -> str:
        return "no unknowns on the one side, which follows the other"


EFFECT = _Periodic()
