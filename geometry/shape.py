"""Interface of a geometry, builder or user's file: its names and sides before any mesh exists, and its gmsh model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Self

from geometry.arrays import Array
from geometry.protocols import Gmsh

Model = Literal["plane strain", "plane stress", "axisymmetric", "3d"]


@dataclass(frozen=True, kw_only=True)
class Request:
    """What the scene requires of a mesh beyond the shape itself; sides are named body.side."""

    model: Model
    contact_sides: tuple[str, ...] = ()  # sides to refine to `contact_mesh_size`
    periodic: tuple[tuple[str, str], ...] = ()  # pairs of sides whose meshes must match

    @property
    def dim(self) -> int:
        return 3 if self.model == "3d" else 2


class Shape:
    """A geometry, in metres. `dim` (2 or 3) is that of the model; a shape may differ in 2D and in 3D.

    Any of these methods may raise a GeometryError or SceneError if the shape cannot be what the scene says.
    """

    @property
    def degree(self) -> int:
        """Polynomial degree of displacement and geometry, 1 or 2."""
        raise NotImplementedError

    def bodies(self, dim: int) -> Mapping[str, tuple[str, ...]]:
        """Names of the bodies and of each body's sides."""
        raise NotImplementedError

    def check_model(self, model: Model) -> None:
        """Raise SceneError for a parameter that the model does not have, or that it needs and that is missing."""
        raise NotImplementedError

    def box(self, dim: int) -> Array:
        """Lower and upper corner of the bounding box (2, d) [m]."""
        raise NotImplementedError

    def sample(self, side: str, dim: int) -> tuple[Array, Array]:
        """Sample points (k, d) [m] of a side (named body.side) and the unit outward normals there (k, d).

        They include the corners and extreme points of the side; opposite periodic sides list them in the same order.
        """
        raise NotImplementedError

    def refined(self, factor: float) -> Self:
        """The same shape with cells `factor` times as long.

        Raises:
            SceneError: the scene has no mesh size that could be changed.
        """
        raise NotImplementedError

    def put(self, gmsh: Gmsh, request: Request) -> float:
        """Put the shape, its mesh sizes and its named physical groups into the current gmsh model, and mesh it.

        Bodies are physical groups of cells, sides are groups of facets named body.side. The mesh may have degree 1;
        the caller raises it to `degree`.

        Returns:
            Length of the gmsh model's unit [m].
        """
        raise NotImplementedError
