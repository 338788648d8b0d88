"""What cylinders and spheres share: a surface at one distance from a core, met from outside or from inside."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from geometry.arrays import Array
from geometry.errors import require
from geometry.keys import Key


@dataclass(frozen=True, kw_only=True)
class Round:
    """Keys and geometry of a round obstacle; `from_core` is what tells the kinds apart."""

    radius: Annotated[float, Key("m", "of the obstacle")]
    inside: Annotated[bool, Key("-", "true: a bore, the body lies inside it")] = False

    def __post_init__(self) -> None:
        super().__post_init__()  # type: ignore[misc]
        require(self.radius > 0, "radius", self.radius, "must be positive, in metres")

    def from_core(self, x: Sequence[Any]) -> list[Any]:
        """Components of the shortest vector [m] from the core to the point with coordinates `x`."""
        raise NotImplementedError

    def distance(self, x: Sequence[Any], sqrt: Callable[[Any], Any]) -> Any:
        outside = sqrt(sum(a * a for a in self.from_core(x))) - self.radius
        return -outside if self.inside else outside

    def normals(self, points: Array) -> Array:
        arm = np.stack(self.from_core(list(points.T)), axis=1)
        length = np.linalg.norm(arm, axis=1, keepdims=True)
        outward = np.divide(arm, length, out=np.zeros_like(arm), where=length > 0)  # the core itself has no normal
        return np.asarray(-outward if self.inside else outward)
