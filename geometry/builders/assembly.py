"""Bases of the shapes of several bodies: each body is a builder, meshed alone and put in its place; no shared nodes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Literal, Self, TypedDict

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.geometry.builders.builder import Builder, Sides
from stickslip.geometry.errors import SceneError, require
from stickslip.geometry.keys import Key
from stickslip.geometry.mesh.mesh import mesh_shape
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.shape import SKIN, Model, Request, dimensions
from stickslip.geometry.user_files.parts import Parts, find_parts
from stickslip.geometry.user_files.raw_mesh import RawMesh, read_raw_mesh

MOST_BODIES = 1000
Turn = Sequence[Sequence[float]]  # orthogonal matrix (d, d)


class CellKeys(TypedDict):
    """The mesh keys, which all builders have."""

    mesh_size: float
    contact_mesh_size: float | None
    cells: Literal["simplex", "tensor"]
    order: Literal[1, 2]


@dataclass(frozen=True, kw_only=True)
class Part:
    """One body of an assembly: a shape, turned about the origin (or mirrored) and then moved."""

    shape: Builder
    renamed: Mapping[str, str] = field(default_factory=dict)  # side of the shape -> its name in the assembly
    turn: Turn | None = None
    shift: tuple[float, float] = (0.0, 0.0)  # along x and along the last axis [m]

    def sides(self, dim: int) -> Sides:
        """Sides by their names in the assembly, in place."""
        ((body, names),) = self.shape.bodies(dim).items()
        samples = {name: self.shape.sample(f"{body}.{name}", dim) for name in names}
        return {self.renamed.get(n, n): (self.placed(x), self._turned(normal)) for n, (x, normal) in samples.items()}

    def placed(self, points: Array) -> Array:
        """Points (k, d) of the shape where the assembly has them [m]."""
        return self._turned(points) + self._shift(points.shape[1])

    def in_place(self, points: Array) -> Array:
        """Points (k, d) of the assembly where the shape has them [m]: the inverse of `placed`."""
        moved = points - self._shift(points.shape[1])
        return moved if self.turn is None else moved @ np.linalg.inv(np.asarray(self.turn, np.float64).T)

    def _shift(self, dim: int) -> Array:
        x, last = self.shift
        return np.array([x, *[0.0] * (dim - 2), last])

    def mesh(self, gmsh: Gmsh, name: str, request: Request) -> RawMesh:
        """Mesh of the body `name` in metres, made in a separate gmsh model."""
        dim, own = request.dim, self._own(name, request.dim)
        with _separate_model(gmsh):
            unit = mesh_shape(gmsh, self.shape, self.request(name, request))
            found = find_parts(gmsh, dim, False, {}, unit)
            (cells,) = found.bodies.values()
            mesh = read_raw_mesh(gmsh, dim, Parts({name: cells}, {here: found.sides[own[here]] for here in own}))
        points = np.zeros_like(mesh.points)
        points[:, :dim] = self.placed(unit * mesh.points[:, :dim])
        return replace(mesh, points=points)

    def request(self, name: str, request: Request) -> Request:
        """Return the part of the request that concerns the body `name`."""
        own = self._own(name, request.dim)
        own_skin = {f"{name}.{SKIN}": f"{own[side].split('.')[0]}.{SKIN}" for side in own}
        slaves = tuple((own | own_skin)[side] for side in request.contact_sides if side in own | own_skin)
        pairs = tuple((own[a], own[b]) for a, b in request.periodic if a in own and b in own)
        turns = {own[side]: turn for side, turn in request.turns.items() if side in own}
        sizes = request.sizes and replace(request.sizes, points=self.in_place(request.sizes.points))
        return replace(request, contact_sides=slaves, periodic=pairs, turns=turns, sizes=sizes)

    def _own(self, name: str, dim: int) -> dict[str, str]:
        """Name of each side of the body `name` -> its name in the shape, both as body.side."""
        ((body, sides),) = self.shape.bodies(dim).items()
        return {f"{name}.{self.renamed.get(side, side)}": f"{body}.{side}" for side in sides}

    def _turned(self, vectors: Array) -> Array:
        return vectors if self.turn is None else vectors @ np.asarray(self.turn, np.float64).T


@dataclass(frozen=True, kw_only=True)
class Assembly(Builder):
    """Base of the shapes of several bodies; each defines its `parts`."""

    distances: ClassVar[tuple[str, ...]] = ()  # keys in metres of any sign

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_keys()
        self.parts()  # the constructors of the parts check their keys

    def check_keys(self) -> None:
        """Raise SceneError for wrong keys which the parts would report under names of their own."""

    def parts(self) -> Mapping[str, Part]:
        """Name -> body."""
        raise NotImplementedError

    def sides_by_body(self, dim: int) -> Mapping[str, Sides]:
        return {name: part.sides(dim) for name, part in self.parts().items()}

    def check_model(self, model: Model) -> None:
        super().check_model(model)
        for name, part in self.parts().items():
            with _errors_name(name):
                part.shape.check_model(model)
        low = self.box(dimensions(model))[0, 0]
        if model == "axisymmetric" and low < 0:
            raise SceneError(f"geometry: reaches x = {low:g}; an axisymmetric model lies in x >= 0")

    def cell_count(self, request: Request) -> float:
        return sum(part.shape.cell_count(part.request(name, request)) for name, part in self.parts().items())

    def put(self, gmsh: Gmsh, request: Request) -> float:
        join_meshes([part.mesh(gmsh, name, request) for name, part in self.parts().items()]).put(gmsh)
        return 1.0  # the parts are in metres already

    def in_units_of(self, unit: float) -> Self:
        return replace(super().in_units_of(unit), **{key: getattr(self, key) / unit for key in self.distances})

    def cell_keys(self, mesh_size: float | None = None) -> CellKeys:
        """Mesh keys of a part; with another mesh size, `contact_mesh_size` changes in the same ratio."""
        coarse = self.mesh_size if mesh_size is None else mesh_size
        fine = None if self.contact_mesh_size is None else self.contact_mesh_size / self.mesh_size * coarse
        return {"mesh_size": coarse, "contact_mesh_size": fine, "cells": self.cells, "order": self.order}


@dataclass(frozen=True, kw_only=True)
class BodyRow(Assembly):
    """Base of the rows of bodies. Every second body may have other mesh sizes, so that neighbours do not match."""

    count: Annotated[int, Key("-", "number of blocks or stones")]
    mesh_ratio: Annotated[float, Key("-", "mesh sizes of every second body over those of the others")] = 1.0

    def check_keys(self) -> None:
        require(1 <= self.count <= MOST_BODIES, "count", self.count, f"must be between 1 and {MOST_BODIES}")
        require(self.mesh_ratio > 0, "mesh_ratio", self.mesh_ratio, "must be positive")

    def cell_keys_of(self, number: int) -> CellKeys:
        """Mesh keys of the body of this number in the row."""
        return self.cell_keys(self.mesh_size * self.mesh_ratio if number % 2 == 0 else None)


def join_meshes(meshes: Sequence[RawMesh]) -> RawMesh:
    """One mesh of several with the same kind of cell; nodes at the same place are not merged."""
    first = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    together = list(zip(meshes, first[:-1], strict=True))
    return replace(
        meshes[0],
        bulging=None,
        points=np.concatenate([mesh.points for mesh in meshes]),
        cells={name: rows + offset for mesh, offset in together for name, rows in mesh.cells.items()},
        facets={name: rows + offset for mesh, offset in together for name, rows in mesh.facets.items()},
    )


@contextmanager
def _errors_name(body: str) -> Iterator[None]:
    """Put the name of the body before the text of a SceneError."""
    try:
        yield
    except SceneError as error:
        raise SceneError(f"body {body}: {error}") from None


@contextmanager
def _separate_model(gmsh: Gmsh) -> Iterator[None]:
    """A new current gmsh model, which is removed afterwards."""
    outer = gmsh.model.getCurrent()
    gmsh.model.add("part")
    try:
        yield
    finally:
        gmsh.model.remove()
        gmsh.model.setCurrent(outer)


@dataclass(frozen=True, kw_only=True)
class Pair(Assembly):
    """Along the last axis the body `lower` ends at 0 and the body `upper` begins at `gap`."""

    lengths: ClassVar[tuple[str, ...]] = ("lower_mesh_size",)
    distances: ClassVar[tuple[str, ...]] = ("gap",)

    gap: Annotated[float, Key("m", "distance of the bodies along the last axis; negative: they overlap")] = 0.0
    lower_mesh_size: Annotated[
        float | None, Key("m", "mesh_size of the lower body, contact_mesh_size in the same ratio; absent: mesh_size")
    ] = None

    def lower_cell_keys(self) -> CellKeys:
        """Mesh keys of the lower body."""
        return self.cell_keys(self.lower_mesh_size)
