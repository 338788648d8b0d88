"""What two half discs and two half balls have in common: they stand pole to pole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from geometry.builders.pair import Pair
from geometry.errors import require
from geometry.keys import Key


@dataclass(frozen=True, kw_only=True)
class Domes(Pair):
    """The lower body's pole is the origin, the upper one's lies at `gap` above it."""

    lengths: ClassVar[tuple[str, ...]] = (*Pair.lengths, "radius", "lower_radius", "contact_radius")

    radius: Annotated[float, Key("m", "of the upper body")]
    lower_radius: Annotated[float | None, Key("m", "of the lower body; absent: radius")] = None
    contact_radius: Annotated[
        float | None, Key("m", "cells have contact_mesh_size this far from the poles; absent: radius / 8, each its own")
    ] = None

    def check_keys(self) -> None:
        near = self.contact_radius
        require(near is None or near <= min(self.radius, self._lower), "contact_radius", near, "exceeds a radius")

    def upper_keys(self) -> dict[str, Any]:
        """Keys of the upper dome."""
        return self.cell_keys() | {"radius": self.radius, "contact_radius": self.contact_radius}

    def lower_keys(self) -> dict[str, Any]:
        """Keys of the lower dome."""
        return self.lower_cell_keys() | {"radius": self._lower, "contact_radius": self.contact_radius}

    @property
    def _lower(self) -> float:
        return self.radius if self.lower_radius is None else self.lower_radius
