"""Mortar integrals: what a slave node weighs, which master nodes face it, and how far they are away.

With the dual basis psi the mass matrix of the slave side is diagonal, so that each slave node has a row of its own.
psi is dual on the covered part of each facet: what hangs over the master's edge does not count, and a linear
displacement goes over exactly up to that edge.

Source: Wohlmuth, SIAM J. Numer. Anal. 38 (2000); Popp et al., Int. J. Numer. Meth. Engng 83 (2010); of the edges
Cichosz & Bischoff, Comput. Methods Appl. Mech. Engrg. 200 (2011).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from geometry import dolfinx_versions as dx
from geometry.overlap import Overlap
from geometry.surface import Surface

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
SLIVER = 1e-9  # of a facet, or of a node's weight: less is not covered


def mortar_integrals(slave: Surface, master: Surface, found: Overlap) -> tuple[Array, sparse.csr_matrix, Array, Any]:
    """Weights, projection, weighted gap and dual basis of the covered part of a slave surface.

    A quadratic node of which only a little is covered can weigh nothing or less: it then counts as not covered.

    Returns:
        W (n,) [m^(d-1)]: ∫ phi~_j, 0 where not covered.
        P (n, n_master): ∫ psi_j phi_k of the master's nodal values, divided by W_j; rows add up to 1, or are empty.
        gap (n,) [m]: ∫ psi_j g, divided by W_j; inf where not covered.
        psi (n, q): psi_j times the weight of the quadrature points.
    """
    q, (n, k) = len(found.weights), (len(slave.points), slave.facets.shape[1])
    rows = np.flatnonzero(_covered(slave, found))
    dual, lumped = _dual(slave, found.slave_facet[rows], found.slave_local[rows], found.weights[rows])
    nodes = slave.facets[found.slave_facet[rows]]
    W = np.bincount(nodes.ravel(), lumped.ravel(), n)
    W[SLIVER * slave.node_weights() >= W] = 0.0
    values = dual * found.weights[rows, None] * (W[nodes] > 0)
    psi = sparse.csr_matrix((values.ravel(), (nodes.ravel(), np.repeat(rows, k))), shape=(n, q))
    basis = _values(master, found.master_local)
    partners = master.facets[found.master_facet]
    point = np.repeat(np.arange(q), partners.shape[1])
    phi = sparse.csr_matrix((basis.ravel(), (point, partners.ravel())), shape=(q, len(master.points)))
    share = np.divide(1.0, W, out=np.zeros(n), where=W > 0)
    gap = np.where(W > 0, share * (psi @ found.gap), np.inf)
    return W, (sparse.diags(share) @ psi @ phi).tocsr(), gap, psi


def _covered(slave: Surface, found: Overlap) -> NDArray[np.bool_]:
    """Points (q,) on facets of which more than a sliver is covered."""
    full = slave.quadrature(2 * slave.degree)[0].sum(axis=1)
    covered = np.bincount(found.slave_facet, found.weights, len(full))
    return np.asarray((covered > SLIVER * full)[found.slave_facet])


def _dual(slave: Surface, facets: Ints, local: Array, weights: Array) -> tuple[Array, Array]:
    """Values of the dual basis (q, k) at points ordered by facet, and what each adds to ∫ phi~ (q, k).

    psi = phi~ M^-1 D on a facet, of which a small part makes M nearly singular. With L, the facet's basis stretched
    over the box that the points fill, phi~ = L T, M = T^T G T and G = ∫ L^T L is as well conditioned as on a whole
    facet: psi = L G^-1 T^-T D.
    """
    first = np.flatnonzero(np.diff(facets, prepend=-1))
    at = np.cumsum(np.diff(facets, prepend=-1) > 0) - 1
    low, high = np.minimum.reduceat(local, first), np.maximum.reduceat(local, first)
    box = low[:, None] + dx.reference_nodes(slave.shape, slave.degree) * (high - low)[:, None]  # (f, k, d-1)
    T = _values(slave, box.reshape(-1, box.shape[2])).reshape(*box.shape[:2], box.shape[1]) @ slave.change.T
    L = _values(slave, (local - low[at]) / (high - low)[at])
    G = np.stack([np.add.reduceat(weights[:, None] * column[:, None] * L, first) for column in L.T], axis=1)
    lumped = weights[:, None] * (_values(slave, local) @ slave.change.T)
    D = np.add.reduceat(lumped, first)
    C = np.linalg.pinv(G, hermitian=True) @ np.swapaxes(np.linalg.inv(T), 1, 2) * D[:, None]
    psi = np.stack([np.einsum("qn,qn->q", L, column[at]) for column in np.moveaxis(C, 2, 0)], axis=1)
    return psi, lumped


def _values(surface: Surface, local: Array) -> Array:
    return dx.reference_basis(surface.shape, surface.degree, local)[0]
