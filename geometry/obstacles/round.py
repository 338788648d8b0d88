"""Base of cylinder and sphere: a surface at a constant distance from a core (axis or centre), outside or inside."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key


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
