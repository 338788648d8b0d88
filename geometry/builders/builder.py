"""What every shape answers: its names before any mesh exists, and its gmsh model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from geometry.keys import Choice

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Request:
    """What the scene wants of a mesh beyond the shape itself."""

    dim: int
    contact_sides: tuple[str, ...] = ()  # sides to refine to `contact_mesh_size`
    periodic: tuple[tuple[str, str], ...] = ()  # pairs of sides whose meshes must match


class Builder(Choice):
    """A parametrised shape."""

    tag: ClassVar[str] = "builder"

    def bodies(self, dim: int) -> Mapping[str, tuple[str, ...]]:
        """Names of the bodies and of each body's sides."""
        raise NotImplementedError

    def check_dimension(self, dim: int) -> None:
        """Refuse parameters that the model's dimension does not have, or lacks."""
        raise NotImplementedError

    def extent(self, dim: int) -> tuple[float, ...]:
        """Size of the bounding box (d,) [m]."""
        raise NotImplementedError

    def scaled(self, factor: float) -> Builder:
        """The same shape and mesh in another unit of length."""
        raise NotImplementedError

    def sample(self, side: str, dim: int) -> tuple[Array, Array]:
        """Corners (k, d) [m] of a side (as body.side), in the same order on opposite sides, and its normal (d,)."""
        raise NotImplementedError

    def draw(self, gmsh: Any, request: Request) -> None:
        """Put shape, mesh sizes and named physical groups into the current gmsh model."""
        raise NotImplementedError
