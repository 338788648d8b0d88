"""Contact with a rigid obstacle: biorthogonal multipliers at nodes, compliance pressure at quadrature points.

With the dual basis the weighted gap of a node is its own gap (in the basis phi~ of `Surface`), so the rows of a node
are its displacement in the local frame. A node whose motion is prescribed carries no multiplier: its neighbours take
over its shape function.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from geometry.errors import SceneError
from geometry.obstacles import Obstacle
from geometry.surface import Surface
from solvers.constraints import Constraints
from solvers.nouns.contact import Contact
from solvers.operators.rows import ContactRows

Array = NDArray[np.float64]
SMALL = 1e-6  # sine of the angle below which directions count as parallel


@dataclass(frozen=True)
class Carrier:
    """Which nodes carry a multiplier, for which nodes each stands, and in which directions."""

    share: sparse.csr_matrix  # (m, n), columns add up to 1 (or 0 where nothing can carry)
    directions: Array  # (m, c, d): c unit directions a point
    free: NDArray[np.bool_]  # (m, c)

    def mean(self, surface: Surface, weights: Array) -> tuple[sparse.csr_matrix, Array]:
        """Nodal values (n,) to weighted values at the points (m,), and the points' weights W (m,)."""
        total = np.asarray(self.share @ weights)
        return (self.share.multiply(weights[None, :]).multiply(1 / total[:, None]) @ surface.transform).tocsr(), total

    def rows(self, surface: Surface, weights: Array) -> tuple[sparse.csr_matrix, Array]:
        """N (m c, n d) and W (m,): weighted displacement divided by the weights."""
        m, c, d = self.directions.shape
        matrix, total = self.mean(surface, weights)
        mean = matrix.tocoo()
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


def build_rows(contacts: dict[str, tuple[Contact, Obstacle, Surface]], constraints: Constraints) -> list[ContactRows]:
    """Rows of all contacts; normal multipliers first, since a friction direction may depend on them."""
    used: dict[int, Array] = {}  # root node -> directions (r, k) of its free basis that multipliers already hold
    normal_carriers = {}
    for name, (contact, obstacle, surface) in contacts.items():
        if not contact.normal.at_quadrature:
            frames = frames_of(-obstacle.normals(surface.points))
            normal_carriers[name] = _carry(surface, frames[:, :1], constraints, used)
    found = []
    for name, (contact, obstacle, surface) in contacts.items():
        frames = frames_of(-obstacle.normals(surface.points))
        weights, friction = surface.node_weights(), contact.tangential
        gap = np.zeros(len(weights)) if contact.normal.ties else obstacle.signed_gap(surface.points)
        gap = gap + contact.gap_offset
        if contact.normal.at_quadrature:
            N_n, W_n, psi, gap_n = _quadrature_rows(surface, obstacle, contact.degree(surface.degree))
            gap_n = gap_n + contact.gap_offset
        else:
            carrier = normal_carriers[name]
            if not carrier.share.shape[0]:
                raise SceneError(
                    f"contacts.{name}: supports prescribe the normal motion of all of {contact.surface}, so it can "
                    "carry no contact pressure; free it or remove the contact"
                )
            N_n, W_n = carrier.rows(surface, weights)
            psi = carrier.share.T.multiply(weights[:, None]).tocsr()
            gap_n = carrier.mean(surface, weights)[0] @ gap
        dropped = 0 if contact.normal.at_quadrature else len(weights) - len(W_n)
        if friction is not None:
            carrier = _carry(surface, frames[:, 1:], constraints, used)
            dropped += len(weights) - carrier.share.shape[0]
        else:
            d = surface.dim
            carrier = Carrier(sparse.csr_matrix((0, len(weights))), np.zeros((0, d - 1, d)), np.zeros((0, d - 1), bool))
        N_t, W_t = carrier.rows(surface, weights)
        found.append(
            ContactRows(
                name=name, surface=surface, obstacle=obstacle, normal=contact.normal, friction=friction,
                frames=frames, node_weights=weights, node_gap=surface.transform @ gap,
                N_n=N_n, W_n=W_n, gap=gap_n, N_t=N_t, W_t=W_t,
                free=carrier.free, psi=psi, share_t=carrier.share, dropped=dropped,
            )
        )  # fmt: skip
    return found


def _carry(surface: Surface, directions: Array, constraints: Constraints, used: dict[int, Array]) -> Carrier:
    """Give each node a multiplier in `directions` (n, c, d), as far as its motion there is free and not yet held."""
    n, c, _ = directions.shape
    point_of_root: dict[int, int] = {}
    owner = np.full(n, -1)
    kept_directions: list[Array] = []
    kept_free: list[NDArray[np.bool_]] = []
    for j, node in enumerate(surface.nodes):
        root = constraints.root.get(int(node), int(node))
        if root in point_of_root:  # a periodic image: one multiplier for both
            owner[j] = point_of_root[root]
            continue
        basis = constraints.basis(int(node))
        held = used.get(root, np.zeros((basis.shape[1], 0)))
        own, free, held = _independent(directions[j], basis, held)
        if free.any():
            owner[j] = point_of_root[root] = len(kept_directions)
            kept_directions.append(own)
            kept_free.append(free)
            used[root] = held
    share = _take_over(surface, owner, len(kept_directions))
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


def _take_over(surface: Surface, owner: NDArray[np.int64], count: int) -> sparse.csr_matrix:
    """Shares (count, n): a node without a multiplier is divided among its nearest neighbours that have one."""
    n = len(owner)
    share = sparse.lil_matrix((count, n))
    for j in np.flatnonzero(owner >= 0):
        share[owner[j], j] = 1.0
    missing = set(np.flatnonzero(owner < 0).tolist())
    neighbours = surface.neighbours() if missing else {}
    while missing:
        reached = {j: [k for k in neighbours[j] if k not in missing] for j in missing}
        layer = {j: near for j, near in reached.items() if near}
        if not layer:
            break
        columns = {j: sum(share[:, k] for k in near) / len(near) for j, near in layer.items()}
        for j, column in columns.items():
            share[:, j] = column
        missing -= set(layer)
    return share.tocsr()


def _quadrature_rows(
    surface: Surface, obstacle: Obstacle, degree: int
) -> tuple[sparse.csr_matrix, Array, sparse.csr_matrix, Array]:
    """N_n, W_n, psi and gap at facet quadrature points: exactly the form j_n."""
    weights, basis = surface.quadrature(degree)
    dual = surface.dual_basis(degree)
    (f, q), k, (n, d) = weights.shape, surface.facets.shape[1], surface.points.shape
    x = np.einsum("qk,fkd->fqd", basis, surface.points[surface.facets]).reshape(-1, d)
    normals = -obstacle.normals(x)
    row = np.repeat(np.arange(f * q), k)
    node = np.repeat(surface.facets[:, None, :], q, axis=1).ravel()
    phi = np.broadcast_to(basis, (f, q, k)).ravel()
    values = phi[:, None] * normals[row]
    columns = node[:, None] * d + np.arange(d)
    N_n = sparse.csr_matrix((values.ravel(), (np.repeat(row, d), columns.ravel())), shape=(f * q, n * d))
    psi = sparse.csr_matrix(((dual * weights[:, :, None]).ravel(), (node, row)), shape=(n, f * q))
    return N_n, weights.ravel(), psi, obstacle.signed_gap(x)
