"""A rectangle or box, meshed by a grid or by cells that grow with the distance from its contact sides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.builders import sides
from stickslip.geometry.builders.cuboid import Cuboid, grid
from stickslip.geometry.keys import Key
from stickslip.geometry.mesh.sizes import filled, graded, graded_count, grow, refined_near
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import Request


@dataclass(frozen=True, kw_only=True)
class Block(Cuboid):
    """[0, length] x [0, height]; in 3D [0, length] x [0, width] x [0, height]."""

    body: ClassVar[str] = "block"
    builder: Annotated[Literal["block"], Key("-", "the shape's name")] = "block"

    def cell_count(self, request: Request) -> float:
        dim, size = request.dim, self.size(request.dim)
        fine = {sides.of_box(dim)[side.split(".")[1]] for side in request.contact_sides}
        if self.contact_mesh_size is None or self.cells == "tensor":
            along = [self._count(size[axis], axis, fine) for axis in range(dim)]
            return float(np.prod(along)) * self.pieces(dim)
        volume = float(np.prod(size))
        near = [
            refined_near(volume / size[axis], size[axis], self.contact_mesh_size, self.mesh_size, dim)
            for axis, _ in sorted(fine)
        ]
        return filled(volume, self.mesh_size, dim) + sum(near)

    def draw(self, gmsh: Gmsh, request: Request) -> None:
        dim, size = request.dim, self.size(request.dim)
        tags = self.draw_box(gmsh, dim)
        fine = {sides.of_box(dim)[side.split(".")[1]] for side in request.contact_sides}
        if self.contact_mesh_size is None or self.cells == "tensor":
            grid(gmsh, dim, self.cells == "tensor", lambda axis: self._grading(size[axis], axis, fine), fine)
            return
        away = [f"Abs({'xyz'[axis]} - {end * size[axis]:.17g})" for axis, end in sorted(fine)]
        grow(gmsh, self.mesh_size, [(self.contact_mesh_size, distance) for distance in away])
        sides.match(gmsh, dim, request.periodic, tags, sides.of_box(dim), self.box(dim))

    def _count(self, length: float, axis: int, fine: set[tuple[int, int]]) -> float:
        """Number of cells along an axis, not rounded: as `_grading` has it."""
        ends = sum(1 for side in fine if side[0] == axis)
        if not fine or ends == 0 or any(side[0] != axis for side in fine):
            return max(1.0, length / (self.fine_size if fine else self.mesh_size))
        return graded_count(length, self.fine_size, self.mesh_size, ends)

    def _grading(self, length: float, axis: int, fine: set[tuple[int, int]]) -> tuple[int, float]:
        """Number of cells along an axis and their grading coefficient, as from `graded`.

        Args:
            length: of the block along the axis [m].
            fine: ends (axis, 0 lower or 1 upper) that are contact sides.
        """
        if not fine or self.contact_mesh_size is None or self.contact_mesh_size == self.mesh_size:
            return max(1, round(length / self.mesh_size)), 1.0
        ends = sum(1 for side in fine if side[0] == axis)
        if ends == 0 or any(side[0] != axis for side in fine):
            return max(1, round(length / self.contact_mesh_size)), 1.0
        return graded(length, self.contact_mesh_size, self.mesh_size, ends)
