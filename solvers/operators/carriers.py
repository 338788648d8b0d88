"""Who carries a multiplier: a node whose motion is prescribed hands its shape function to its neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from geometry.surface import Surface
from solvers.constraints import Constraints
from solvers.operators.coupling import LITTLE, Coupling

Array = NDArray[np.float64]
SMALL = 1e-6  # sine of the angle below which directions count as parallel


@dataclass(frozen=True)
class Carrier:
    """Which nodes carry a multiplier, for which nodes each stands, and in which directions."""

    share: sparse.csr_matrix  # (m, n), columns add up to 1 (or 0 where nothing can carry)
    directions: Array  # (m, c, d): c unit directions a point
    free: NDArray[np.bool_]  # (m, c)

    def mean(self, weights: Array) -> tuple[sparse.csr_matrix, Array]:
        """Values at nodes (n,) to weighted means at the points (m,), and the points' weights W (m,)."""
        total = np.asarray(self.share @ weights)
        return self.share.multiply(weights[None, :]).multiply(1 / total[:, None]).tocsr(), total

    def rows(self, coupling: Coupling) -> tuple[sparse.csr_matrix, Array]:
        """N (m c, (n + n_master) d) and W (m,): weighted relative displacement divided by the weights."""
        m, c, d = self.directions.shape
        matrix, total = self.mean(coupling.weights)
        mean = (matrix @ coupling.relative).tocoo()
        components = self.directions[mean.row] * self.free[mean.row][:, :, None]  # (nnz, c, d)
        i = mean.row[:, None, None] * c + np.arange(c)[None, :, None]
        j = mean.col[:, None, None] * d + np.arange(d)[None, None, :]
        i, j = np.broadcast_to(i, components.shape), np.broadcast_to(j, components.shape)
        values = mean.data[:, None, None] * components
        matrix = sparse.coo_matrix((values.ravel(), (i.ravel(), j.ravel())), shape=(m * c, mean.shape[1] * d))
        return matrix.tocsr(), total


def frames_of(normals: Array) -> Array:
    """Orthonormal frames (n, d, d), row 0 the normal (n, d).

    >>> frames_of(np.array([[0.0, -1.0]]))[0]
    array([[ 0., -1.],
           [ 1.,  0.]])
    """
    if normals.shape[1] == 2:
        return np.stack([normals, np.stack([-normals[:, 1], normals[:, 0]], axis=1)], axis=1)
    least = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    first = np.cross(normals, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([normals, first, np.cross(normals, first)], axis=1)


def carry(coupling: Coupling, directions: Array, constraints: Constraints, used: dict[int, Array]) -> Carrier:
    """Give each node a multiplier in `directions` (n, c, d), as far as its motion there is free and not yet held.

    Args:
        used: root node -> directions (r, k) of its free basis that multipliers against rigid obstacles already hold.
    """
    surface, facing = coupling.surface, coupling.weights != 0
    little = LITTLE * surface.node_weights()  # too little to tell the gap at the node from that of what faces it
    n, c, _ = directions.shape
    point_of_root: dict[int, int] = {}
    owner = np.full(n, -1)
    kept_directions: list[Array] = []
    kept_free: list[NDArray[np.bool_]] = []
    for j, node in enumerate(surface.nodes):
        if coupling.weights[j] <= little[j]:
            continue
        root = constraints.root.get(int(node), int(node))
        if root in point_of_root:  # a periodic image: one multiplier for both
            owner[j] = point_of_root[root]
            continue
        basis = constraints.basis(int(node))
        held = np.zeros((basis.shape[1], 0)) if coupling.master else used.get(root, np.zeros((basis.shape[1], 0)))
        own, free, held = _independent(directions[j], basis, held)
        if free.any():
            owner[j] = point_of_root[root] = len(kept_directions)
            kept_directions.append(own)
            kept_free.append(free)
            if coupling.master is None:
                used[root] = held
    share = _take_over(surface, owner, facing, len(kept_directions))
    d = surface.dim
    return Carrier(share, np.array(kept_directions).reshape(-1, c, d), np.array(kept_free, bool).reshape(-1, c))


def _independent(directions: Array, basis: Array, held: Array) -> tuple[Array, NDArray[np.bool_], Array]:
    """Turn directions (c, d) so that those with free motion, independent of what is held, come first."""
    motion = directions @ basis  # (c, r): free motion seen in each direction
    if held.shape[1]:
        inside = np.linalg.qr(held)[0]
        motion = motion - (motion @ inside) @ inside.T
    left, size, _ = np.linalg.svd(motion)
    rank = int(np.sum(size > SMALL))
    if rank == len(directions):
        left = np.eye(rank)
    free = np.arange(len(directions)) < rank
    turned = left.T @ directions
    return turned, free, np.concatenate([held, (turned[free] @ basis).T], axis=1)


def _take_over(surface: Surface, owner: NDArray[np.int64], facing: NDArray[np.bool_], count: int) -> sparse.csr_matrix:
    """Shares (count, n): a node without a multiplier is divided among its nearest neighbours that have one."""
    n = len(owner)
    share = sparse.lil_matrix((count, n))
    for j in np.flatnonzero(owner >= 0):
        share[owner[j], j] = 1.0
    missing = set(np.flatnonzero((owner < 0) & facing).tolist())
    neighbours = surface.neighbours() if missing else {}
    while missing:
        reached = {j: [k for k in neighbours[j] if k not in missing and facing[k]] for j in missing}
        layer = {j: near for j, near in reached.items() if near}
        if not layer:
            break
        columns = {j: sum(share[:, k] for k in near) / len(near) for j, near in layer.items()}
        for j, column in columns.items():
            share[:, j] = column
        missing -= set(layer)
    return share.tocsr()
