"""Base of the ready shapes, which gmsh draws and meshes; their sides are found by planes, named, and matched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import product
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np

from stickslip.geometry.arrays import CLOSE, Array
from stickslip.geometry.errors import GeometryError, SceneError, require
from stickslip.geometry.keys import Choice, Key
from stickslip.geometry.mesh_sizes import filled
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import SKIN, Model, Request, Shape

Sides = Mapping[str, tuple[Array, Array]]  # by name: sample points (k, d) [m], and unit outward normals there (k, d)
Places = Mapping[str, tuple[int, int]]  # flat sides: axis of the normal, and 0 for the lower or 1 for the upper end
ONLY_PLANE = "there is one in plane models only"
PLANE: tuple[Model, ...] = ("plane strain", "plane stress")


@dataclass(frozen=True, kw_only=True)
class Builder(Choice, Shape):
    """Keys and checks that all builders share. One of a single body describes its `sides`, and draws them."""

    tag: ClassVar[str] = "builder"
    body: ClassVar[str]
    lengths: ClassVar[tuple[str, ...]] = ()  # keys in metres that must be positive, besides the mesh sizes
    models: ClassVar[tuple[Model, ...]] = (*PLANE, "axisymmetric", "3d")
    elsewhere: ClassVar[str] = ""  # what is said in other models
    gridded: ClassVar[bool] = True  # whether cells may be quadrilaterals and hexahedra

    mesh_size: Annotated[float, Key("m", "edge length of the cells")]
    contact_mesh_size: Annotated[float | None, Key("m", "edge length at contact surfaces; absent: mesh_size")] = None
    cells: Annotated[Literal["simplex", "tensor"], Key("-", "triangles and tetrahedra, or quads and hexahedra")] = (
        "simplex"
    )
    order: Annotated[Literal[1, 2], Key("-", "polynomial degree of displacement and geometry")] = 1

    def __post_init__(self) -> None:
        for key in self._all_lengths():
            value = getattr(self, key)
            require(value is None or value > 0, key, value, "must be positive, in metres")
        fine = self.contact_mesh_size
        require(fine is None or fine <= self.mesh_size, "contact_mesh_size", fine, "must not exceed mesh_size")

    def sides(self, dim: int) -> Sides:
        """Every side of a single body, see `Shape.sample`; their names and the box of the shape are those of these."""
        raise NotImplementedError

    def sides_by_body(self, dim: int) -> Mapping[str, Sides]:
        """Every side of every body; asked for once."""
        return {self.body: self.sides(dim)}

    @cached_property
    def _by_dimension(self) -> dict[int, Mapping[str, Sides]]:
        return {}

    def _described(self, dim: int) -> Mapping[str, Sides]:
        if dim not in self._by_dimension:
            self._by_dimension[dim] = self.sides_by_body(dim)
        return self._by_dimension[dim]

    def bodies(self, dim: int) -> Mapping[str, tuple[str, ...]]:
        return {body: tuple(sides) for body, sides in self._described(dim).items()}

    def box(self, dim: int) -> Array:
        points = np.concatenate([x for sides in self._described(dim).values() for x, _ in sides.values()])
        return np.array([points.min(axis=0), points.max(axis=0)])

    def sample(self, side: str, dim: int) -> tuple[Array, Array]:
        body, name = side.split(".")
        return self.skin(body, dim) if name == SKIN else self._described(dim)[body][name]

    def check_model(self, model: Model) -> None:
        if model not in self.models:
            said = self.elsewhere or f"made for model = {' or '.join(map(repr, self.models))} only"
            raise SceneError(f'builder = "{getattr(self, self.tag)}": {said}')
        require(self.gridded or self.cells == "simplex", "cells", self.cells, "this shape has no grid; use simplex")

    def check_symmetric(self, symmetric: bool, model: Model) -> None:
        """Raise SceneError for `symmetric = false` in an axisymmetric model, and for `symmetric = true` in 3D."""
        expected = "expected true in an axisymmetric model, which lies in x >= 0"
        require(model != "axisymmetric" or symmetric, "symmetric", "false", expected)
        require(model != "3d" or not symmetric, "symmetric", "true", "there is the whole shape only in 3D")

    @property
    def degree(self) -> int:
        return self.order

    @property
    def fine_size(self) -> float:
        """Edge length at contact surfaces [m]."""
        return self.mesh_size if self.contact_mesh_size is None else self.contact_mesh_size

    def pieces(self, dim: int) -> int:
        """Cells that a quadrilateral or hexahedron of a grid is cut into."""
        return 1 if self.cells == "tensor" else {2: 2, 3: 6}[dim]

    def in_units_of(self, unit: float) -> Self:
        """The same shape with all lengths divided by `unit` [m]: a scene in m and one in mm give the same mesh."""
        found = {key: getattr(self, key) for key in self._all_lengths()}
        return replace(self, **{key: value / unit for key, value in found.items() if value is not None})

    def refined(self, factor: float) -> Self:
        sizes = {f.name: getattr(self, f.name) for f in fields(self) if f.name.endswith("mesh_size")}
        return replace(self, **{key: factor * size for key, size in sizes.items() if size is not None})

    def put(self, gmsh: Gmsh, request: Request) -> float:
        unit = float(np.max(np.ptp(self.box(request.dim), axis=0)))  # the tolerances of gmsh are absolute
        self.in_units_of(unit).draw(gmsh, request)
        if request.sizes is not None:
            request.sizes.in_units_of(unit).impose(gmsh)
        gmsh.model.mesh.generate(request.dim)
        return unit

    def cell_count(self, request: Request) -> float:
        """As if the shape filled its box, and had one size of cells; a shape that does not says so itself."""
        return filled(float(np.prod(np.ptp(self.box(request.dim), axis=0))), self.mesh_size, request.dim)

    def draw(self, gmsh: Gmsh, request: Request) -> None:
        """Put the shape, its mesh sizes and its named physical groups into the current gmsh model."""
        raise NotImplementedError

    def touched(self, request: Request) -> set[str]:
        """Names of the sides of a single body that are to be fine."""
        named = {side.split(".")[1] for side in request.contact_sides}
        return {*self.bodies(request.dim)[self.body]} if SKIN in named else named

    def outer(self, gmsh: Gmsh, dim: int, places: Places, rest: str | None = None) -> dict[str, list[int]]:
        """Find the boundary curves (2D) or surfaces (3D) of each side.

        Args:
            places: of the flat sides, which lie in the faces of the box.
            rest: name of the side that all other boundary entities make up; None: they belong to no side.

        Returns:
            Tags of the entities of each side.

        Raises:
            GeometryError: a side has no entity.
        """
        box, found = self.box(dim), {name: list[int]() for name in (*places, *([rest] if rest else []))}
        for _, tag in gmsh.model.getBoundary(gmsh.model.getEntities(dim), combined=True, oriented=False):
            reach = np.reshape(gmsh.model.getBoundingBox(dim - 1, tag), (2, 3))
            for name, (axis, end) in places.items():
                at = box[end, axis]
                if np.all(np.abs(reach[:, axis] - at) < CLOSE * (1 + abs(at))):  # gmsh enlarges bounding boxes by 1e-7
                    found[name].append(int(tag))
                    break
            else:
                if rest is not None:
                    found[rest].append(int(tag))
        for name, tags in found.items():
            if not tags:
                raise GeometryError(
                    f"geometry: gmsh made no side {name}: a length is nothing beside the others, or beside 1"
                )
        return found

    def name_groups(self, gmsh: Gmsh, dim: int, sides: Mapping[str, Sequence[int]]) -> None:
        """Make all cells one body, and name its sides body.side; `sides` has the tags of each."""
        gmsh.model.addPhysicalGroup(dim, [tag for _, tag in gmsh.model.getEntities(dim)], tag=1)
        gmsh.model.setPhysicalName(dim, 1, self.body)
        for group, (name, tags) in enumerate(sides.items(), start=1):
            gmsh.model.addPhysicalGroup(dim - 1, list(tags), tag=group)
            gmsh.model.setPhysicalName(dim - 1, group, f"{self.body}.{name}")

    def match_periodic(self, gmsh: Gmsh, request: Request, places: Places, tags: Mapping[str, Sequence[int]]) -> None:
        """Give periodic sides matching meshes: the first of each pair gets that of the second, moved across the box.

        Args:
            places: as for `outer`.
            tags: gmsh entities of each side.
        """
        for slave, master in (tuple(side.split(".")[1] for side in pair) for pair in request.periodic):
            require(not request.turns, "periodic", "an angle", "this shape is no sector; see rings with angle = 90")
            (axis, to), (_, origin) = places[slave], places[master]
            affine = np.eye(4)
            affine[axis, 3] = (to - origin) * np.ptp(self.box(request.dim)[:, axis])
            tags_of = list(tags[slave]), list(tags[master])
            gmsh.model.mesh.setPeriodic(request.dim - 1, *tags_of, list(affine.ravel()))

    def _all_lengths(self) -> tuple[str, ...]:
        return (*self.lengths, "mesh_size", "contact_mesh_size")


SYMMETRIC = "true: the half x >= 0 only, with a side `axis`; axisymmetric models need it"


def modelled(geometry: Mapping[str, Any], model: str) -> str:
    """Return the part of the shape that is modelled, by the keys of [geometry]: half, quarter; empty: all.

    Resultants of an axisymmetric model are those of the full circle.

    >>> [modelled(keys, "plane strain") for keys in ({"symmetric": True}, {"symmetry": "quarter"}, {})]
    ['half', 'quarter', '']
    """
    if model == "axisymmetric" or geometry.get("symmetry") == "none":
        return ""
    return "half" if geometry.get("symmetric") else str(geometry.get("symmetry", ""))


def directions(angles: Array) -> Array:
    """Unit vectors (k, 2) at angles (k,) from the x axis, in degrees.

    >>> directions(np.array([0.0, 90.0])).round(15) + 0.0
    array([[1., 0.],
           [0., 1.]])
    """
    return np.stack([np.cos(np.radians(angles)), np.sin(np.radians(angles))], axis=1)


def of_box(dim: int) -> Places:
    """Sides of a rectangle or box."""
    middle = {"front": (1, 0), "back": (1, 1)} if dim == 3 else {}
    return {"left": (0, 0), "right": (0, 1)} | middle | {"bottom": (dim - 1, 0), "top": (dim - 1, 1)}


def box_corners(box: Array, axis: int, end: int) -> tuple[Array, Array]:
    """Corners (k, d) of one side of a box (2, d), and the unit outward normals there (k, d)."""
    dim = box.shape[1]
    ends = np.array(list(product((0, 1), repeat=dim)))
    ends = ends[ends[:, axis] == end]
    return flat_side(box[ends, np.arange(dim)], axis, end)


def flat_side(points: Array, axis: int, end: int) -> tuple[Array, Array]:
    """Points (k, d) of a flat side across an axis, and its unit outward normals there; end: 0 lower, 1 upper."""
    return points, np.tile(np.eye(points.shape[1])[axis] * (2 * end - 1), (len(points), 1))
