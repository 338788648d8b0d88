"""Surfaces without bodies, to be laid over each other: grids and random triangulations, flat or bent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from geometry import dolfinx_versions as dx
from geometry.surface import Surface

Array = NDArray[np.float64]
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


def grid(shape: str, degree: int, counts: tuple[int, ...], box: Any, bend: Shape, outward: float) -> Surface:
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
    return lambda x: np.concatenate([x, np.full((len(x), 1), height)], axis=1)


def moved(of: Surface, points: Array) -> Surface:
    return replace(of, points=points)
