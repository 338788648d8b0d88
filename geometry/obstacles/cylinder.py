"""A rigid roller or bore: a circle in plane models, a shaft on the axis of symmetry in axisymmetric ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.geometry.obstacles.obstacle import Obstacle
from stickslip.geometry.obstacles.rotation import unit
from stickslip.geometry.obstacles.round import Round
from stickslip.geometry.shape import Model


@dataclass(frozen=True, kw_only=True)
class Cylinder(Round, Obstacle):
    """An infinitely long cylinder; without `axis` it stands along z, in plane models only."""

    vectors: ClassVar[tuple[str, ...]] = ("point", "axis")
    point: Annotated[tuple[float, ...], Key("m", "a point of the axis")]
    axis: Annotated[tuple[float, ...] | None, Key("-", "direction of the axis; absent in plane models")] = None
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
