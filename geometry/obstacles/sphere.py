"""A rigid ball, or a socket."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.keys import Key
from stickslip.geometry.obstacles.obstacle import Obstacle
from stickslip.geometry.obstacles.round import Round
from stickslip.geometry.shape import Model


@dataclass(frozen=True, kw_only=True)
class Sphere(Round, Obstacle):
    """A sphere: in 3D, or in axisymmetric models with its centre on the axis."""

    vectors: ClassVar[tuple[str, ...]] = ("center",)
    center: Annotated[tuple[float, ...], Key("m", "centre")]
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
