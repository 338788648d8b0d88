"""Rings about the origin, one in another, and arches of ring sectors; all meshed by grids."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.arrays import CLOSE, ROUNDING, Array
from stickslip.geometry.builders.assembly import Assembly, BodyRow, CellKeys, Part
from stickslip.geometry.builders.builder import ONLY_PLANE, PLANE, Builder, Sides, directions, flat_side
from stickslip.geometry.builders.cuboid import Block, transfinite
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.geometry.mesh_sizes import graded, graded_count
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import Model, Request

ANGLE = "in degrees: 360, or 90: a quarter with sides x_axis and y_axis"
RADIAL = {"x_axis": (1, 0), "y_axis": (0, 0)}  # further sides of a quarter, see `Places`


@dataclass(frozen=True, kw_only=True)
class Ring(Builder):
    """A ring about the origin, or its quarter x, y >= 0, meshed by a grid; plane models only."""

    body: ClassVar[str] = "ring"
    models: ClassVar[tuple[Model, ...]] = PLANE
    elsewhere: ClassVar[str] = ONLY_PLANE
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
        # the kernel takes both circles of a thinner one for the same
        require(inner <= (1 - CLOSE) * self.outer_radius, "inner_radius", inner, thin)

    @property
    def radii(self) -> dict[str, float]:
        """Of the round sides [m]."""
        return {"inner": self.inner_radius, "outer": self.outer_radius}

    def sides(self, dim: int) -> Sides:
        outward = directions(np.arange(0, self.angle + (self.angle == 90), 22.5))
        inner, outer = (radius * outward for radius in self.radii.values())
        along = {
            name: flat_side(np.outer([*self.radii.values()], np.eye(2)[1 - place[0]]), *place)
            for name, place in RADIAL.items()
        }
        return {"inner": (inner, -outward), "outer": (outer, outward), **(along if self.angle == 90 else {})}

    def _along(self, fine: Collection[str], angle: float) -> float:
        """Cells along the circles over an angle [rad], as many as the larger or the finer of the two needs."""
        return float(
            max(angle * r / (self.fine_size if name in fine else self.mesh_size) for name, r in self.radii.items())
        )

    def cell_count(self, request: Request) -> float:
        fine, across = self.touched(request) & {*self.radii}, self.outer_radius - self.inner_radius
        size = self.fine_size if fine else self.mesh_size
        layers = graded_count(across, size, self.mesh_size, max(1, len(fine)))
        return max(1.0, self._along(fine, np.radians(self.angle))) * layers * self.pieces(2)

    def draw(self, gmsh: Gmsh, request: Request) -> None:
        """Drawn in quarters, whose cells are contact_mesh_size long at contact sides and grow from there."""
        quarters = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])[: 4 if self.angle == 360 else 2]
        circles, spokes = draw_sectors(gmsh, (self.inner_radius, self.outer_radius), quarters, self.angle == 360)
        found = dict(zip(self.radii, circles, strict=True))
        if self.angle == 90:
            found |= {"x_axis": [spokes[0]], "y_axis": [spokes[1]]}
        self.name_groups(gmsh, 2, found)
        fine, across = self.touched(request) & {*self.radii}, self.outer_radius - self.inner_radius
        along = max(2, int(np.ceil(self._along(fine, np.pi / 2) * (1 - ROUNDING))))
        for curve in (*circles[0], *circles[1]):
            gmsh.model.mesh.setTransfiniteCurve(curve, along + 1)
        steps, ratio = max(1, round(across / self.mesh_size)), 1.0
        if fine and self.fine_size < self.mesh_size:
            steps, ratio = graded(across, self.fine_size, self.mesh_size, len(fine))
        law = "Bump" if len(fine) == 2 and ratio != 1 else "Progression"
        for curve in spokes:
            gmsh.model.mesh.setTransfiniteCurve(curve, steps + 1, law, 1 / ratio if fine == {"outer"} else ratio)
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


@dataclass(frozen=True, kw_only=True)
class Sector(Builder):
    """Ring sector between two angles about the origin; the side `right` is at the start angle, `left` at the end."""

    body: ClassVar[str] = "sector"
    lengths: ClassVar[tuple[str, ...]] = ("inner_radius", "outer_radius")

    inner_radius: Annotated[float, Key("m", "of the inside")]
    outer_radius: Annotated[float, Key("m", "of the outside")]
    start: Annotated[float, Key("-", "angle of the right side from the x axis, in degrees, counterclockwise")]
    end: Annotated[float, Key("-", "angle of the left side; less than 180 beyond the start")]

    def check_model(self, model: Model) -> None:
        require(self.contact_mesh_size is None, "contact_mesh_size", self.contact_mesh_size, "use mesh_size alone")

    def _counts(self) -> tuple[float, float]:
        """Number of cells along the arcs, and from the inner arc to the outer one, not rounded."""
        along = np.radians(self.end - self.start) * self.outer_radius
        return float(along / self.mesh_size), (self.outer_radius - self.inner_radius) / self.mesh_size

    def cell_count(self, request: Request) -> float:
        along, across = self._counts()
        return max(1.0, along) * max(1.0, across) * self.pieces(2)

    def sides(self, dim: int) -> Sides:
        extremes = [angle for angle in range(-360, 361, 90) if self.start < angle < self.end]
        outward = directions(np.array([*np.linspace(self.start, self.end, 5), *extremes]))
        (a, b), (c, d) = ends = directions(np.array([self.end, self.start]))
        left, right = (np.outer([self.inner_radius, self.outer_radius], end) for end in ends)
        return {
            "left": (left, np.tile([-b, a], (2, 1))),
            "right": (right, np.tile([d, -c], (2, 1))),
            "inside": (self.inner_radius * outward, -outward),
            "outside": (self.outer_radius * outward, outward),
        }

    def draw(self, gmsh: Gmsh, request: Request) -> None:
        ends = directions(np.array([self.start, self.end]))
        (inside, outside), (right, left) = draw_sectors(gmsh, (self.inner_radius, self.outer_radius), ends, False)
        names = {"left": [left], "right": [right], "inside": inside, "outside": outside}
        self.name_groups(gmsh, 2, names)
        along, across = self._counts()
        steps = max(1, int(np.ceil(along * (1 - ROUNDING)))), max(1, round(across))
        for curves, count in zip(((*inside, *outside), (left, right)), steps, strict=True):
            for curve in curves:
                gmsh.model.mesh.setTransfiniteCurve(curve, count + 1)
        transfinite(gmsh, 2, self.cells == "tensor")


@dataclass(frozen=True, kw_only=True)
class Rings(Assembly):
    """Two rings about the origin, or a quarter of both; the inner one is larger than the hole by the interference."""

    models: ClassVar[tuple[Model, ...]] = PLANE
    lengths: ClassVar[tuple[str, ...]] = ("inner_radius", "radius", "outer_radius", "inner_mesh_size")
    distances: ClassVar[tuple[str, ...]] = ("interference",)

    inner_radius: Annotated[float, Key("m", "of the hole in the inner ring")]
    radius: Annotated[float, Key("m", "of the hole in the outer ring")]
    outer_radius: Annotated[float, Key("m", "of the outer ring")]
    interference: Annotated[
        float, Key("m", "the inner ring's radius beyond that of the outer ring's hole: their overlap; negative: a gap")
    ] = 0.0
    inner_mesh_size: Annotated[
        float | None,
        Key(
            "m",
            "mesh_size of the inner ring, contact_mesh_size in the same ratio; "
            "absent: where the rings touch, both have as many cells",
        ),
    ] = None
    angle: Annotated[Literal[360, 90], Key("-", ANGLE)] = 360
    builder: Annotated[Literal["rings"], Key("-", "the shape's name")] = "rings"

    @property
    def fitted_radius(self) -> float:
        """Outer radius of the inner ring [m]."""
        return self.radius + self.interference

    def check_keys(self) -> None:
        require(self.inner_radius < self.radius, "inner_radius", self.inner_radius, "must be smaller than radius")
        require(self.radius < self.outer_radius, "radius", self.radius, "must be smaller than outer_radius")
        fits = self.inner_radius < self.fitted_radius < self.outer_radius
        require(fits, "interference", self.interference, "moves the inner ring's outside beyond one of the other radii")

    def parts(self) -> Mapping[str, Part]:
        inner = self._ring(self.inner_radius, self.fitted_radius, self._inner_cell_keys())
        return {"inner": inner, "outer": self._ring(self.radius, self.outer_radius, self.cell_keys())}

    def _ring(self, inner: float, outer: float, cell_keys: CellKeys) -> Part:
        ring = Ring(inner_radius=inner, outer_radius=outer, angle=self.angle, **cell_keys)
        return Part(shape=ring, renamed={"inner": "inside", "outer": "outside"})

    def _inner_cell_keys(self) -> CellKeys:
        """Mesh keys of the inner ring; by default it has as many cells around as the outer ring where the two touch.

        A ring has equally many cells on both of its circles, as the larger or the finer of them needs.
        """
        if self.inner_mesh_size is not None:
            return self.cell_keys(self.inner_mesh_size)
        keys = self.cell_keys(self.mesh_size * self.fitted_radius / self.outer_radius)
        if self.contact_mesh_size is not None:
            along = self.contact_mesh_size * self.fitted_radius / self.radius
            keys["contact_mesh_size"] = min(keys["mesh_size"], along)
        return keys


@dataclass(frozen=True, kw_only=True)
class Arch(BodyRow):
    """Ring sectors stone_1 (leftmost), stone_2, ... about the origin, symmetric about the y axis.

    The sides `left` and `right` of a stone, as seen from the origin, are its joints; `top` is that of a springer.
    """

    models: ClassVar[tuple[Model, ...]] = PLANE
    lengths: ClassVar[tuple[str, ...]] = ("inner_radius", "thickness", "springer_height")

    inner_radius: Annotated[float, Key("m", "of the inside")]
    thickness: Annotated[float, Key("m", "from the inside to the outside")]
    angle: Annotated[float, Key("-", "of the whole arch, in degrees")] = 180.0
    springer_height: Annotated[
        float | None, Key("m", "of the blocks left_springer and right_springer under the arch's ends; absent: no such")
    ] = None
    builder: Annotated[Literal["arch"], Key("-", "the shape's name")] = "arch"

    @property
    def outer_radius(self) -> float:
        """Radius of the outside of the arch [m]."""
        return self.inner_radius + self.thickness

    def check_keys(self) -> None:
        super().check_keys()
        require(0 < self.angle <= 180, "angle", self.angle, "must be above 0 and not above 180 degrees")
        require(self.angle / self.count <= 90, "count", self.count, "makes stones of more than 90 degrees")
        fine = self.contact_mesh_size
        require(fine is None, "contact_mesh_size", fine, "an arch's cells are alike; use mesh_size")

    def parts(self) -> Mapping[str, Part]:
        stones = {f"stone_{k}": self._stone(k) for k in range(1, self.count + 1)}
        if self.springer_height is None:
            return stones
        left = self._springer(0, 90 + self.angle / 2 - 180, self.outer_radius, self.springer_height)
        right = self._springer(self.count + 1, 90 - self.angle / 2, self.inner_radius, self.springer_height)
        return {"left_springer": left, **stones, "right_springer": right}

    def _stone(self, number: int) -> Part:
        right, left = (90 + self.angle * (0.5 - k / self.count) for k in (number, number - 1))
        sector = Sector(
            inner_radius=self.inner_radius,
            outer_radius=self.outer_radius,
            start=right,
            end=left,
            **self.cell_keys_of(number),
        )
        return Part(shape=sector)

    def _springer(self, number: int, turn: float, first: float, height: float) -> Part:
        """The block under one end of the arch.

        Args:
            number: place in the row, 0 for the left springer.
            turn: angle by which the block is turned, in degrees.
            first: radius of its upper left corner [m].
            height: [m].
        """
        ((c, s),) = directions(np.array([turn]))
        block = Block(length=self.thickness, height=height, **self.cell_keys_of(number))
        outward = -1 if number == 0 else 1
        corner = first * outward * np.array([c, s]) - height * np.array([-s, c])
        return Part(shape=block, turn=((c, -s), (s, c)), shift=(float(corner[0]), float(corner[1])))
