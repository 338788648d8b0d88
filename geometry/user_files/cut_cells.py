"""Cut triangles or tetrahedra of a user's own mesh into smaller ones, until they have given sizes; none is merged.

Marked edges are halved, the longest first, and all cells that have them with them: on a facet two cells cut alike, for
both see its edges in the same order. Together with a cell's marked edge its longest one is marked, which keeps angles.
New nodes lie in the middle of edges: curved sides stay the facets that the file has.

Source: of the longest edge M.-C. Rivara, Int. J. Numer. Methods Eng. 20 (1984).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from stickslip.geometry.arrays import Array, Bools, Ints
from stickslip.geometry.size_field import USUAL, SizeField, volumes
from stickslip.geometry.user_files.raw_mesh import RawMesh

SIMPLEX = {2: 2, 4: 3}  # gmsh's element types, and their dimension
NEAREST = 0.5  # of the power of 2 by which cutting a cell changes its size: within that it is as asked
PASSES = 60  # more than any size takes


def cut_to_sizes(mesh: RawMesh, sizes: SizeField) -> RawMesh:
    """Cut the cells that are larger than the sizes; those that are smaller stay.

    Args:
        mesh: triangles or tetrahedra of order 1.
        sizes: in the mesh's unit.
    """
    from scipy.spatial import cKDTree  # late: it loads much else

    d = SIMPLEX[mesh.kind]
    points, cells = mesh.points, np.concatenate(list(mesh.cells.values()))
    body = np.repeat(np.arange(len(mesh.cells)), [len(rows) for rows in mesh.cells.values()])
    facets = np.concatenate([np.zeros((0, d), np.int64), *mesh.facets.values()])
    side = np.repeat(np.arange(len(mesh.facets)), [len(rows) for rows in mesh.facets.values()])
    tree, wanted = cKDTree(sizes.points), np.log(sizes.sizes)
    for _ in range(PASSES):
        x = points[:, :d]
        size = (volumes(x, cells) / USUAL[d]) ** (1 / d)
        near = tree.query(x[cells].mean(axis=1), k=d + 1)[1]
        large = np.log2(size) - wanted[near].mean(axis=1) / np.log(2) > NEAREST / d
        if not large.any():
            break
        edges = _marked(points, cells, large)
        middles = len(points) + np.arange(len(edges))
        cells, body = _halved(cells, body, edges, middles)
        facets, side = _halved(facets, side, edges, middles)
        points = np.concatenate([points, points[edges].mean(axis=1)])
    return replace(
        mesh,
        points=points,
        cells={name: cells[body == k] for k, name in enumerate(mesh.cells)},
        facets={name: facets[side == k] for k, name in enumerate(mesh.facets)},
        bulging=None,
    )


def _marked(points: Array, cells: Ints, large: Bools) -> Ints:
    """Edges (e, 2) to halve, in the order in which that is done.

    They are the longest ones of large cells, and of the cells that have a marked edge.
    """
    pairs = np.array(list(combinations(range(cells.shape[1]), 2)))
    edges, number = np.unique(np.sort(cells[:, pairs], axis=2).reshape(-1, 2), axis=0, return_inverse=True)
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    order = np.argsort(-length, kind="stable")
    rank = np.empty(len(edges), np.int64)
    rank[order] = np.arange(len(edges))
    of_cells = rank[number.reshape(len(cells), -1)]
    longest, chosen = of_cells.min(axis=1), np.zeros(len(edges), bool)
    chosen[longest[large]] = True
    while not chosen[longest[more := chosen[of_cells].any(axis=1)]].all():
        chosen[longest[more]] = True
    return np.asarray(edges[order][chosen])


def _halved(simplices: Ints, owner: Ints, edges: Ints, middles: Ints) -> tuple[Ints, Ints]:
    """Simplices (s, k) with their owners (s,), cut at all edges (e, 2) that they have, the first of these first.

    Args:
        middles: (e,) new node of each edge.
    """
    span = int(middles.max()) + 1
    keys = edges[:, 0] * span + edges[:, 1]
    by_key = np.argsort(keys)
    pairs = np.array(list(combinations(range(simplices.shape[1]), 2)))
    done, owners = list[Ints](), list[Ints]()
    while len(simplices):
        ends = np.sort(simplices[:, pairs], axis=2)
        key = ends[..., 0] * span + ends[..., 1]
        place = by_key[np.minimum(np.searchsorted(keys[by_key], key), len(keys) - 1)]
        first = np.where(keys[place] == key, place, len(keys))
        local = first.argmin(axis=1)
        edge = first.min(axis=1)
        whole = edge == len(keys)
        done.append(simplices[whole])
        owners.append(owner[whole])
        cut, edge, local = simplices[~whole], edge[~whole], local[~whole]
        one, other, row = cut.copy(), cut.copy(), np.arange(len(cut))
        one[row, pairs[local, 1]] = middles[edge]
        other[row, pairs[local, 0]] = middles[edge]
        simplices, owner = np.concatenate([one, other]), np.tile(owner[~whole], 2)
    return np.concatenate(done), np.concatenate(owners)
