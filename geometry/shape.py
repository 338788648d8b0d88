"""What a geometry answers, be it a builder or a user's file: its names before any mesh exists, and its gmsh model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self

from geometry.arrays import Array

Model = Literal["plane strain", "plane stress", "axisymmetric", "3d"]


@dataclass(frozen=True, kw_only=True)
class Request:
    """What the scene wants of a mesh beyond the shape itself."""

    model: Model
    contact_sides: tuple[str, ...] = ()  # sides to refine to `contact_mesh_size`
    periodic: tuple[tuple[str, str], ...] = ()  # pairs of sides whose meshes must match

    @property
    def dim(self) -> int:
        return 3 if self.model == "3d" else 2


class Shape:
    """A geometry, in metres. `dim` is the model's; a shape may mean different things in 2D and in 3D.

    A shape that cannot be what the scene says raises a GeometryError or SceneError from any of these.
    """

    @property
    def degree(self) -> int:
        """Polynomial degree of displacement and geometry, 1 or 2."""
        raise NotImplementedError

    def bodies(self, dim: int) -> Mapping[str, tuple[str, ...]]:
        """Names of the bodies and of each body's sides."""
        raise NotImplementedError

    def check_model(self, model: Model) -> None:
        """Refuse parameters that the model does not have, or lacks."""
        raise NotImplementedError

    def box(self, dim: int) -> Array:
        """Lower and upper corner of the bounding box (2, d) [m]."""
        raise NotImplementedError

    def sample(self, side: str, dim: int) -> tuple[Array, Array]:
        """Points (k, d) [m] of a side (as body.side), with the unit outward normals there (k, d).

        Corners and extremes of the side are among them; opposite periodic sides list them in the same order.
        """
        raise NotImplementedError

    def refined(self, factor: float) -> Self:
        """The same shape with cells `factor` times as long.

        Raises:
            SceneError: the scene says no size that could be changed.
        """
        raise NotImplementedError

    def put(self, gmsh: Any, request: Request) -> float:
        """Put the shape, its mesh sizes and its named physical groups into the current gmsh model, and mesh it.

        Bodies are groups of cells, sides are groups of facets named body.side. Degree 1; the caller raises it.

        Returns:
            Length of the gmsh model's unit [m].
        """
        raise NotImplementedError
