"""Surfaces without bodies, to be laid over each other: grids and random triangulations, flat or bent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array
from stickslip.geometry.surfaces.surface import Surface

Ints = NDArray[np.int64]
Shape = Callable[[Array], Array]
UNIT = ((0.0, 0.0), (1.0, 1.0))


def surface(shape: str, degree: int, points: Array, facets: Ints, bend: Shape, outward: float) -> Surface:
    """Straight facets (f, k) of plane points (p, d-1), given their midnodes, then bent into space."""
    local = dx.reference_nodes(shape, degree)
    places = dx.reference_basis(shape, 1, local)[0] @ points[facets]
    f, k, d = places.shape
    scale = np.ptp(points, axis=0).max()
    _, first, rows = np.unique(
        np.round(places.reshape(-1, d) / scale, 9), axis=0, return_index=True, return_inverse=True
    )
    nodes = bend(places.reshape(-1, d)[first])
    numbers = np.arange(len(nodes))
    turned = np.full(f, outward)
    return Surface(shape, degree, numbers, numbers, nodes, rows.reshape(f, k), turned, False)


def grid(shape: str, degree: int, counts: tuple[int, int], box: Any, bend: Shape, outward: float) -> Surface:
    """`counts` cells over a box ((x, y), (x, y)); two triangles a cell if that is the shape."""
    counts = counts[:1] if shape == "interval" else counts
    axes = [np.linspace(low, high, n + 1) for low, high, n in zip(*box, counts, strict=False)]
    points = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
    if shape == "interval":
        return surface(
            shape, degree, points, np.stack([np.arange(counts[0]), np.arange(1, counts[0] + 1)], 1), bend, outward
        )
    number = np.arange(len(points)).reshape(counts[0] + 1, counts[1] + 1)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]))
    if shape == "quadrilateral":
        return surface(shape, degree, points, np.stack([a, b, c, d], axis=1), bend, outward)
    return surface(
        shape, degree, points, np.concatenate([np.stack([a, b, d], 1), np.stack([a, d, c], 1)]), bend, outward
    )


def scattered(degree: int, count: int, seed: int, bend: Shape, outward: float) -> Surface:
    """Delaunay triangles of random points of the unit square, its corners and points of its edges included."""
    rng = np.random.default_rng(seed)
    side = np.linspace(0, 1, int(np.sqrt(count)) + 1)
    low, high = np.zeros_like(side), np.ones_like(side)
    edges = np.concatenate([np.stack(pair, 1) for pair in ((side, low), (side, high), (low, side), (high, side))])
    points = np.unique(np.concatenate([edges, rng.random((count, 2))]), axis=0)
    facets = Delaunay(points).simplices.astype(np.int64)
    arms = points[facets[:, 1:]] - points[facets[:, :1]]
    facets = facets[np.abs(np.linalg.det(arms)) > 1e-12]
    turned = np.linalg.det(points[facets[:, 1:]] - points[facets[:, :1]]) < 0
    facets[turned] = facets[turned][:, [0, 2, 1]]
    return surface("triangle", degree, points, facets, bend, outward)


def flat(height: float) -> Shape:
    """The plane at a height."""
    return lambda x: np.concatenate([x, np.full((len(x), 1), height)], axis=1)


LOW, HIGH = flat(0.0), flat(0.1)


def ball(radius: float) -> Shape:
    """The part of a circle or a sphere that is seen under the unit interval or square at distance 1."""

    def bend(x: Array) -> Array:
        towards = np.concatenate([x - 0.5, np.ones((len(x), 1))], axis=1)
        return np.asarray(radius * towards / np.linalg.norm(towards, axis=1, keepdims=True))

    return bend


def below(shape: str, degree: int, counts: tuple[int, int], bend: Shape = LOW, box: Any = UNIT) -> Surface:
    """A grid whose outward normals point up."""
    return grid(shape, degree, counts, box, bend, -1.0 if shape == "interval" else 1.0)


def above(shape: str, degree: int, counts: tuple[int, int], bend: Shape = HIGH, box: Any = UNIT) -> Surface:
    """A grid whose outward normals point down."""
    return grid(shape, degree, counts, box, bend, 1.0 if shape == "interval" else -1.0)


def both(one: Surface, other: Surface) -> Surface:
    """Two surfaces as one."""
    n = len(one.points)
    numbers = np.arange(n + len(other.points))
    points = np.concatenate([one.points, other.points])
    facets = np.concatenate([one.facets, other.facets + n])
    outward = np.concatenate([one.outward, other.outward])
    return replace(one, nodes=numbers, input=numbers, points=points, facets=facets, outward=outward)


def shaken(of: Surface, size: float, seed: int = 0) -> Surface:
    """A grid over the unit square with its inner nodes moved in its plane, by up to half of `size`."""
    points = of.points.copy()
    inside = ((points[:, :2] > 1e-9) & (points[:, :2] < 1 - 1e-9)).all(axis=1)
    points[inside, :2] += size * (np.random.default_rng(seed).random((inside.sum(), 2)) - 0.5)
    return replace(of, points=points)
