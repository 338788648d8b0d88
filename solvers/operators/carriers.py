"""Who carries a multiplier: a node whose motion is prescribed hands its shape function to its neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from geometry.surface import Surface
from solvers.constraints import Constraints
from solvers.operators.coupling import Coupling

Array = NDArray[np.float64]
SMALL = 1e-6  # sine of the angle below which directions count as parallel
DIGITS = 9  # of a component: where rounding alone decides which is the least, the first one is


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
    least = np.eye(3)[np.argmin(np.abs(normals).round(DIGITS), axis=1)]
    first = np.cross(normals, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([normals, first, np.cross(normals, first)], axis=1)


def carry(coupling: Coupling, directions: Array, constraints: Constraints, used: dict[int, Array]) -> Carrier:
    """Give each node a multiplier in `directions` (n, c, d), as far as its motion there is free and not yet held.

    Args:
        used: root node -> projector (d, d) onto motions of its numbers that multipliers against rigid obstacles hold.
    """
    surface, facing = coupling.surface, coupling.weights != 0
    tried = np.flatnonzero(coupling.carries)
    roots, bases = constraints.roots(surface.nodes[tried]), constraints.bases(surface.nodes[tried])[0]
    rigid, nothing = coupling.master is None, np.zeros((surface.dim, surface.dim))
    held = np.array([used.get(root, nothing) if rigid else nothing for root in roots.tolist()])
    turned, free, held = _independent(directions[tried], bases, held.reshape(-1, *nothing.shape))
    able = np.flatnonzero(free.any(axis=1))
    first = able[np.sort(np.unique(roots[able], return_index=True)[1])]  # periodic images: one multiplier for both
    number = {root: k for k, root in enumerate(roots[first].tolist())}
    owner = np.full(len(surface.nodes), -1)
    owner[tried] = [number.get(root, -1) for root in roots.tolist()]
    if rigid:
        used |= dict(zip(number, held[first], strict=True))
    return Carrier(take_over(surface, owner, facing, len(first)), turned[first], free[first])


def _independent(directions: Array, bases: Array, held: Array) -> tuple[Array, NDArray[np.bool_], Array]:
    """Turn directions (n, c, d) so that those with free motion, independent of what is `held`, come first.

    Returns:
        Directions, which of them are free (n, c), and the projectors onto all that is held then (n, d, d).
    """
    motion = directions @ bases  # (n, c, d): free motion seen in each direction
    left, size, _ = np.linalg.svd(motion - motion @ held)
    free = size > SMALL
    left[free.all(axis=1)] = np.eye(directions.shape[1])
    turned = np.swapaxes(left, 1, 2) @ directions
    every = np.concatenate([held, free[:, :, None] * (turned @ bases)], axis=1)
    return turned, free, np.linalg.pinv(every, rcond=SMALL**1.5) @ every


def take_over(surface: Surface, owner: NDArray[np.int64], facing: NDArray[np.bool_], count: int) -> sparse.csr_matrix:
    """Shares (count, n): a node without a multiplier is divided among its nearest neighbours that have one."""
    own = np.flatnonzero(owner >= 0)
    share = sparse.csr_matrix((np.ones(len(own)), (own, owner[own])), shape=(len(owner), count))
    missing = (owner < 0) & facing
    neighbours = surface.neighbours() if missing.any() else None
    while missing.any():
        near = neighbours @ sparse.diags((~missing & facing).astype(float))
        total = np.asarray(near.sum(axis=1)).ravel()
        layer = missing & (total > 0)
        if not layer.any():
            break
        share = share + sparse.diags(layer / np.maximum(total, 1)) @ (near @ share)
        missing &= ~layer
    return share.T.tocsr()
