"""Bases of the assemblies of two bodies, one above the other: blocks, and round bodies with facing poles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from stickslip.geometry.builders.assembly import Assembly, CellKeys
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key


@dataclass(frozen=True, kw_only=True)
class Pair(Assembly):
    """Along the last axis the body `lower` ends at 0 and the body `upper` begins at `gap`."""

    lengths: ClassVar[tuple[str, ...]] = ("lower_mesh_size",)
    distances: ClassVar[tuple[str, ...]] = ("gap",)

    gap: Annotated[float, Key("m", "distance of the bodies along the last axis; negative: they overlap")] = 0.0
    lower_mesh_size: Annotated[
        float | None, Key("m", "mesh_size of the lower body, contact_mesh_size in the same ratio; absent: mesh_size")
    ] = None

    def lower_cell_keys(self) -> CellKeys:
        """Mesh keys of the lower body."""
        return self.cell_keys(self.lower_mesh_size)


class DomeKeys(CellKeys):
    """Keys of one of two domes."""

    radius: float
    contact_radius: float | None


@dataclass(frozen=True, kw_only=True)
class Domes(Pair):
    """Two domes: the pole of the lower body is the origin, that of the upper body lies at `gap` above it."""

    lengths: ClassVar[tuple[str, ...]] = (*Pair.lengths, "radius", "lower_radius", "contact_radius")

    radius: Annotated[float, Key("m", "of the upper body")]
    lower_radius: Annotated[float | None, Key("m", "of the lower body; absent: radius")] = None
    contact_radius: Annotated[
        float | None, Key("m", "cells have contact_mesh_size this far from the poles; absent: radius / 8, each its own")
    ] = None

    def check_keys(self) -> None:
        near = self.contact_radius
        require(near is None or near <= min(self.radius, self._lower), "contact_radius", near, "exceeds a radius")

    def upper_keys(self) -> DomeKeys:
        """Keys of the upper dome."""
        return {**self.cell_keys(), "radius": self.radius, "contact_radius": self.contact_radius}

    def lower_keys(self) -> DomeKeys:
        """Keys of the lower dome."""
        return {**self.lower_cell_keys(), "radius": self._lower, "contact_radius": self.contact_radius}

    @property
    def _lower(self) -> float:
        return self.radius if self.lower_radius is None else self.lower_radius
