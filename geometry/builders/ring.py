"""A ring about the origin, and the drawing of ring sectors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.arrays import CLOSE, ROUNDING, Array
from stickslip.geometry.builders import sides
from stickslip.geometry.builders.builder import Builder
from stickslip.geometry.builders.cuboid import transfinite
from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.keys import Key
from stickslip.geometry.mesh.sizes import graded, graded_count
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import Model, Request

ANGLE = "in degrees: 360, or 90: a quarter with sides x_axis and y_axis"
RADIAL = {"x_axis": 1, "y_axis": 0}  # sides of a quarter -> axis of the normal


@dataclass(frozen=True, kw_only=True)
class Ring(Builder):
    """A ring about the origin, or its quarter x, y >= 0, meshed by a grid; plane models only."""

    lengths: ClassVar[tuple[str, ...]] = ("inner_radius", "outer_radius")

    inner_radius: Annotated[float, Key("m", "of the hole")]
    outer_radius: Annotated[float, Key("m", "of the ring")]
    angle: Annotated[Literal[360, 90], Key("-", ANGLE)] = 360
    builder: Annotated[Literal["ring"], Key("-", "the shape's name")] = "ring"

    def __post_init__(self) -> None:
        super().__post_init__()
        inner = self.inner_radius
        require(inner < self.outer_radius, "inner_radius", inner, "must be smaller than outer_radius")
        thin = f"too near to outer_radius = {self.outer_radius:g}: the ring must be a millionth of it thick"
        # of the radius: the kernel takes both circles of a thinner one for the same
        require(inner <= (1 - CLOSE) * self.outer_radius, "inner_radius", inner, thin)

    def bodies(self, dim: int) -> Mapping[str, tuple[str, ...]]:
        return {"ring": ("inner", "outer", *(RADIAL if self.angle == 90 else ()))}

    def check_model(self, model: Model) -> None:
        if model in ("3d", "axisymmetric"):
            raise SceneError('builder = "ring": there is one in plane models only')

    def cell_count(self, request: Request) -> float:
        radii = {"inner": self.inner_radius, "outer": self.outer_radius}
        touched = {side.split(".")[1] for side in request.contact_sides} & radii.keys()
        sizes = {name: (self.fine_size if name in touched else self.mesh_size) for name in radii}
        along = max(np.radians(self.angle) * radii[name] / sizes[name] for name in radii)
        across = graded_count(
            self.outer_radius - self.inner_radius, min(sizes.values()), self.mesh_size, max(1, len(touched))
        )
        return float(max(1.0, along) * across) * self.pieces(2)

    def box(self, dim: int) -> Array:
        return self.outer_radius * np.array([[0.0, 0.0] if self.angle == 90 else [-1.0, -1.0], [1.0, 1.0]])

    def sample(self, side: str, dim: int) -> tuple[Array, Array]:
        name, radii = side.split(".")[1], {"inner": self.inner_radius, "outer": self.outer_radius}
        if name in radii:
            angles = np.radians(np.arange(0, self.angle + (self.angle == 90), 22.5))
            outward = np.stack([np.cos(angles), np.sin(angles)], axis=1)
            return radii[name] * outward, outward if name == "outer" else -outward
        points = np.outer(list(radii.values()), np.eye(2)[1 - RADIAL[name]])
        return points, sides.constant_normals(RADIAL[name], 0, points.shape)

    def draw(self, gmsh: Gmsh, request: Request) -> None:
        """Drawn in quarters, each bounded by two arcs and two straight lines."""
        directions = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])[: 4 if self.angle == 360 else 2]
        circles, spokes = draw_sectors(gmsh, (self.inner_radius, self.outer_radius), directions, self.angle == 360)
        found = dict(zip(("inner", "outer"), circles, strict=True))
        if self.angle == 90:
            found |= {"x_axis": [spokes[0]], "y_axis": [spokes[1]]}
        sides.name_groups(gmsh, 2, "ring", found)
        self._grid(gmsh, circles, spokes, {side.split(".")[1] for side in request.contact_sides})

    def _grid(self, gmsh: Gmsh, circles: list[list[int]], spokes: list[int], contacts: set[str]) -> None:
        """Grid whose cells are contact_mesh_size long at contact sides and grow from there up to mesh_size."""
        radii = {"inner": self.inner_radius, "outer": self.outer_radius}
        touched = contacts & radii.keys()
        fine = self.fine_size if touched else self.mesh_size
        counts = [np.pi / 2 * radii[name] / (fine if name in touched else self.mesh_size) for name in radii]
        along = max(2, int(np.ceil(max(counts) * (1 - ROUNDING))))
        for curve in (*circles[0], *circles[1]):
            gmsh.model.mesh.setTransfiniteCurve(curve, along + 1)
        across = self.outer_radius - self.inner_radius
        steps, ratio = max(1, round(across / self.mesh_size)), 1.0
        if fine < self.mesh_size:
            steps, ratio = graded(across, fine, self.mesh_size, len(touched))
        law = "Bump" if len(touched) == 2 and ratio != 1 else "Progression"
        for curve in spokes:
            gmsh.model.mesh.setTransfiniteCurve(curve, steps + 1, law, 1 / ratio if touched == {"outer"} else ratio)
        transfinite(gmsh, 2, self.cells == "tensor")


def draw_sectors(
    gmsh: Gmsh, radii: tuple[float, float], directions: Array, closed: bool
) -> tuple[list[list[int]], list[int]]:
    """Put the ring sectors between neighbouring directions into the gmsh model, without a mesh.

    Args:
        radii: inner and outer one.
        directions: unit vectors (k, 2), counterclockwise.
        closed: there is a sector from the last direction to the first.

    Returns:
        Tags of the arcs on the inner circle and on the outer one; tags of the straight lines between the circles (k,).
    """
    occ = gmsh.model.occ
    centre = occ.addPoint(0, 0, 0)
    points = [[occ.addPoint(*(r * d), 0) for d in directions] for r in radii]
    spokes = [occ.addLine(a, b) for a, b in zip(*points, strict=True)]
    ends = [(k, (k + 1) % len(directions)) for k in range(len(directions) - (not closed))]
    circles = [[occ.addCircleArc(row[a], centre, row[b]) for a, b in ends] for row in points]
    for k, (a, b) in enumerate(ends):  # along the inner circle, out, back along the outer circle, in
        occ.addPlaneSurface([occ.addCurveLoop([circles[0][k], spokes[b], circles[1][k], spokes[a]])])
    occ.remove([(0, centre)])
    occ.synchronize()
    return circles, spokes
