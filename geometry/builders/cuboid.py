"""Block and strip: a rectangle or box with its lower corner at the origin, meshed by a grid or graded cells."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from math import prod
from typing import Annotated, ClassVar, Literal, Self

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.builders.builder import Builder, Sides, box_corners, of_box
from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.keys import Key
from stickslip.geometry.mesh_sizes import filled, graded, graded_count, grow, refined_near
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import Model, Request, dimensions

Fine = Collection[tuple[int, int]]  # ends (axis, 0 lower or 1 upper) at which the cells are small


@dataclass(frozen=True, kw_only=True)
class Cuboid(Builder):
    """[0, length] x [0, height]; in 3D [0, length] x [0, width] x [0, height]."""

    body: ClassVar[str]
    lengths: ClassVar[tuple[str, ...]] = ("length", "height", "width")

    length: Annotated[float, Key("m", "size along x")]
    height: Annotated[float, Key("m", "size along the last axis")]
    width: Annotated[float | None, Key("m", "size along y, 3D only")] = None

    def sides(self, dim: int) -> Sides:
        return {name: box_corners(self.box(dim), *place) for name, place in of_box(dim).items()}

    def check_model(self, model: Model) -> None:
        dim = dimensions(model)
        if dim == 3 and self.width is None:
            raise SceneError(f'width: missing, a {self.body} needs it in model = "3d"')
        require(dim == 3 or self.width is None, "width", self.width, "a plane model has no width; remove the key")

    def box(self, dim: int) -> Array:
        return np.array([np.zeros(dim), self.size(dim)])

    def size(self, dim: int) -> tuple[float, ...]:
        """Edge lengths (d,) along the axes [m]."""
        return (self.length, self.height) if dim == 2 else (self.length, self.width or 0.0, self.height)

    def draw_box(self, gmsh: Gmsh, dim: int) -> dict[str, list[int]]:
        """Put the box with its named groups into the gmsh model; returns the tags of each side."""
        add = gmsh.model.occ.addRectangle if dim == 2 else gmsh.model.occ.addBox
        add(0, 0, 0, *self.size(dim))
        gmsh.model.occ.synchronize()
        found = self.outer(gmsh, dim, of_box(dim))
        self.name_groups(gmsh, dim, found)
        return found


def grid(gmsh: Gmsh, dim: int, tensor: bool, grading: Callable[[int], tuple[int, float]], fine: Fine = ()) -> None:
    """Mesh every rectangle or box of the model by a structured (transfinite) grid.

    Args:
        tensor: quadrilaterals or hexahedra, else each is cut into simplices.
        grading: number of cells along an axis, and the ratio of neighbouring cells.
    """
    for _, curve in gmsh.model.getEntities(1):
        (first,), (last,) = gmsh.model.getParametrizationBounds(1, curve)
        start, end = gmsh.model.getValue(1, curve, [first]), gmsh.model.getValue(1, curve, [last])
        axis = int(np.argmax(np.abs(np.subtract(end, start))))
        steps, ratio = grading(axis)
        from_start = (axis, 0 if start[axis] < end[axis] else 1) in fine
        law = "Bump" if ratio != 1 and {(axis, 0), (axis, 1)} <= {*fine} else "Progression"
        gmsh.model.mesh.setTransfiniteCurve(curve, steps + 1, law, ratio if from_start or law == "Bump" else 1 / ratio)
    transfinite(gmsh, dim, tensor)


def transfinite(gmsh: Gmsh, dim: int, tensor: bool) -> None:
    """Fill all surfaces of four edges and all volumes of six faces by grids, cut into simplices unless `tensor`."""
    for kind in range(2, dim + 1):
        for _, tag in gmsh.model.getEntities(kind):
            if kind == 3:
                gmsh.model.mesh.setTransfiniteVolume(tag)
                continue
            gmsh.model.mesh.setTransfiniteSurface(tag, "Right" if dim == 2 else "Left")
            if tensor:
                gmsh.model.mesh.setRecombine(2, tag)


@dataclass(frozen=True, kw_only=True)
class Block(Cuboid):
    """[0, length] x [0, height]; in 3D [0, length] x [0, width] x [0, height]."""

    body: ClassVar[str] = "block"
    builder: Annotated[Literal["block"], Key("-", "the shape's name")] = "block"

    def cell_count(self, request: Request) -> float:
        dim, size = request.dim, self.size(request.dim)
        fine = {of_box(dim)[side] for side in self.touched(request)}
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
        fine = {of_box(dim)[side] for side in self.touched(request)}
        if self.contact_mesh_size is None or self.cells == "tensor":
            grid(gmsh, dim, self.cells == "tensor", lambda axis: self._grading(size[axis], axis, fine), fine)
            return
        away = [f"Abs({'xyz'[axis]} - {end * size[axis]:.17g})" for axis, end in sorted(fine)]
        grow(gmsh, self.mesh_size, [(self.contact_mesh_size, distance) for distance in away])
        self.match_periodic(gmsh, request, of_box(dim), tags)

    def _count(self, length: float, axis: int, fine: Fine) -> float:
        """Number of cells along an axis, not rounded: as `_grading` has it."""
        if any(side[0] != axis for side in fine) or not fine:
            return max(1.0, length / (self.fine_size if fine else self.mesh_size))
        return graded_count(length, self.fine_size, self.mesh_size, len(fine))

    def _grading(self, length: float, axis: int, fine: Fine) -> tuple[int, float]:
        """Number of cells along an axis, `length` long [m], and their grading coefficient, as from `graded`."""
        if any(side[0] != axis for side in fine) or not fine or self.fine_size == self.mesh_size:
            return max(1, round(length / (self.fine_size if fine else self.mesh_size))), 1.0
        return graded(length, self.fine_size, self.mesh_size, len(fine))


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
