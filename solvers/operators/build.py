"""From couplings and laws to rows: normal multipliers first, since a friction direction may depend on them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from geometry.errors import SceneError
from solvers.constraints import Constraints
from solvers.nouns.contact import Contact
from solvers.operators.carriers import Carrier, carry, frames_of
from solvers.operators.coupling import Coupling, Points
from solvers.operators.rows import ContactRows

Array = NDArray[np.float64]
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
