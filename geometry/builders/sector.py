"""A sector of a ring, meshed by a grid: one stone of an arch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from stickslip.geometry.arrays import ROUNDING, Array
from stickslip.geometry.builders import sides
from stickslip.geometry.builders.builder import Builder
from stickslip.geometry.builders.cuboid import transfinite
from stickslip.geometry.builders.ring import draw_sectors
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import Model, Request


@dataclass(frozen=True, kw_only=True)
class Sector(Builder):
    """Ring sector between two angles about the origin; the side `right` is at the start angle, `left` at the end."""

    lengths: ClassVar[tuple[str, ...]] = ("inner_radius", "outer_radius")

    inner_radius: Annotated[float, Key("m", "of the inside")]
    outer_radius: Annotated[float, Key("m", "of the outside")]
    start: Annotated[float, Key("-", "angle of the right side from the x axis, in degrees, counterclockwise")]
    end: Annotated[float, Key("-", "angle of the left side; less than 180 beyond the start")]

    def bodies(self, dim: int) -> Mapping[str, tuple[str, ...]]:
        return {"sector": ("left", "right", "inside", "outside")}

    def check_model(self, model: Model) -> None:
        require(self.contact_mesh_size is None, "contact_mesh_size", self.contact_mesh_size, "use mesh_size alone")

    def cell_count(self, request: Request) -> float:
        size, across = self.mesh_size, self.outer_radius - self.inner_radius
        along = np.radians(self.end - self.start) * self.outer_radius
        return float(max(1.0, along / size) * max(1.0, across / size)) * self.pieces(2)

    def steps(self) -> tuple[int, int]:
        """Number of cells along the arcs, and from the inner arc to the outer one."""
        along = np.radians(self.end - self.start) * self.outer_radius / self.mesh_size
        across = (self.outer_radius - self.inner_radius) / self.mesh_size
        return max(1, int(np.ceil(along * (1 - ROUNDING)))), max(1, round(across))

    def box(self, dim: int) -> Array:
        points = np.concatenate([self.sample(side, dim)[0] for side in ("sector.inside", "sector.outside")])
        return np.array([points.min(axis=0), points.max(axis=0)])

    def sample(self, side: str, dim: int) -> tuple[Array, Array]:
        name, radii = side.split(".")[1], {"inside": self.inner_radius, "outside": self.outer_radius}
        if name in radii:
            extremes = [angle for angle in range(-360, 361, 90) if self.start < angle < self.end]
            outward = directions(np.array([*np.linspace(self.start, self.end, 5), *extremes]))
            return radii[name] * outward, outward if name == "outside" else -outward
        ((x, y),) = directions(np.array([self.end if name == "left" else self.start]))
        normal = np.array([-y, x]) if name == "left" else np.array([y, -x])
        return np.outer(list(radii.values()), [x, y]), np.tile(normal, (2, 1))

    def draw(self, gmsh: Gmsh, request: Request) -> None:
        ends = directions(np.array([self.start, self.end]))
        (inside, outside), (right, left) = draw_sectors(gmsh, (self.inner_radius, self.outer_radius), ends, False)
        names = {"left": [left], "right": [right], "inside": inside, "outside": outside}
        sides.name_groups(gmsh, 2, "sector", names)
        along, across = self.steps()
        for curves, count in (((*inside, *outside), along), ((left, right), across)):
            for curve in curves:
                gmsh.model.mesh.setTransfiniteCurve(curve, count + 1)
        transfinite(gmsh, 2, self.cells == "tensor")


def directions(angles: Array) -> Array:
    """Unit vectors (k, 2) at angles (k,) from the x axis, in degrees.

    >>> directions(np.array([0.0, 90.0])).round(15) + 0.0
    array([[1., 0.],
           [0., 1.]])
    """
    return np.stack([np.cos(np.radians(angles)), np.sin(np.radians(angles))], axis=1)
