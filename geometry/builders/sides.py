"""Sides of a shape in the gmsh model: found where they are flat, named, matched in pairs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np

from geometry.arrays import Array
from geometry.errors import GeometryError, require
from geometry.shape import Model

Flat = tuple[int, float]  # axis of the normal, position along it
SYMMETRIC = "true: the half x >= 0 only, with a side `axis`; axisymmetric models need it"


def check_symmetric(symmetric: bool, model: Model) -> None:
    """Refuse a whole where the model has half of it, and half of it where there is a whole only."""
    expected = "expected true in an axisymmetric model, which lies in x >= 0"
    require(model != "axisymmetric" or symmetric, "symmetric", "false", expected)
    require(model != "3d" or not symmetric, "symmetric", "true", "there is the whole shape only in 3D")


def of_box(dim: int) -> dict[str, tuple[int, int]]:
    """Side -> (axis of its normal, 0 for the lower and 1 for the upper end)."""
    middle = {"front": (1, 0), "back": (1, 1)} if dim == 3 else {}
    return {"left": (0, 0), "right": (0, 1)} | middle | {"bottom": (dim - 1, 0), "top": (dim - 1, 1)}


def box_corners(box: Array, axis: int, end: int) -> tuple[Array, Array]:
    """Corners (k, d) of one side of a box (2, d), and the outward normals there."""
    dim = box.shape[1]
    ends = np.array(list(product((0, 1), repeat=dim)))
    ends = ends[ends[:, axis] == end]
    return box[ends, np.arange(dim)], constant_normals(axis, end, ends.shape)


def constant_normals(axis: int, end: int, shape: tuple[int, ...]) -> Array:
    """Outward normals (k, d) of a flat side."""
    return np.tile(np.eye(shape[1])[axis] * (2 * end - 1), (shape[0], 1))


def lies_in(gmsh: Any, dim: int, tag: int, flat: Flat) -> bool:
    """Whether a curve (dim = 1) or surface (dim = 2) lies in a plane across one of the axes."""
    low, high = np.reshape(gmsh.model.getBoundingBox(dim, tag), (2, 3))[:, flat[0]]
    slack = 1e-6 * (1 + abs(flat[1]))  # gmsh widens bounding boxes by 1e-7
    return bool(abs(low - flat[1]) < slack and abs(high - flat[1]) < slack)


def outer(gmsh: Any, dim: int, flat: Mapping[str, Flat], rest: str | None = None) -> dict[str, list[int]]:
    """Side -> tags of its curves (dim = 2) or surfaces (dim = 3); what lies in no plane of `flat` is the `rest`."""
    found: dict[str, list[int]] = {name: [] for name in (*flat, *([rest] if rest else []))}
    for _, tag in gmsh.model.getBoundary(gmsh.model.getEntities(dim), combined=True, oriented=False):
        name = next((name for name, plane in flat.items() if lies_in(gmsh, dim - 1, tag, plane)), rest)
        if name is not None:
            found[name].append(int(tag))
    for name, tags in found.items():
        if not tags:
            raise GeometryError(f"geometry: gmsh made no side {name}")
    return found


def name_groups(gmsh: Any, dim: int, body: str, sides: Mapping[str, Sequence[int]]) -> None:
    """All cells are one body; its sides are called body.side."""
    gmsh.model.addPhysicalGroup(dim, [tag for _, tag in gmsh.model.getEntities(dim)], tag=1)
    gmsh.model.setPhysicalName(dim, 1, body)
    for group, (name, tags) in enumerate(sides.items(), start=1):
        gmsh.model.addPhysicalGroup(dim - 1, list(tags), tag=group)
        gmsh.model.setPhysicalName(dim - 1, group, f"{body}.{name}")


def match(
    gmsh: Any,
    dim: int,
    pairs: Sequence[tuple[str, str]],
    tags: Mapping[str, Sequence[int]],
    places: Mapping[str, tuple[int, int]],
    box: Array,
) -> None:
    """Make the mesh of each pair's first side, as body.side, that of the second, moved across the box."""
    for slave, master in (tuple(side.split(".")[1] for side in pair) for pair in pairs):
        (axis, to), (_, origin) = places[slave], places[master]
        affine = np.eye(4)
        affine[axis, 3] = (to - origin) * np.ptp(box[:, axis])
        gmsh.model.mesh.setPeriodic(dim - 1, list(tags[slave]), list(tags[master]), list(affine.ravel()))
