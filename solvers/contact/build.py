"""From couplings and laws to contact rows: which node carries a multiplier, in which directions, for which neighbours.

Normal multipliers come first, since a friction direction may depend on them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from geometry.arrays import Array, Bools, Ints
from geometry.errors import SceneError
from geometry.surfaces.surface import Surface
from solvers.contact.coupling import Coupling, Points
from solvers.contact.rows import ContactRows
from solvers.fem.constraints import Constraints
from solvers.scene.contact import Contact

SMALL = 1e-6  # sine of the angle below which directions count as parallel
DIGITS = 9  # of a component: where rounding alone decides which is the least, the first one is


@dataclass(frozen=True)
class Carrier:
    """Which nodes carry a multiplier, for which nodes each stands, and in which directions."""

    share: sparse.csr_matrix  # (m, n), columns add up to 1 (or 0 where nothing can carry)
    directions: Array  # (m, c, d): c unit directions a point
    free: Bools  # (m, c)

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


def _independent(directions: Array, bases: Array, held: Array) -> tuple[Array, Bools, Array]:
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


def take_over(surface: Surface, owner: Ints, facing: Bools, count: int) -> sparse.csr_matrix:
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


LEANS = 0.98  # cosine of the angle up to which a normal at a surface's edge is one of the plane it is held in


def build_rows(
    contacts: Mapping[str, tuple[Contact, Coupling]], constraints: Constraints, moved: Mapping[str, Array]
) -> list[ContactRows]:
    """Rows of all contacts.

    A gap that was measured after a motion `moved` (n_all, d) is one of displacements counted from the start once the
    motion's own part of them is added.
    """
    used: dict[int, Array] = {}
    frames = {name: frames_of(_held_in(coupling, constraints)) for name, (_, coupling) in contacts.items()}
    normal_carriers = {
        name: carry(coupling, frames[name][:, :1], constraints, used)
        for name, (contact, coupling) in contacts.items()
        if not contact.normal.at_quadrature
    }
    found = []
    for name, (contact, coupling) in contacts.items():
        weights, friction = coupling.weights, contact.tangential
        gap = contact.gap_offset + (0.0 * coupling.gap if contact.normal.ties else coupling.gap)
        if contact.normal.at_quadrature:
            points = coupling.points(contact.degree(coupling.surface.degree))
            N_n, W_n, psi, gap_n = _normal_rows(points), points.weights, points.psi, points.gap + contact.gap_offset
            dropped = 0
        else:
            carrier = normal_carriers[name]
            if not carrier.share.shape[0]:
                raise SceneError(
                    f"contacts.{name}: supports prescribe the normal motion of all of {contact.surface}, so it can "
                    "carry no contact pressure; free it or remove the contact"
                )
            N_n, W_n = carrier.rows(coupling)
            psi = carrier.share.T.multiply(weights[:, None]).tocsr()
            gap_n = carrier.mean(weights)[0] @ gap
            dropped = int(np.sum(weights != 0)) - len(W_n)
        if friction is not None:
            carrier = carry(coupling, frames[name][:, 1:], constraints, used)
            dropped += int(np.sum(weights != 0)) - carrier.share.shape[0]
        else:
            carrier = _none(coupling)
        N_t, W_t = carrier.rows(coupling)
        if name in moved:
            gap_n = gap_n + N_n @ moved[name].ravel()
            gap = gap + np.einsum("nd,nd->n", coupling.normals, coupling.relative @ moved[name])
        found.append(
            ContactRows(
                name=name, surface=coupling.surface, master=coupling.master, normal=contact.normal, friction=friction,
                frames=frames[name], node_weights=weights, node_gap=gap, relative=coupling.relative,
                N_n=N_n, W_n=W_n, gap=gap_n, N_t=N_t, W_t=W_t,
                tangents=carrier.directions, free=carrier.free, psi=psi, share_t=carrier.share, dropped=dropped,
            )
        )  # fmt: skip
    return found


def _held_in(coupling: Coupling, constraints: Constraints) -> Array:
    """Normals (n, d) to a body turned into the planes that nodes are held in: symmetry planes, at the surface's edge.

    There the averaged normals see one side of the edge only and lean out of the plane.
    """
    if not coupling.master:
        return coupling.normals
    bases, free = constraints.bases(coupling.surface.nodes)
    inside = np.einsum("nik,njk,nj->ni", bases, bases, coupling.normals)
    length = np.linalg.norm(inside, axis=1)
    turned = ~free.all(axis=1) & (length > LEANS)
    normals = coupling.normals.copy()
    normals[turned] = inside[turned] / length[turned, None]
    return normals


def _none(coupling: Coupling) -> Carrier:
    """Nobody carries anything: no friction."""
    n, d = coupling.surface.points.shape
    return Carrier(sparse.csr_matrix((0, n)), np.zeros((0, d - 1, d)), np.zeros((0, d - 1), bool))


def _normal_rows(points: Points) -> Any:
    """N_n (q, (n + n_master) d): relative displacement along the normals."""
    entries, d = points.relative.tocoo(), points.normals.shape[1]
    values = entries.data[:, None] * points.normals[entries.row]
    columns = entries.col[:, None] * d + np.arange(d)
    shape = (points.relative.shape[0], points.relative.shape[1] * d)
    return sparse.csr_matrix((values.ravel(), (np.repeat(entries.row, d), columns.ravel())), shape=shape)
