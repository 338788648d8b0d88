"""Half discs and half balls, alone or two that face each other: cells grow with the distance from the pole."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.builders.assembly import Domes, Part
from stickslip.geometry.builders.builder import (
    SYMMETRIC,
    Builder,
    box_corners,
    check_symmetric,
    constant_normals,
    name_groups,
    outer,
)
from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.keys import Key
from stickslip.geometry.mesh_sizes import SIMPLICES, beyond, cells_around, grow, norm
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import Model, Request


@dataclass(frozen=True, kw_only=True)
class Dome(Builder):
    """A round body, cut by a plane, that stands on its pole."""

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

    def check_model(self, model: Model) -> None:
        require(self.cells == "simplex", "cells", self.cells, "this shape has no grid; use simplex")

    def cell_count(self, request: Request) -> float:
        dim = request.dim
        half = cells_around(dim, self.fine_size, self.near, self.mesh_size, self.radius)
        return SIMPLICES[dim] * half * self.share(dim)

    def share(self, dim: int) -> float:
        """How much of the half disc or ball there is: box of the body over that of the whole."""
        return float(np.prod(np.ptp(self.box(dim), axis=0)[:-1])) / (2 * self.radius) ** (dim - 1)

    def size_cells(self, gmsh: Gmsh) -> None:
        """Set the mesh sizes of the current gmsh model."""
        grow(gmsh, self.mesh_size, [(self.fine_size, beyond(self.near, norm("x", "y", "z")))])


@dataclass(frozen=True, kw_only=True)
class HalfDisc(Dome):
    """Half a disc with its pole at the origin and its flat side at y = radius; if axisymmetric, half a ball."""

    symmetric: Annotated[bool, Key("-", SYMMETRIC)] = False
    builder: Annotated[Literal["half_disc"], Key("-", "the shape's name")] = "half_disc"

    def bodies(self, dim: int) -> Mapping[str, tuple[str, ...]]:
        return {"disc": ("arc", "top", *(("axis",) if self.symmetric else ()))}

    def check_model(self, model: Model) -> None:
        if model == "3d":
            raise SceneError('builder = "half_disc": there is none in 3D; use "half_ball"')
        check_symmetric(self.symmetric, model)
        super().check_model(model)

    def box(self, dim: int) -> Array:
        return self.radius * np.array([[0.0 if self.symmetric else -1.0, 0.0], [1.0, 1.0]])

    def sample(self, side: str, dim: int) -> tuple[Array, Array]:
        name = side.split(".")[1]
        if name == "arc":
            angle = np.radians(np.arange(0 if self.symmetric else -90, 91, 22.5))
            normals = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
            return self.radius * (normals + np.array([0.0, 1.0])), normals
        return box_corners(self.box(dim), *((0, 0) if name == "axis" else (1, 1)))

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
        name_groups(gmsh, 2, "disc", {"arc": arcs, "top": tops} | ({"axis": axis} if axis else {}))
        self.size_cells(gmsh)


PLANES = {"x_plane": 0, "y_plane": 1}  # sides of a quarter -> axis of the normal
SYMMETRY = "quarter: x, y >= 0 only, with sides x_plane and y_plane"


@dataclass(frozen=True, kw_only=True)
class HalfBall(Dome):
    """Half a ball with its pole at the origin and its flat side on top, at z = radius; 3D only."""

    symmetry: Annotated[Literal["none", "quarter"], Key("-", SYMMETRY)] = "none"
    builder: Annotated[Literal["half_ball"], Key("-", "the shape's name")] = "half_ball"

    @property
    def quarter(self) -> bool:
        return self.symmetry == "quarter"

    def bodies(self, dim: int) -> Mapping[str, tuple[str, ...]]:
        return {"ball": ("cap", "top", *(PLANES if self.quarter else ()))}

    def check_model(self, model: Model) -> None:
        if model != "3d":
            raise SceneError('builder = "half_ball": there is one in 3D only; use "half_disc"')
        super().check_model(model)

    def box(self, dim: int) -> Array:
        low = 0.0 if self.quarter else -1.0
        return self.radius * np.array([[low, low, 0.0], [1.0, 1.0, 1.0]])

    def sample(self, side: str, dim: int) -> tuple[Array, Array]:
        name = side.split(".")[1]
        turns = np.radians(np.arange(0, 91 if self.quarter else 360, 45))
        round_z = np.stack([np.cos(turns), np.sin(turns), np.zeros(len(turns))], axis=1)
        up = np.array([0.0, 0.0, 1.0])
        if name == "cap":
            normals = np.concatenate([-up[None], round_z, (round_z - up) / np.sqrt(2)])
            return self.radius * (normals + up), normals
        if name == "top":
            points = self.radius * np.concatenate([up[None], round_z + up])
            return points, np.tile(up, (len(points), 1))
        along = np.eye(3)[1 - PLANES[name]]
        points = self.radius * np.array([0 * up, up, along + up, (along - up) / np.sqrt(2) + up])
        return points, constant_normals(PLANES[name], 0, points.shape)

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
        flat = {"top": (2, r)} | ({name: (axis, 0.0) for name, axis in PLANES.items()} if self.quarter else {})
        name_groups(gmsh, 3, "ball", outer(gmsh, 3, flat, rest="cap"))
        self.size_cells(gmsh)


UPSIDE_DOWN = ((1.0, 0.0), (0.0, -1.0))


@dataclass(frozen=True, kw_only=True)
class Cylinders(Domes):
    """Two cylinders cut by a plane; in axisymmetric models two balls."""

    models: ClassVar[tuple[Model, ...]] = ("plane strain", "plane stress", "axisymmetric")

    symmetric: Annotated[bool, Key("-", SYMMETRIC)] = False
    builder: Annotated[Literal["cylinders"], Key("-", "the shape's name")] = "cylinders"

    def parts(self) -> Mapping[str, Part]:
        lower = HalfDisc(symmetric=self.symmetric, **self.lower_keys())
        upper = HalfDisc(symmetric=self.symmetric, **self.upper_keys())
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
        lower = HalfBall(symmetry=self.symmetry, **self.lower_keys())
        upper = HalfBall(symmetry=self.symmetry, **self.upper_keys())
        swapped = {"top": "base", "x_plane": "y_plane", "y_plane": "x_plane"}
        return {
            "lower": Part(shape=lower, renamed=swapped, turn=HALF_TURN),
            "upper": Part(shape=upper, shift=(0.0, self.gap)),
        }
