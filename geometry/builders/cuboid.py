"""Base of block and strip: a rectangle or box with its lower corner at the origin; structured grids."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.builders import sides
from stickslip.geometry.builders.builder import Builder
from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import Model


@dataclass(frozen=True, kw_only=True)
class Cuboid(Builder):
    """[0, length] x [0, height]; in 3D [0, length] x [0, width] x [0, height]."""

    body: ClassVar[str]
    lengths: ClassVar[tuple[str, ...]] = ("length", "height", "width")

    length: Annotated[float, Key("m", "size along x")]
    height: Annotated[float, Key("m", "size along the last axis")]
    width: Annotated[float | None, Key("m", "size along y, 3D only")] = None

    def bodies(self, dim: int) -> Mapping[str, tuple[str, ...]]:
        return {self.body: tuple(sides.of_box(dim))}

    def check_model(self, model: Model) -> None:
        dim = 3 if model == "3d" else 2
        if dim == 3 and self.width is None:
            raise SceneError(f'width: missing, a {self.body} needs it in model = "3d"')
        require(dim == 3 or self.width is None, "width", self.width, "a plane model has no width; remove the key")

    def box(self, dim: int) -> Array:
        return np.array([np.zeros(dim), self.size(dim)])

    def sample(self, side: str, dim: int) -> tuple[Array, Array]:
        return sides.box_corners(self.box(dim), *sides.of_box(dim)[side.split(".")[1]])

    def size(self, dim: int) -> tuple[float, ...]:
        """Edge lengths (d,) along the axes [m]."""
        return (self.length, self.height) if dim == 2 else (self.length, self.width or 0.0, self.height)

    def draw_box(self, gmsh: Gmsh, dim: int) -> dict[str, list[int]]:
        """Put the box with its named groups into the gmsh model; returns the tags of each side."""
        size = self.size(dim)
        add = gmsh.model.occ.addRectangle if dim == 2 else gmsh.model.occ.addBox
        add(0, 0, 0, *size)
        gmsh.model.occ.synchronize()
        flat = {name: (axis, end * size[axis]) for name, (axis, end) in sides.of_box(dim).items()}
        found = sides.outer(gmsh, dim, flat)
        sides.name_groups(gmsh, dim, self.body, found)
        return found


def grid(
    gmsh: Gmsh,
    dim: int,
    tensor: bool,
    grading: Callable[[int], tuple[int, float]],
    fine: set[tuple[int, int]] | frozenset[tuple[int, int]] = frozenset(),
) -> None:
    """Mesh every rectangle or box of the model by a structured (transfinite) grid.

    Args:
        tensor: quadrilaterals or hexahedra, else each is cut into simplices.
        grading: number of cells along an axis, and the ratio of neighbouring cells.
        fine: ends (axis, 0 lower or 1 upper) at which the cells are small.
    """
    for _, curve in gmsh.model.getEntities(1):
        (first,), (last,) = gmsh.model.getParametrizationBounds(1, curve)
        start, end = gmsh.model.getValue(1, curve, [first]), gmsh.model.getValue(1, curve, [last])
        axis = int(np.argmax(np.abs(np.subtract(end, start))))
        steps, ratio = grading(axis)
        from_start = (axis, 0 if start[axis] < end[axis] else 1) in fine
        law = "Bump" if ratio != 1 and {(axis, 0), (axis, 1)} <= fine else "Progression"
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
