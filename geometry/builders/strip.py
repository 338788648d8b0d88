"""A long thin block, meshed in layers of equal cells."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import prod
from typing import Annotated, ClassVar, Literal, Self

from stickslip.geometry.builders.cuboid import Cuboid, grid
from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import Request


@dataclass(frozen=True, kw_only=True)
class Strip(Cuboid):
    """[0, length] x [0, height] in layers of cells; in 3D [0, length] x [0, width] x [0, height]."""

    body: ClassVar[str] = "strip"
    layers: Annotated[int, Key("-", "cells through the height; mesh_size is their length along it")] = 4
    builder: Annotated[Literal["strip"], Key("-", "the shape's name")] = "strip"

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.layers >= 1, "layers", self.layers, "a strip needs one layer of cells at least")
        require(self.height <= self.length, "height", self.height, "must not exceed length")
        if self.contact_mesh_size is not None:
            raise SceneError(f"contact_mesh_size = {self.contact_mesh_size}: a strip's cells are alike; use mesh_size")

    def refined(self, factor: float) -> Self:
        return replace(super().refined(factor), layers=max(1, round(self.layers / factor)))

    def cell_count(self, request: Request) -> float:
        along = [max(1.0, length / self.mesh_size) for length in self.size(request.dim)[:-1]]
        return prod(along) * self.layers * self.pieces(request.dim)

    def steps(self, axis: int, dim: int) -> int:
        """Number of cells along an axis."""
        return self.layers if axis == dim - 1 else max(1, round(self.size(dim)[axis] / self.mesh_size))

    def draw(self, gmsh: Gmsh, request: Request) -> None:
        self.draw_box(gmsh, request.dim)
        grid(gmsh, request.dim, self.cells == "tensor", lambda axis: (self.steps(axis, request.dim), 1.0))
