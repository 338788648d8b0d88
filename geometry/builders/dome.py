"""Base of half disc and half ball: the pole is at the origin, and cells grow with the distance from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from stickslip.geometry.builders.builder import Builder
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.geometry.mesh.sizes import SIMPLICES, beyond, cells_around, grow, norm
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import Model, Request


@dataclass(frozen=True, kw_only=True)
class Dome(Builder):
    """A round body, cut by a plane, that stands on its pole."""

    lengths: ClassVar[tuple[str, ...]] = ("radius", "contact_radius")

    radius: Annotated[float, Key("m", "of the disc or ball")]
    contact_radius: Annotated[
        float | None, Key("m", "cells have contact_mesh_size this far from the pole; absent: radius / 8")
    ] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        near = self.contact_radius
        require(near is None or near <= self.radius, "contact_radius", near, "must not exceed radius")

    @property
    def near(self) -> float:
        """Distance from the pole within which cells have `contact_mesh_size` [m]."""
        return self.radius / 8 if self.contact_radius is None else self.contact_radius

    def check_model(self, model: Model) -> None:
        require(self.cells == "simplex", "cells", self.cells, "this shape has no grid; use simplex")

    def cell_count(self, request: Request) -> float:
        dim = request.dim
        half = cells_around(dim, self.fine_size, self.near, self.mesh_size, self.radius)
        return SIMPLICES[dim] * half * self.share(dim)

    def share(self, dim: int) -> float:
        """How much of the half disc or ball there is: box of the body over that of the whole."""
        return float(np.prod(np.ptp(self.box(dim), axis=0)[:-1])) / (2 * self.radius) ** (dim - 1)

    def size_cells(self, gmsh: Gmsh) -> None:
        """Set the mesh sizes of the current gmsh model."""
        grow(gmsh, self.mesh_size, [(self.fine_size, beyond(self.near, norm("x", "y", "z")))])
