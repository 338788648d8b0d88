"""What pairs of bodies, one above the other, have in common."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from geometry.builders.assembly import Assembly
from geometry.keys import Key


@dataclass(frozen=True, kw_only=True)
class Pair(Assembly):
    """The body `lower` reaches up to 0 on the last axis, the body `upper` begins at `gap`."""

    lengths: ClassVar[tuple[str, ...]] = ("lower_mesh_size",)
    distances: ClassVar[tuple[str, ...]] = ("gap",)

    gap: Annotated[float, Key("m", "distance of the bodies along the last axis; negative: they overlap")] = 0.0
    lower_mesh_size: Annotated[
        float | None, Key("m", "mesh_size of the lower body, contact_mesh_size in the same ratio; absent: mesh_size")
    ] = None

    def lower_cell_keys(self) -> dict[str, Any]:
        """The keys that all builders have, for the lower body."""
        return self.cell_keys(self.lower_mesh_size)
