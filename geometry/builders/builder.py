"""Base of the ready shapes, which gmsh draws and meshes; their sides are found by planes, named, and matched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import product
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np

from stickslip.geometry.arrays import CLOSE, Array
from stickslip.geometry.errors import GeometryError, require
from stickslip.geometry.keys import Choice, Key
from stickslip.geometry.mesh_sizes import filled
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import Model, Request, Shape


@dataclass(frozen=True, kw_only=True)
class Builder(Choice, Shape):
    """Keys and checks that all builders share. A builder lists its own lengths in `lengths`."""

    tag: ClassVar[str] = "builder"
    lengths: ClassVar[tuple[str, ...]] = ()  # keys in metres that must be positive, besides the mesh sizes

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

    def _all_lengths(self) -> tuple[str, ...]:
        return (*self.lengths, "mesh_size", "contact_mesh_size")


Flat = tuple[int, float]  # a plane across an axis: axis of the normal, position along it
SYMMETRIC = "true: the half x >= 0 only, with a side `axis`; axisymmetric models need it"


def check_symmetric(symmetric: bool, model: Model) -> None:
    """Raise SceneError for `symmetric = false` in an axisymmetric model, and for `symmetric = true` in 3D."""
    expected = "expected true in an axisymmetric model, which lies in x >= 0"
    require(model != "axisymmetric" or symmetric, "symmetric", "false", expected)
    require(model != "3d" or not symmetric, "symmetric", "true", "there is the whole shape only in 3D")


def modelled(geometry: Mapping[str, Any], model: str) -> str:
    """What a cut by symmetry leaves of the shape, by the keys of [geometry]: half, quarter, or empty if all of it.

    Resultants of an axisymmetric model are those of the full circle.

    >>> [modelled(keys, "plane strain") for keys in ({"symmetric": True}, {"symmetry": "quarter"}, {})]
    ['half', 'quarter', '']
    """
    if model == "axisymmetric" or geometry.get("symmetry") == "none":
        return ""
    return "half" if geometry.get("symmetric") else str(geometry.get("symmetry", ""))


def of_box(dim: int) -> dict[str, tuple[int, int]]:
    """Sides of a rectangle or box by name: axis of the normal, and 0 for the lower or 1 for the upper end."""
    middle = {"front": (1, 0), "back": (1, 1)} if dim == 3 else {}
    return {"left": (0, 0), "right": (0, 1)} | middle | {"bottom": (dim - 1, 0), "top": (dim - 1, 1)}


def box_corners(box: Array, axis: int, end: int) -> tuple[Array, Array]:
    """Corners (k, d) of one side of a box (2, d), and the unit outward normals there (k, d)."""
    dim = box.shape[1]
    ends = np.array(list(product((0, 1), repeat=dim)))
    ends = ends[ends[:, axis] == end]
    return box[ends, np.arange(dim)], constant_normals(axis, end, ends.shape)


def constant_normals(axis: int, end: int, shape: tuple[int, ...]) -> Array:
    """Unit outward normals (k, d) = `shape` of a flat side across `axis`; end: 0 lower, 1 upper."""
    return np.tile(np.eye(shape[1])[axis] * (2 * end - 1), (shape[0], 1))


def lies_in(gmsh: Gmsh, dim: int, tag: int, flat: Flat) -> bool:
    """Whether a curve (dim = 1) or surface (dim = 2) lies in the plane `flat`."""
    low, high = np.reshape(gmsh.model.getBoundingBox(dim, tag), (2, 3))[:, flat[0]]
    slack = CLOSE * (1 + abs(flat[1]))  # gmsh enlarges bounding boxes by 1e-7
    return bool(abs(low - flat[1]) < slack and abs(high - flat[1]) < slack)


def outer(gmsh: Gmsh, dim: int, flat: Mapping[str, Flat], rest: str | None = None) -> dict[str, list[int]]:
    """Find the boundary curves (dim = 2) or surfaces (dim = 3) of each side.

    Args:
        flat: plane of each flat side.
        rest: name of the side that all other boundary entities make up; None: they belong to no side.

    Returns:
        Tags of the entities of each side.

    Raises:
        GeometryError: a side has no entity.
    """
    found: dict[str, list[int]] = {name: [] for name in (*flat, *([rest] if rest else []))}
    for _, tag in gmsh.model.getBoundary(gmsh.model.getEntities(dim), combined=True, oriented=False):
        name = next((name for name, plane in flat.items() if lies_in(gmsh, dim - 1, tag, plane)), rest)
        if name is not None:
            found[name].append(int(tag))
    for name, tags in found.items():
        if not tags:
            raise GeometryError(f"geometry: gmsh made no side {name}")
    return found


def name_groups(gmsh: Gmsh, dim: int, body: str, sides: Mapping[str, Sequence[int]]) -> None:
    """Make all cells one body, and name its sides body.side; `sides` has the tags of each."""
    gmsh.model.addPhysicalGroup(dim, [tag for _, tag in gmsh.model.getEntities(dim)], tag=1)
    gmsh.model.setPhysicalName(dim, 1, body)
    for group, (name, tags) in enumerate(sides.items(), start=1):
        gmsh.model.addPhysicalGroup(dim - 1, list(tags), tag=group)
        gmsh.model.setPhysicalName(dim - 1, group, f"{body}.{name}")


def match_periodic(
    gmsh: Gmsh,
    dim: int,
    pairs: Sequence[tuple[str, str]],
    tags: Mapping[str, Sequence[int]],
    places: Mapping[str, tuple[int, int]],
    box: Array,
) -> None:
    """Give periodic sides matching meshes: the first of each pair gets that of the second, moved across the box.

    Args:
        pairs: sides, named body.side.
        tags: gmsh entities of each side.
        places: axis and end of each side, from `of_box`.
        box: lower and upper corner (2, d) [m].
    """
    for slave, master in (tuple(side.split(".")[1] for side in pair) for pair in pairs):
        (axis, to), (_, origin) = places[slave], places[master]
        affine = np.eye(4)
        affine[axis, 3] = (to - origin) * np.ptp(box[:, axis])
        gmsh.model.mesh.setPeriodic(dim - 1, list(tags[slave]), list(tags[master]), list(affine.ravel()))
