"""A symmetric wedge that narrows downwards, to be pressed into a notch between two inclined walls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from stickslip.geometry.arrays import ROUNDING
from stickslip.geometry.builders.builder import ONLY_PLANE, PLANE, Builder, Sides, directions
from stickslip.geometry.builders.cuboid import transfinite
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.geometry.mesh_sizes import graded, graded_count
from stickslip.geometry.shape import Model, Request


@dataclass(frozen=True, kw_only=True)
class Wedge(Builder):
    """Trapezium between y = 0 and y = height, symmetric about x = 0, meshed by a grid; plane models only."""

    body: ClassVar[str] = "wedge"
    models: ClassVar[tuple[Model, ...]] = PLANE
    elsewhere: ClassVar[str] = ONLY_PLANE
    lengths: ClassVar[tuple[str, ...]] = ("bottom_width", "height")

    half_angle: Annotated[float, Key("-", "angle between an inclined side and the vertical, in degrees")]
    bottom_width: Annotated[float, Key("m", "size along x at y = 0; the top is wider by 2 height tan(half_angle)")]
    height: Annotated[float, Key("m", "size along y")]
    builder: Annotated[Literal["wedge"], Key("-", "the shape's name")] = "wedge"

    def __post_init__(self) -> None:
        super().__post_init__()
        require(0 < self.half_angle < 90, "half_angle", self.half_angle, "must lie between 0 and 90 degrees")

    @property
    def top_width(self) -> float:
        """Size along x at y = height [m]."""
        return float(self.bottom_width + 2 * self.height * np.tan(np.radians(self.half_angle)))

    @property
    def side_length(self) -> float:
        """Length of an inclined side [m]."""
        return float(self.height / np.cos(np.radians(self.half_angle)))

    def cell_count(self, request: Request) -> float:
        fine = self.touched(request)
        counts: list[float] = []
        for along, length, ends in (
            ({"left", "right"}, self.side_length, {"bottom", "top"}),
            ({"bottom", "top"}, self.top_width, {"left", "right"}),
        ):
            size = self.fine_size if fine & along else self.mesh_size
            counts.append(length / size)
            if not fine & along and fine & ends:
                counts[-1] = graded_count(length, self.fine_size, self.mesh_size, len(fine & ends))
        return max(1.0, counts[0]) * max(1.0, counts[1]) * self.pieces(2)

    def sides(self, dim: int) -> Sides:
        """Both ends of each side: the lower or left one, then the upper or right one."""
        low, high, top = self.bottom_width / 2, self.top_width / 2, self.height
        (across, down), both = directions(np.array([-self.half_angle]))[0], np.ones((2, 1))
        return {
            "left": (np.array([[-low, 0.0], [-high, top]]), both * [-across, down]),
            "right": (np.array([[low, 0.0], [high, top]]), both * [across, down]),
            "bottom": (np.array([[-low, 0.0], [low, 0.0]]), both * [0.0, -1.0]),
            "top": (np.array([[-high, top], [high, top]]), both * [0.0, 1.0]),
        }

    def draw(self, gmsh: Any, request: Request) -> None:
        occ = gmsh.model.occ
        ends = [[tuple(point) for point in points] for points, _ in self.sides(2).values()]
        points = {corner: occ.addPoint(*corner, 0) for corner in sorted({corner for pair in ends for corner in pair})}
        lines = {side: occ.addLine(points[a], points[b]) for side, (a, b) in zip(self.sides(2), ends, strict=True)}
        occ.addPlaneSurface([occ.addCurveLoop([lines[side] for side in ("bottom", "right", "top", "left")])])
        occ.synchronize()
        self.name_groups(gmsh, 2, {side: [line] for side, line in lines.items()})
        fine = self.touched(request)
        inclined, level = ("left", "right"), ("bottom", "top")
        for along, length, across in ((inclined, self.side_length, level), (level, self.top_width, inclined)):
            count, law, ratio = self._grading(length, bool(fine & {*along}), [end in fine for end in across])
            for side in along:
                gmsh.model.mesh.setTransfiniteCurve(lines[side], count + 1, law, ratio)
        transfinite(gmsh, 2, self.cells == "tensor")

    def _grading(self, length: float, contact: bool, ends: list[bool]) -> tuple[int, str, float]:
        """Number of cells along two opposite sides, and gmsh's law and number of how their lengths change.

        Args:
            length: of the longer one [m].
            contact: whether one of the two is to be fine all along.
            ends: whether the sides where they start and end are to be fine.
        """
        size = self.fine_size if contact else self.mesh_size
        if contact or not any(ends) or self.fine_size == self.mesh_size:
            return max(1, int(np.ceil(length / size * (1 - ROUNDING)))), "Progression", 1.0
        count, ratio = graded(length, self.fine_size, self.mesh_size, sum(ends))
        law = "Bump" if all(ends) and ratio != 1 else "Progression"
        return count, law, ratio if ends[0] else 1 / ratio
