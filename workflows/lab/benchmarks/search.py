"""CPU time of the contact search on one thread: `python -m stickslip.workflows.lab.benchmarks.search` prints it.

Two wavy surfaces in the shape of a body's side, the points off the nodes, most of them open, some overlapping.
"""

from __future__ import annotations

import os
from time import process_time

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array
from stickslip.geometry.surfaces.search import pair
from stickslip.geometry.surfaces.surface import Surface
from stickslip.workflows.cost.measure import ONE_THREAD

os.environ.update(ONE_THREAD)  # before the first operation that would start them

FACETS = 100_000
POINTS = 100_000
WAVE = 0.05  # [m] height of the master's waves, on a side of 1 m


def height(x: Array) -> Array:
    """Height of the master over points (m, d-1) [m]."""
    return np.asarray(WAVE * np.cos(4 * np.pi * x).prod(axis=1))


def master(shape: str, degree: int, facets: int) -> Surface:
    """A graph over the unit interval or square, outward normal up."""
    dim = {"interval": 1, "triangle": 2, "quadrilateral": 2}[shape]
    corners = np.array([[0.0]]) if dim == 1 else np.array([[0.0, 0.0]])
    turns = np.array([np.eye(dim)])
    if shape == "triangle":
        corners, turns = np.array([[0.0, 0.0], [1.0, 1.0]]), np.array([np.eye(2), -np.eye(2)])
    cells = round((facets / len(corners)) ** (1 / dim))
    grid = np.stack(np.meshgrid(*[np.arange(cells)] * dim, indexing="ij"), axis=-1).reshape(-1, 1, 1, dim)
    at = grid + corners[:, None] + dx.reference_nodes(shape, degree) @ turns  # (cells, corners, k, dim)
    at = np.rint(degree * at).astype(np.int64).reshape(-1, dim)
    nodes, rows = np.unique(at, axis=0, return_inverse=True)
    x = nodes / (degree * cells)
    number = np.arange(len(nodes))
    table = rows.reshape(len(grid) * len(corners), -1)
    return Surface(
        shape=shape,
        degree=degree,
        nodes=number,
        input=number,
        points=np.column_stack([x, height(x)]),
        facets=table,
        outward=np.full(len(table), -1.0 if dim == 1 else 1.0),
        axisymmetric=False,
    )


def slave(dim: int, gap: float) -> tuple[Array, Array]:
    """Points from -`gap` to 3 `gap` [m] above the master, and search directions down, tilted at random."""
    random = np.random.default_rng(1)
    x = random.random((POINTS, dim - 1))
    points = np.column_stack([x, height(x) + gap * (1 + 2 * np.sin(7 * x[:, 0]))])
    directions = np.column_stack([0.5 * (random.random((POINTS, dim - 1)) - 0.5), -np.ones(POINTS)])
    return points, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def main() -> None:
    print(f"{'surface':24} {'points':>8} {'facets':>8} {'gap [m]':>8} {'reach [m]':>9} {'met':>8} {'CPU s':>8}")
    for shape, degree in [(s, k) for k in (1, 2) for s in ("interval", "triangle", "quadrilateral")]:
        surface = master(shape, degree, FACETS)
        for gap, reach in ((1e-4, 1.0), (0.1, 1.0)):
            points, directions = slave(surface.dim, gap)
            start = process_time()
            found = pair(points, directions, surface, reach)
            seconds = process_time() - start
            met = np.count_nonzero(found.facet >= 0)
            name = f"{surface.dim}D {shape} P{degree}"
            print(
                f"{name:24} {POINTS:8} {len(surface.facets):8} {gap:8g} {reach:9g} {met:8} {seconds:8.2f}", flush=True
            )


if __name__ == "__main__":
    main()
