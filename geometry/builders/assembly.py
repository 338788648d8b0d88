"""Several bodies in one mesh: each is a shape of its own, meshed alone and put in its place; they share no node."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

import numpy as np

from geometry.arrays import Array
from geometry.builders.builder import Builder
from geometry.errors import SceneError
from geometry.mesh.mesh import mesh_shape
from geometry.shape import Model, Request
from geometry.user_files.parts import Parts, find_parts
from geometry.user_files.raw_mesh import RawMesh, read_raw_mesh

Turn = Sequence[Sequence[float]]  # orthogonal matrix of as many rows as the model has dimensions


@dataclass(frozen=True, kw_only=True)
class Part:
    """A shape, turned about the origin (or mirrored) and then moved: one body of an assembly."""

    shape: Builder
    renamed: Mapping[str, str] = field(default_factory=dict)  # sides of the shape that are called otherwise here
    turn: Turn | None = None
    shift: tuple[float, float] = (0.0, 0.0)  # along x and along the last axis [m]

    def sides(self, dim: int) -> dict[str, str]:
        """Name here -> name in the shape, as body.side."""
        ((body, sides),) = self.shape.bodies(dim).items()
        return {self.renamed.get(side, side): f"{body}.{side}" for side in sides}

    def sample(self, side: str, dim: int) -> tuple[Array, Array]:
        """What the shape answers, in its place."""
        points, normals = self.shape.sample(self.sides(dim)[side], dim)
        return self.placed(points), self._turned(normals)

    def placed(self, points: Array) -> Array:
        """Points (k, d) of the shape, in their place."""
        x, last = self.shift
        shift: Array = np.array([x, *[0.0] * (points.shape[1] - 2), last])
        return self._turned(points) + shift

    def mesh(self, gmsh: Any, name: str, request: Request) -> RawMesh:
        """The body `name`, meshed in a gmsh model of its own; in metres."""
        sides, dim = self.sides(request.dim), request.dim
        own = {f"{name}.{side}": there for side, there in sides.items()}
        slaves = tuple(own[side] for side in request.contact_sides if side in own)
        pairs = tuple((own[a], own[b]) for a, b in request.periodic if a in own and b in own)
        with _model_of_its_own(gmsh):
            unit = mesh_shape(gmsh, self.shape, replace(request, contact_sides=slaves, periodic=pairs))
            found = find_parts(gmsh, dim, False, {}, unit)
            (cells,) = found.bodies.values()
            mesh = read_raw_mesh(gmsh, dim, Parts({name: cells}, {here: found.sides[own[here]] for here in own}))
        points = np.zeros_like(mesh.points)
        points[:, :dim] = self.placed(unit * mesh.points[:, :dim])
        return replace(mesh, points=points)

    def _turned(self, vectors: Array) -> Array:
        return vectors if self.turn is None else vectors @ np.asarray(self.turn, np.float64).T


@dataclass(frozen=True, kw_only=True)
class Assembly(Builder):
    """What shapes of several bodies share; each says its `parts`, and what distances may be of any sign."""

    models: ClassVar[tuple[Model, ...]] = ("plane strain", "plane stress", "axisymmetric", "3d")
    distances: ClassVar[tuple[str, ...]] = ()  # parameters in metres of any sign

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_keys()
        self.parts()  # each refuses what it cannot be

    def check_keys(self) -> None:
        """Refuse what the parts would blame on keys of their own."""

    def parts(self) -> Mapping[str, Part]:
        """Bodies by name."""
        raise NotImplementedError

    def bodies(self, dim: int) -> Mapping[str, tuple[str, ...]]:
        return {name: tuple(part.sides(dim)) for name, part in self.parts().items()}

    def check_model(self, model: Model) -> None:
        if model not in self.models:
            name = getattr(self, self.tag)
            raise SceneError(f'builder = "{name}": made for model = {" or ".join(map(repr, self.models))} only')
        for name, part in self.parts().items():
            with _about(name):
                part.shape.check_model(model)
        low = self.box(3 if model == "3d" else 2)[0, 0]
        if model == "axisymmetric" and low < 0:
            raise SceneError(f"geometry: reaches x = {low:g} m; an axisymmetric model lies in x >= 0")

    def box(self, dim: int) -> Array:
        points = [part.sample(side, dim)[0] for part in self.parts().values() for side in part.sides(dim)]
        return np.array([np.min(np.concatenate(points), axis=0), np.max(np.concatenate(points), axis=0)])

    def sample(self, side: str, dim: int) -> tuple[Array, Array]:
        body, name = side.split(".")
        return self.parts()[body].sample(name, dim)

    def put(self, gmsh: Any, request: Request) -> float:
        joined([part.mesh(gmsh, name, request) for name, part in self.parts().items()]).put(gmsh)
        return 1.0  # the parts are in metres already

    def in_units_of(self, unit: float) -> Self:
        return replace(super().in_units_of(unit), **{key: getattr(self, key) / unit for key in self.distances})

    def cell_keys(self, mesh_size: float | None = None) -> dict[str, Any]:
        """The keys that all builders have, for one part; `contact_mesh_size` keeps its ratio to another mesh size."""
        coarse = self.mesh_size if mesh_size is None else mesh_size
        fine = None if self.contact_mesh_size is None else self.contact_mesh_size / self.mesh_size * coarse
        return {"mesh_size": coarse, "contact_mesh_size": fine, "cells": self.cells, "order": self.order}


def joined(meshes: Sequence[RawMesh]) -> RawMesh:
    """One mesh of meshes of the same kind of cell; nodes in the same place stay apart."""
    first = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    together = list(zip(meshes, first[:-1], strict=True))
    return replace(
        meshes[0],
        points=np.concatenate([mesh.points for mesh in meshes]),
        cells={name: rows + offset for mesh, offset in together for name, rows in mesh.cells.items()},
        facets={name: rows + offset for mesh, offset in together for name, rows in mesh.facets.items()},
    )


@contextmanager
def _about(body: str) -> Iterator[None]:
    """Errors of a part begin with its body."""
    try:
        yield
    except SceneError as error:
        raise SceneError(f"body {body}: {error}") from None


@contextmanager
def _model_of_its_own(gmsh: Any) -> Iterator[None]:
    """Another current gmsh model for a while."""
    outer = gmsh.model.getCurrent()
    gmsh.model.add("part")
    try:
        yield
    finally:
        gmsh.model.remove()
        gmsh.model.setCurrent(outer)
