"""Rows of bodies whose meshes take turns, so that those of neighbours do not match."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from geometry.builders.assembly import Assembly
from geometry.errors import require
from geometry.keys import Key

MOST_BODIES = 1000


@dataclass(frozen=True, kw_only=True)
class Alternating(Assembly):
    """Every second body's mesh sizes are those of the others times `mesh_ratio`."""

    count: Annotated[int, Key("-", "number of blocks or stones")]
    mesh_ratio: Annotated[float, Key("-", "mesh sizes of every second body over those of the others")] = 1.0

    def check_keys(self) -> None:
        require(1 <= self.count <= MOST_BODIES, "count", self.count, f"must be between 1 and {MOST_BODIES}")
        require(self.mesh_ratio > 0, "mesh_ratio", self.mesh_ratio, "must be positive")

    def cell_keys_of(self, number: int) -> dict[str, Any]:
        """The keys that all builders have, for the body of this number in the row."""
        return self.cell_keys(self.mesh_size * self.mesh_ratio if number % 2 == 0 else None)
