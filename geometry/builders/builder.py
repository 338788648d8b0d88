"""Base of the ready shapes: a parametrised shape that gmsh draws and meshes."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Annotated, ClassVar, Literal, Self

import numpy as np

from stickslip.geometry.errors import require
from stickslip.geometry.keys import Choice, Key
from stickslip.geometry.mesh.sizes import filled
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import Request, Shape


@dataclass(frozen=True, kw_only=True)
class Builder(Choice, Shape):
    """Keys and checks that all builders share. A builder lists its own lengths in `lengths`."""

    tag: ClassVar[str] = "builder"
    lengths: ClassVar[tuple[str, ...]] = ()  # keys in metres that must be positive, besides the mesh sizes

    mesh_size: Annotated[float, Key("m", "edge length of the cells")]
    contact_mesh_size: Annotated[float | None, Key("m", "edge length at contact surfaces; absent: mesh_size")] = None
    cells: Annotated[Literal["simplex", "tensor"], Key("-", "triangles and tetrahedra, or quads and hexahedra")] = (
        "simplex"
    )
    order: Annotated[Literal[1, 2], Key("-", "polynomial degree of displacement and geometry")] = 1

    def __post_init__(self) -> None:
        for key in self._all_lengths():
            value = getattr(self, key)
            require(value is None or value > 0, key, value, "must be positive, in metres")
        fine = self.contact_mesh_size
        require(fine is None or fine <= self.mesh_size, "contact_mesh_size", fine, "must not exceed mesh_size")

    @property
    def degree(self) -> int:
        return self.order

    @property
    def fine_size(self) -> float:
        """Edge length at contact surfaces [m]."""
        return self.mesh_size if self.contact_mesh_size is None else self.contact_mesh_size

    def pieces(self, dim: int) -> int:
        """Cells that a quadrilateral or hexahedron of a grid is cut into."""
        return 1 if self.cells == "tensor" else {2: 2, 3: 6}[dim]

    def in_units_of(self, unit: float) -> Self:
        """The same shape with all lengths divided by `unit` [m]: a scene in m and one in mm give the same mesh."""
        found = {key: getattr(self, key) for key in self._all_lengths()}
        return replace(self, **{key: value / unit for key, value in found.items() if value is not None})

    def refined(self, factor: float) -> Self:
        sizes = {f.name: getattr(self, f.name) for f in fields(self) if f.name.endswith("mesh_size")}
        return replace(self, **{key: factor * size for key, size in sizes.items() if size is not None})

    def put(self, gmsh: Gmsh, request: Request) -> float:
        unit = float(np.max(np.ptp(self.box(request.dim), axis=0)))  # the tolerances of gmsh are absolute
        self.in_units_of(unit).draw(gmsh, request)
        if request.sizes is not None:
            request.sizes.in_units_of(unit).impose(gmsh)
        gmsh.model.mesh.generate(request.dim)
        return unit

    def cell_count(self, request: Request) -> float:
        """As if the shape filled its box, and had one size of cells; a shape that does not says so itself."""
        return filled(float(np.prod(np.ptp(self.box(request.dim), axis=0))), self.mesh_size, request.dim)

    def draw(self, gmsh: Gmsh, request: Request) -> None:
        """Put the shape, its mesh sizes and its named physical groups into the current gmsh model."""
        raise NotImplementedError

    def _all_lengths(self) -> tuple[str, ...]:
        return (*self.lengths, "mesh_size", "contact_mesh_size")
