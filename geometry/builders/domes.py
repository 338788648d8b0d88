"""Half discs and half balls, alone or two that face each other: cells grow with the distance from the pole."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.builders.assembly import CellKeys, Pair, Part
from stickslip.geometry.builders.builder import PLANE, SYMMETRIC, Builder, Sides, box_corners, directions, flat_side
from stickslip.geometry.errors import require
from stickslip.geometry.keys import Key
from stickslip.geometry.mesh_sizes import SIMPLICES, beyond, cells_around, grow, norm
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import Model, Request


@dataclass(frozen=True, kw_only=True)
class Dome(Builder):
    """A round body, cut by a plane, that stands on its pole."""

    gridded: ClassVar[bool] = False
    lengths: ClassVar[tuple[str, ...]] = ("radius", "contact_radius")

    radius: Annotated[float, Key("m", "of the disc or ball")]
    contact_radius: Annotated[
        float | None, Key("m", "cells have contact_mesh_size this far from the pole; absent: radius / 8")
    ] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        near = self.contact_radius
        require(near is None or near <= self.radius, "contact_radius", near, "must not exceed radius")

    @property
    def near(self) -> float:
        """Distance from the pole within which cells have `contact_mesh_size` [m]."""
        return self.radius / 8 if self.contact_radius is None else self.contact_radius

    def cell_count(self, request: Request) -> float:
        dim = request.dim
        half = cells_around(dim, self.fine_size, self.near, self.mesh_size, self.radius)
        there = float(np.prod(np.ptp(self.box(dim), axis=0)[:-1])) / (2 * self.radius) ** (dim - 1)
        return SIMPLICES[dim] * half * there

    def size_cells(self, gmsh: Gmsh) -> None:
        """Set the mesh sizes of the current gmsh model."""
        grow(gmsh, self.mesh_size, [(self.fine_size, beyond(self.near, norm("x", "y", "z")))])


@dataclass(frozen=True, kw_only=True)
class HalfDisc(Dome):
    """Half a disc with its pole at the origin and its flat side at y = radius; if axisymmetric, half a ball."""

    body: ClassVar[str] = "disc"
    models: ClassVar[tuple[Model, ...]] = (*PLANE, "axisymmetric")
    elsewhere: ClassVar[str] = 'there is none in 3D; use "half_ball"'

    symmetric: Annotated[bool, Key("-", SYMMETRIC)] = False
    builder: Annotated[Literal["half_disc"], Key("-", "the shape's name")] = "half_disc"

    def check_model(self, model: Model) -> None:
        super().check_model(model)
        self.check_symmetric(self.symmetric, model)

    def sides(self, dim: int) -> Sides:
        r, left = self.radius, 0.0 if self.symmetric else -1.0
        normals = directions(np.arange(-90 if self.symmetric else -180, 1, 22.5))
        box = r * np.array([[left, 0.0], [1.0, 1.0]])
        axis = {"axis": box_corners(box, 0, 0)} if self.symmetric else {}
        return {"arc": (r * (normals + np.array([0.0, 1.0])), normals), "top": box_corners(box, 1, 1), **axis}

    def draw(self, gmsh: Gmsh, request: Request) -> None:
        """The pole and the centre are vertices of the mesh."""
        occ, r = gmsh.model.occ, self.radius
        pole, centre, right = (occ.addPoint(*point, 0) for point in ((0, 0), (0, r), (r, r)))
        arcs, tops, axis = [occ.addCircleArc(pole, centre, right)], [occ.addLine(right, centre)], []
        if self.symmetric:
            axis = [occ.addLine(centre, pole)]
        else:
            left = occ.addPoint(-r, r, 0)
            tops.append(occ.addLine(centre, left))
            arcs.append(occ.addCircleArc(left, centre, pole))
        occ.addPlaneSurface([occ.addCurveLoop([arcs[0], *tops, *axis, *arcs[1:]])])
        occ.synchronize()
        self.name_groups(gmsh, 2, {"arc": arcs, "top": tops} | ({"axis": axis} if axis else {}))
        self.size_cells(gmsh)


QUARTER = {"x_plane": (0, 0), "y_plane": (1, 0)}  # its further sides, see `Places`
SYMMETRY = "quarter: x, y >= 0 only, with sides x_plane and y_plane"


@dataclass(frozen=True, kw_only=True)
class HalfBall(Dome):
    """Half a ball with its pole at the origin and its flat side on top, at z = radius; 3D only."""

    body: ClassVar[str] = "ball"
    models: ClassVar[tuple[Model, ...]] = ("3d",)
    elsewhere: ClassVar[str] = 'there is one in 3D only; use "half_disc"'

    symmetry: Annotated[Literal["none", "quarter"], Key("-", SYMMETRY)] = "none"
    builder: Annotated[Literal["half_ball"], Key("-", "the shape's name")] = "half_ball"

    @property
    def quarter(self) -> bool:
        return self.symmetry == "quarter"

    def sides(self, dim: int) -> Sides:
        around = np.pad(directions(np.arange(0.0, 91.0 if self.quarter else 360.0, 45.0)), ((0, 0), (0, 1)))
        r, up = self.radius, np.array([0.0, 0.0, 1.0])
        normals = np.concatenate([-up[None], around, (around - up) / np.sqrt(2)])
        sides = {"cap": (r * (normals + up), normals), "top": flat_side(r * np.array([up, *(around + up)]), 2, 1)}
        for name, place in QUARTER.items() if self.quarter else ():
            along = np.eye(3)[1 - place[0]]
            sides[name] = flat_side(r * np.array([0 * up, up, along + up, (along - up) / np.sqrt(2) + up]), *place)
        return sides

    def draw(self, gmsh: Gmsh, request: Request) -> None:
        """Drawn in quarters: the pole is then a vertex, and no surface has a seam or a singular point there."""
        occ, r = gmsh.model.occ, self.radius
        quarters = []
        for turn in range(1 if self.quarter else 4):
            quarters.append((3, occ.addSphere(0, 0, 0, r, angle1=0, angle2=np.pi / 2, angle3=np.pi / 2)))
            occ.rotate(quarters[-1:], 0, 0, 0, 1, 0, 0, -np.pi / 2)  # the octant x, y >= 0, z <= 0
            occ.rotate(quarters[-1:], 0, 0, 0, 0, 0, 1, turn * np.pi / 2)
        occ.translate(quarters, 0, 0, r)
        if not self.quarter:
            occ.fragment(quarters[:1], quarters[1:])
        occ.synchronize()
        flat = {"top": (2, 1)} | (QUARTER if self.quarter else {})
        self.name_groups(gmsh, 3, self.outer(gmsh, 3, flat, rest="cap"))
        self.size_cells(gmsh)


class DomeKeys(CellKeys):
    """Keys of one of two domes."""

    radius: float
    contact_radius: float | None


@dataclass(frozen=True, kw_only=True)
class Domes(Pair):
    """Two domes: the pole of the lower body is the origin, that of the upper body lies at `gap` above it."""

    lengths: ClassVar[tuple[str, ...]] = (*Pair.lengths, "radius", "lower_radius", "contact_radius")

    radius: Annotated[float, Key("m", "of the upper body")]
    lower_radius: Annotated[float | None, Key("m", "of the lower body; absent: radius")] = None
    contact_radius: Annotated[
        float | None, Key("m", "cells have contact_mesh_size this far from the poles; absent: radius / 8, each its own")
    ] = None

    def check_keys(self) -> None:
        near = self.contact_radius
        require(near is None or near <= min(self.radius, self._lower), "contact_radius", near, "exceeds a radius")

    def keys_of_both(self) -> tuple[DomeKeys, DomeKeys]:
        """Keys of the lower dome, and of the upper one."""
        near = self.contact_radius
        return (
            {**self.lower_cell_keys(), "radius": self._lower, "contact_radius": near},
            {**self.cell_keys(), "radius": self.radius, "contact_radius": near},
        )

    @property
    def _lower(self) -> float:
        return self.radius if self.lower_radius is None else self.lower_radius


UPSIDE_DOWN = ((1.0, 0.0), (0.0, -1.0))


@dataclass(frozen=True, kw_only=True)
class Cylinders(Domes):
    """Two cylinders cut by a plane; in axisymmetric models two balls."""

    models: ClassVar[tuple[Model, ...]] = (*PLANE, "axisymmetric")

    symmetric: Annotated[bool, Key("-", SYMMETRIC)] = False
    builder: Annotated[Literal["cylinders"], Key("-", "the shape's name")] = "cylinders"

    def parts(self) -> Mapping[str, Part]:
        lower, upper = (HalfDisc(symmetric=self.symmetric, **keys) for keys in self.keys_of_both())
        return {
            "lower": Part(shape=lower, renamed={"top": "base"}, turn=UPSIDE_DOWN),
            "upper": Part(shape=upper, shift=(0.0, self.gap)),
        }


HALF_TURN = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))  # about the line x = y: a quarter stays in x, y >= 0


@dataclass(frozen=True, kw_only=True)
class Spheres(Domes):
    """Two balls cut by a plane, or the quarter of both; 3D only."""

    models: ClassVar[tuple[Model, ...]] = ("3d",)

    symmetry: Annotated[Literal["none", "quarter"], Key("-", SYMMETRY)] = "none"
    builder: Annotated[Literal["spheres"], Key("-", "the shape's name")] = "spheres"

    def parts(self) -> Mapping[str, Part]:
        lower, upper = (HalfBall(symmetry=self.symmetry, **keys) for keys in self.keys_of_both())
        swapped = {"top": "base", "x_plane": "y_plane", "y_plane": "x_plane"}
        return {
            "lower": Part(shape=lower, renamed=swapped, turn=HALF_TURN),
            "upper": Part(shape=upper, shift=(0.0, self.gap)),
        }
