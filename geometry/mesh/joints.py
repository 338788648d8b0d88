"""Parts of a mesh that can move against each other without strain, and the nodes at which they are hinged.

Cells that hang together by facets (edges in 2D, faces in 3D) move as one. Where two such sets share nodes alone,
they are one part too if these leave them no motion against each other: two in 2D, three on no line in 3D.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy import sparse
from scipy.spatial import KDTree

from stickslip.geometry.arrays import CLOSE, Array, Ints, connected
from stickslip.geometry.protocols import Gmsh


@dataclass(frozen=True)
class Joints:
    """Nodes that two parts share: both move alike there, and can turn against each other unless more holds them."""

    points: Array  # (j, d) [m]
    parts: Ints  # (j, 2), the first is that of the node in what `find_parts` returns


def find_parts(gmsh: Gmsh, dim: int, unit: float) -> tuple[Ints, Joints]:
    """Parts of the mesh of the current gmsh model, numbered from 0 in the order of their first nodes.

    Args:
        unit: length of the gmsh model's unit [m].

    Returns:
        The part of each node, of a shared one the first part, and -1 for a node of no cell; and the shared nodes.
    """
    cell, node, part = _sets_of_cells(gmsh, dim)
    has = sparse.csr_matrix((np.ones(len(node), np.int32), (node, part[cell]))).tocoo()  # nodes increase
    node, part = has.row.astype(np.int64), has.col.astype(np.int64)
    shared = {int(n) for n in node[1:][node[1:] == node[:-1]]}
    points = {n: unit * np.asarray(gmsh.model.mesh.getNode(n + 1)[0])[:dim] for n in sorted(shared)}
    part = _merged(node, part, points)
    found = np.full(int(node.max()) + 1, -1)
    found[node[::-1]] = part[::-1]
    joints = [(n, found[n], p) for n, p in zip(node.tolist(), part.tolist(), strict=True) if found[n] != p]
    pairs = dict.fromkeys(joints)  # of a node whose sets of cells were merged only one is left
    return found, Joints(
        points=np.array([points[n] for n, *_ in pairs]).reshape(-1, dim),
        parts=np.array([pair for _, *pair in pairs], np.int64).reshape(-1, 2),
    )


def open_seams(gmsh: Gmsh, dim: int, part: Ints, bodies: Mapping[str, int]) -> dict[str, int]:
    """Pairs of nodes at the same place in two parts of one body, by body: there its pieces look as if they were one.

    Pairs on named sides do not count: these may be in contact.

    Args:
        part: of each node, see `find_parts`.
        bodies: tag of each body's physical group.
    """
    mesh, named, found = gmsh.model.mesh, np.zeros(len(part), bool), {}
    for _, tag in gmsh.model.getPhysicalGroups(dim - 1):
        named[np.asarray(mesh.getNodesForPhysicalGroup(dim - 1, tag)[0], np.int64) - 1] = True
    for body, tag in bodies.items():
        tags, flat = mesh.getNodesForPhysicalGroup(dim, tag)
        nodes, points = np.asarray(tags, np.int64) - 1, np.asarray(flat).reshape(-1, 3)
        if len(np.unique(part[nodes])) == 1:
            continue
        size = float(np.ptp(points, axis=0).max())
        # of a body's size: nodes nearer than that lie at the same place
        one, other = nodes[KDTree(points).query_pairs(CLOSE * size, output_type="ndarray")].T
        count = int(np.count_nonzero((part[one] != part[other]) & ~(named[one] & named[other])))
        if count:
            found[body] = count
    return found


def _sets_of_cells(gmsh: Gmsh, dim: int) -> tuple[Ints, Ints, Ints]:
    """Cells that hang together by facets.

    Returns:
        Cell (n,) and node (n,), one pair for each node of each cell; and the number of each cell's set.
    """
    of_nodes, nodes, of_facets, facets, count = [], [], [], [], 0
    for kind in gmsh.model.mesh.getElementTypes(dim):
        tags, flat = gmsh.model.mesh.getElementsByType(kind)
        cells = np.arange(count, count := count + len(tags))
        nodes.append(np.asarray(flat, np.int64) - 1)
        of_nodes.append(np.repeat(cells, len(flat) // len(tags)))
        rows = _facets(gmsh, dim, kind)
        facets.append(np.sort(rows, axis=1)[:, :dim])  # no two faces of four corners share three of them
        of_facets.append(np.repeat(cells, len(rows) // len(tags)))
    cell, node = np.concatenate(of_nodes), np.concatenate(nodes)
    key = _numbers(np.concatenate(facets), int(node.max()) + 1)
    order = np.argsort(key, kind="stable")
    beside, owner = key[order][1:] == key[order][:-1], np.concatenate(of_facets)[order]
    pairs = owner[:-1][beside], owner[1:][beside]
    return cell, node, connected(count, *pairs)


def _facets(gmsh: Gmsh, dim: int, kind: int) -> Ints:
    """Corner nodes (f, k) of the facets of all cells of a kind, cell by cell."""
    mesh = gmsh.model.mesh
    if dim == 2:
        return np.asarray(mesh.getElementEdgeNodes(kind, -1, True), np.int64).reshape(-1, 2) - 1
    corners = 4 if mesh.getElementProperties(kind)[5] == 8 else 3  # of a hexahedron, and of a tetrahedron
    return np.asarray(mesh.getElementFaceNodes(kind, corners, -1, True), np.int64).reshape(-1, corners) - 1


def _numbers(rows: Ints, count: int) -> Ints:
    """One number for each row (n, k) of numbers below `count`, equal where the rows are.

    >>> _numbers(np.array([[0, 1], [2, 1], [0, 1]]), 3)
    array([1, 7, 1])
    """
    found, size = rows[:, 0], count
    for column in rows[:, 1:].T:
        if size > 2**62 // count:
            found = np.unique(found, return_inverse=True)[1]
            size = int(found.max()) + 1
        found, size = found * count + column, size * count
    return found


def _merged(node: Ints, part: Ints, points: dict[int, Array]) -> Ints:
    """The parts (n,) with those made one that shared nodes hold to each other, numbered by their first nodes.

    Args:
        node, part: (n,) a node, increasing, and a part that has it.
        points: coordinates (d,) of the nodes that several parts have.
    """
    while True:
        between = defaultdict[tuple[int, int], list[Array]](list)
        for n, x in points.items():
            low, high = np.searchsorted(node, (n, n + 1))
            for pair in combinations(np.unique(part[low:high]).tolist(), 2):
                between[pair].append(x)
        held = [pair for pair, x in between.items() if is_rigid(np.array(x))]
        part = connected(int(part.max()) + 1, *np.array(held, np.int64).reshape(-1, 2).T)[part]
        if not held:
            _, first, number = np.unique(part, return_index=True, return_inverse=True)
            return np.argsort(np.argsort(first))[number]


def is_rigid(points: Array) -> bool:
    """Whether two parts that share these points (n, d) cannot move against each other; not in axisymmetric models."""
    count, d = points.shape
    if count < d:
        return False
    sizes = np.linalg.svd(points - points[0], compute_uv=False)
    return bool(sizes[d - 2] > CLOSE * sizes[0])  # breadth over length below which points count as lying on a line
