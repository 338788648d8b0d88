"""A rectangle or box with its lower corner in the origin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from scipy.optimize import brentq

from geometry.builders.builder import Builder
from geometry.errors import GeometryError, SceneError, require
from geometry.keys import Key
from geometry.shape import Array, Model, Request

MOST_CELLS = 50_000_000
GROWTH = 0.3  # growth of the cell size per unit of distance from a contact side


@dataclass(frozen=True, kw_only=True)
class Block(Builder):
    """[0, length] x [0, height]; in 3D [0, length] x [0, width] x [0, height]."""

    lengths: ClassVar[tuple[str, ...]] = ("length", "height", "width")

    length: Annotated[float, Key("m", "size along x")]
    height: Annotated[float, Key("m", "size along the last axis")]
    width: Annotated[float | None, Key("m", "size along y, 3D only")] = None
    builder: Annotated[Literal["block"], Key("-", "the shape's name")] = "block"

    def bodies(self, dim: int) -> Mapping[str, tuple[str, ...]]:
        return {"block": tuple(self._sides(dim))}

    def check_model(self, model: Model) -> None:
        dim = 3 if model == "3d" else 2
        if dim == 3 and self.width is None:
            raise SceneError('width: missing, a block needs it in model = "3d"')
        require(dim == 3 or self.width is None, "width", self.width, "a plane model has no width; remove the key")
        cells = np.prod([np.ceil(size / self.mesh_size) for size in self._size(dim)])
        require(cells < MOST_CELLS, "mesh_size", self.mesh_size, f"makes more than {MOST_CELLS} cells")

    def box(self, dim: int) -> Array:
        return np.array([np.zeros(dim), self._size(dim)])

    def sample(self, side: str, dim: int) -> tuple[Array, Array]:
        axis, end = self._sides(dim)[side.split(".")[1]]
        corners = np.array(list(product((0.0, 1.0), repeat=dim)))
        corners = corners[corners[:, axis] == end] * np.array(self._size(dim))
        return corners, np.tile(np.eye(dim)[axis] * (2 * end - 1), (len(corners), 1))

    def draw(self, gmsh: Any, request: Request) -> None:
        dim, size = request.dim, self._size(request.dim)
        add = gmsh.model.occ.addRectangle if dim == 2 else gmsh.model.occ.addBox
        volume = add(0, 0, 0, *size)
        gmsh.model.occ.synchronize()
        tags = {}
        for name, (axis, end) in self._sides(dim).items():
            tags[name] = self._side_at(gmsh, dim, axis, end * size[axis])
            gmsh.model.addPhysicalGroup(dim - 1, [tags[name]], tag=len(tags))
            gmsh.model.setPhysicalName(dim - 1, len(tags), f"block.{name}")
        gmsh.model.addPhysicalGroup(dim, [volume], tag=1)
        gmsh.model.setPhysicalName(dim, 1, "block")
        fine = [self._sides(dim)[side.split(".")[1]] for side in request.contact_sides]
        if self.contact_mesh_size is None or self.cells == "tensor":
            self._structured(gmsh, dim, fine)
        else:
            self._graded(gmsh, dim, fine)
            for slave, master in request.periodic:
                self._match(gmsh, dim, slave.split(".")[1], master.split(".")[1], tags)

    def _size(self, dim: int) -> tuple[float, ...]:
        return (self.length, self.height) if dim == 2 else (self.length, self.width or 0.0, self.height)

    @staticmethod
    def _sides(dim: int) -> dict[str, tuple[int, int]]:
        """Side -> (axis of its normal, 0 for the lower and 1 for the upper end)."""
        middle = {"front": (1, 0), "back": (1, 1)} if dim == 3 else {}
        return {"left": (0, 0), "right": (0, 1)} | middle | {"bottom": (dim - 1, 0), "top": (dim - 1, 1)}

    @staticmethod
    def _side_at(gmsh: Any, dim: int, axis: int, position: float) -> int:
        for _, tag in gmsh.model.getEntities(dim - 1):
            low, high = np.reshape(gmsh.model.getBoundingBox(dim - 1, tag), (2, 3))[:, axis]
            slack = 1e-6 * (1 + abs(position))  # gmsh widens bounding boxes by 1e-7
            if abs(low - position) < slack and abs(high - position) < slack:
                return int(tag)
        raise GeometryError(f"block: no side found at {'xyz'[axis]} = {position}")

    def _structured(self, gmsh: Any, dim: int, fine: list[tuple[int, int]]) -> None:
        """A grid; with `contact_mesh_size`, fine along each contact and graded away from it."""
        for _, curve in gmsh.model.getEntities(1):
            (first,), (last,) = gmsh.model.getParametrizationBounds(1, curve)
            start, end = gmsh.model.getValue(1, curve, [first]), gmsh.model.getValue(1, curve, [last])
            axis = int(np.argmax(np.abs(np.subtract(end, start))))
            steps, ratio = self._grading(self._size(dim)[axis], axis, fine)
            from_start = (axis, 0 if start[axis] < end[axis] else 1) in fine
            law = "Bump" if ratio != 1 and {(axis, 0), (axis, 1)} <= set(fine) else "Progression"
            gmsh.model.mesh.setTransfiniteCurve(
                curve, steps + 1, law, ratio if from_start or law == "Bump" else 1 / ratio
            )
        for kind in range(2, dim + 1):
            for _, tag in gmsh.model.getEntities(kind):
                if kind == 3:
                    gmsh.model.mesh.setTransfiniteVolume(tag)
                    continue
                gmsh.model.mesh.setTransfiniteSurface(tag, "Right" if dim == 2 else "Left")
                if self.cells == "tensor":
                    gmsh.model.mesh.setRecombine(2, tag)

    def _grading(self, length: float, axis: int, fine: list[tuple[int, int]]) -> tuple[int, float]:
        """Number of cells along an axis, and the ratio of neighbours (or gmsh's bump coefficient)."""
        if not fine or self.contact_mesh_size is None or self.contact_mesh_size == self.mesh_size:
            return max(1, round(length / self.mesh_size)), 1.0
        ends = sum(1 for side in fine if side[0] == axis)
        if ends == 0 or any(side[0] != axis for side in fine):
            return max(1, round(length / self.contact_mesh_size)), 1.0
        first, part = self.contact_mesh_size, length / ends
        if part <= first:
            return ends, 1.0
        ratio = 1 + GROWTH
        n = max(2, int(np.ceil(np.log1p(part / first * GROWTH) / np.log(ratio))))
        n = max(n, int(np.ceil(part / self.mesh_size)))
        if n * first >= part:
            return ends * n, 1.0
        ratio = brentq(lambda r: first * (r**n - 1) / (r - 1) - part, 1 + 1e-9, 10.0)
        return (n, ratio) if ends == 1 else (2 * n, ratio ** (-n))

    def _graded(self, gmsh: Any, dim: int, fine: list[tuple[int, int]]) -> None:
        """Unstructured simplices whose size grows with the distance from the contact sides."""
        mesh, size = gmsh.model.mesh, self._size(dim)
        fields = []
        for axis, end in fine:
            fields.append(mesh.field.add("MathEval"))
            distance = f"Abs({'xyz'[axis]} - {end * size[axis]:.17g})"
            mesh.field.setString(fields[-1], "F", f"{self.contact_mesh_size:.17g} + {GROWTH} * {distance}")
        fields.append(mesh.field.add("MathEval"))
        mesh.field.setString(fields[-1], "F", f"{self.mesh_size:.17g}")
        least = mesh.field.add("Min")
        mesh.field.setNumbers(least, "FieldsList", fields)
        mesh.field.setAsBackgroundMesh(least)
        for option in ("FromPoints", "FromCurvature", "ExtendFromBoundary"):
            gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)

    def _match(self, gmsh: Any, dim: int, slave: str, master: str, tags: dict[str, int]) -> None:
        """Make the slave side's mesh the master side's, moved across."""
        (axis, to), (_, origin) = self._sides(dim)[slave], self._sides(dim)[master]
        shift = np.eye(4)
        shift[axis, 3] = (to - origin) * self._size(dim)[axis]
        gmsh.model.mesh.setPeriodic(dim - 1, [tags[slave]], [tags[master]], list(shift.ravel()))
