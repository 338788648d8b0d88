"""Mortar contact with dual (biorthogonal) multipliers: weights, projection and weighted gap of the slave's nodes.

With the dual basis psi the mass matrix of the slave side is diagonal, so that each slave node has a row of its own.
psi is dual on the covered part of each facet: the part beyond the master's edge does not count, and a linear
displacement is transferred exactly up to that edge.

Source: Wohlmuth, SIAM J. Numer. Anal. 38 (2000); Popp et al., Int. J. Numer. Meth. Engng 83 (2010); of the edges
Cichosz & Bischoff, Comput. Methods Appl. Mech. Engrg. 200 (2011).
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import ROUNDING, SLIGHT, Array, Bools, Ints
from stickslip.geometry.protocols import Sparse
from stickslip.geometry.surfaces.overlap import Overlap
from stickslip.geometry.surfaces.surface import SECTOR, Surface
from stickslip.solvers.contact.build import along, distribute_to_neighbours
from stickslip.solvers.contact.coupling import DIGITS, Coupling, Facing, On, Points, midway_normals, relative_to, shares

WILD = 1e6  # larger psi is replaced by a constant; on a whole facet psi is at most about 10


def mortar_integrals(slave: Surface, master: Surface, found: Overlap) -> tuple[Array, Sparse, Array, Sparse]:
    """Weights, projection, weighted gap and dual basis of the covered part of a slave surface.

    On partly covered facets a quadratic node may have a negative weight: sums over all nodes are right with it, but no
    multiplier can live there.

    Args:
        slave, master: surfaces of n and n_master nodes.
        found: their overlap, q integration points of a degree that suffices for products of two basis functions.

    Returns:
        W (n,) [m^(d-1)]: ∫ phi~_j, 0 where not covered; whole facets make it positive.
        P (n, n_master): ∫ psi_j phi_k of the master's nodal values, divided by W_j; rows add up to 1, or are empty.
        gap (n,) [m]: ∫ psi_j g, divided by W_j; inf where not covered.
        psi (n, q): psi_j times the weight of the quadrature points.
    """
    q, (n, k) = len(found.weights), (len(slave.points), slave.facets.shape[1])
    rows = np.flatnonzero(_covered(slave, found))
    dual, lumped = _dual(slave, found.slave_facet[rows], found.slave_local[rows], found.weights[rows])
    nodes = slave.facets[found.slave_facet[rows]]
    W = np.bincount(nodes.ravel(), lumped.ravel(), n).astype(float)  # integers where nothing is covered
    # of a facet, or of a node's weight: less counts as not covered
    W[np.abs(W) <= ROUNDING * slave.node_weights()] = 0.0
    values = dual * found.weights[rows, None] * (W[nodes] != 0)
    psi = sparse.csr_matrix((values.ravel(), (nodes.ravel(), np.repeat(rows, k))), shape=(n, q))
    basis = _values(master, found.master_local)
    partners = master.facets[found.master_facet]
    point = np.repeat(np.arange(q), partners.shape[1])
    phi = sparse.csr_matrix((basis.ravel(), (point, partners.ravel())), shape=(q, len(master.points)))
    share = np.divide(1.0, W, out=np.zeros(n), where=W != 0)
    gap = np.where(W != 0, share * (psi @ found.gap), np.inf)
    return W, (sparse.diags(share) @ psi @ phi).tocsr(), gap, psi


def _covered(slave: Surface, found: Overlap) -> Bools:
    """Which of the points (q,) lie on facets of which more than a sliver is covered."""
    full = slave.quadrature(2 * slave.degree)[0].sum(axis=1)
    covered = np.bincount(found.slave_facet, found.weights, len(full))
    return np.asarray((covered > ROUNDING * full)[found.slave_facet])


def _dual(slave: Surface, facets: Ints, local: Array, weights: Array) -> tuple[Array, Array]:
    """Values of the dual basis (q, k) at points ordered by facet, and what each point adds to ∫ phi~ (q, k).

    psi = phi~ M^-1 D on a facet, M its mass matrix and D = diag(∫ phi~). A small covered part makes M nearly singular.
    With L, the facet's basis stretched over the box that the points fill, phi~ = L T, M = T^T G T, and G = ∫ L^T L is
    as well conditioned as on a whole facet: psi = L G^-1 T^-T D. On a small part inside a facet, psi distinguishes the
    nodes only by extrapolation: where its values become too large, psi is constant, not dual, with the same integrals.
    """
    first = np.flatnonzero(np.diff(facets, prepend=-1))
    at = np.cumsum(np.diff(facets, prepend=-1) > 0) - 1
    low, high = np.minimum.reduceat(local, first), np.maximum.reduceat(local, first)
    box = low[:, None] + dx.reference_nodes(slave.shape, slave.degree) * (high - low)[:, None]  # (f, k, d-1)
    f, k = box.shape[:2]
    T = _values(slave, box.reshape(f * k, local.shape[1])).reshape(f, k, k) @ slave.change.T
    L, phi = _values(slave, (local - low[at]) / (high - low)[at]), _values(slave, local) @ slave.change.T
    C = np.linalg.pinv(_products(L, L, weights, first), hermitian=True) @ np.swapaxes(np.linalg.pinv(T), 1, 2)
    lumped = weights[:, None] * phi
    D = np.add.reduceat(lumped, first)
    psi = _combine(L, (C * D[:, None])[at])
    left = D[:, :, None] * np.eye(k) - _products(
        phi, psi, weights, first
    )  # rounding error: one step of iterative refinement
    psi = psi + _combine(L, (C @ left)[at])
    dual = np.abs(left).max(axis=(1, 2)) <= SLIGHT * np.abs(D).max(axis=1)  # false where T is singular to rounding
    wild = ~((np.maximum.reduceat(np.abs(psi).max(axis=1), first) <= WILD) & dual)
    mean = D[wild] / D[wild].sum(axis=1, keepdims=True)
    psi[wild[at]] = np.repeat(mean, np.bincount(at, minlength=f)[wild], axis=0)
    return psi, lumped


def _products(a: Array, b: Array, weights: Array, first: Ints) -> Array:
    """∫ a_i b_j over each facet (f, k, k)."""
    return np.stack([np.add.reduceat((weights * column)[:, None] * b, first) for column in a.T], axis=1)


def _combine(values: Array, coefficients: Array) -> Array:
    return np.asarray(np.einsum("qn,qni->qi", values, coefficients))


def _values(surface: Surface, local: Array) -> Array:
    return dx.reference_basis(surface.shape, surface.degree, local)[0]


LITTLE = 0.01  # of a node's own weight: with less than that facing the master its values are extrapolated
FAR = 10.0  # ∫ |psi_j| / ∫ psi_j: below 5 on whole facets, far more where a node's values are extrapolated


def mortar_coupling(facing: Facing) -> Coupling:
    """Coupling with dual (biorthogonal) multipliers at the slave's nodes; nodes that face nothing carry none."""
    slave, master = facing.slave, facing.master
    degree = product_degree(slave, master) + slave.degree * slave.borrows  # of psi_j n phi_k
    found = facing.points(degree)
    weights, P, gap, psi = mortar_integrals(slave, master, found)
    if slave.images is not None:
        weights, P, gap, psi = _across_cuts(slave, master, weights, P, gap, psi)
    faces = weights != 0
    own = sparse.diags(faces.astype(float)) @ slave.transform
    gap = np.where(faces, gap, 0.0)
    other = P @ master.node_normals()
    spread = np.divide(abs(psi).sum(axis=1).A1, weights, out=np.full(len(weights), np.inf), where=weights > 0)
    averted = np.einsum("nd,nd->n", slave.node_normals(), other) > 0  # of facets that face it no mean but a wild one is
    far = faces & ((spread > FAR) | (weights <= LITTLE * slave.node_weights()) | averted)
    if far.any():
        gap[far], other[far] = np.clip(gap[far], found.gap.min(), found.gap.max()), 0.0
    normals, gap = midway_normals(slave.node_normals(), other, gap, slave.at_edge, P @ master.at_edge)
    share = positive_shares(slave, weights, faces & (~far | _least(slave, spread)))
    total = np.asarray(share @ weights)
    each = np.divide(1.0, total, out=np.zeros(len(total)), where=total > 0)
    mean = sparse.diags(each) @ share @ sparse.diags(weights)
    share = share if slave.images is None else share @ slave.fold
    relative, turning = (mean @ sparse.hstack([own, -P])).tocsr(), None
    if slave.borrows:
        turning = _turning(_points(facing, degree, sparse.diags(each) @ share), relative, normals)
    return Coupling(
        surface=slave,
        master=master,
        weights=total,
        relative=relative,
        turning=turning,
        gap=mean @ gap,
        normals=normals,
        carries=total > 0,
        points=lambda degree: _points(facing, max(degree, product_degree(slave, master)), share),
    )


def _across_cuts(
    slave: Surface, master: Surface, W: Array, P: Sparse, gap: Array, psi: Sparse
) -> tuple[Array, Sparse, Array, Sparse]:
    """The same integrals, those at nodes that are turned ones of a cyclic sector moved to these, see `of_sectors`.

    What faces the turned node is a sector back at the other one.
    """
    assert slave.images is not None
    order = np.argsort(master.nodes, kind="stable")
    back = np.where(master.nodes < SECTOR, master.nodes + master.nodes.max() // SECTOR * SECTOR, master.nodes - SECTOR)
    at = order[np.searchsorted(master.nodes[order], back).clip(max=len(order) - 1)]
    turned, known = np.zeros(len(W)), (master.nodes[at] == back) & (master.nodes < 2 * SECTOR)
    turned[slave.images[1]] = 1.0
    part = W * (1 - turned * (abs(P) @ ~known > 0))
    behind = sparse.csr_matrix((np.ones(len(at)), (np.arange(len(at)), at)), (len(at), len(at)))
    sums = slave.fold @ (sparse.diags(part * (1 - turned)) @ P + sparse.diags(part * turned) @ P @ behind)
    total, mean = slave.fold @ W, slave.fold @ part
    each = np.divide(1.0, mean, out=np.zeros(len(W)), where=mean != 0)
    gap = np.where(total != 0, each * (slave.fold @ (part * np.where(W != 0, gap, 0.0))), np.inf)
    return total, (sparse.diags(each) @ sums).tocsr(), gap, (slave.fold @ psi).tocsr()


def _turning(points: Points, relative: Sparse, normals: Array) -> Sparse | None:
    """Means with psi_j of the relative displacement along normals (n, n_all d), None if these turn nowhere.

    The dual basis of a side whose corners borrow reproduces constants only. With a node's own normal all around it, a
    uniform pressure on a curved side would not be p n; with the normals of the points it is.

    Args:
        points: the integration points, psi divided by the weights of the nodes.
        relative: of the nodes (n, n_all), whose entries are kept where nothing turns.
        normals: of the nodes (n, d).
    """
    nodal = along(relative, normals[:, None])
    turn = (points.psi @ along(points.relative, points.normals[:, None]) - nodal).tocsr()
    turn.data[np.abs(turn.data) < ROUNDING] = 0.0  # entries of motions; those of both are about 1
    turn.eliminate_zeros()
    return (nodal + turn).tocsr() if turn.nnz else None


def positive_shares(slave: Surface, weights: Array, carries: Bools) -> Sparse:
    """Shares (n, n) of the carriers in all nodes, such that every carrier's weight is positive.

    The weight of a node without a multiplier goes to its neighbours. A carrier whose weight becomes negative by that
    loses its multiplier too. The weights of a connected part add up to its area, so one carrier at least stays.
    """
    n, facing = len(weights), weights != 0
    while True:
        share = distribute_to_neighbours(slave, np.where(carries, np.arange(n), -1), facing, n)
        positive = carries & (share @ weights > 0)
        if np.array_equal(positive, carries):
            return share
        carries = positive


def _least(slave: Surface, values: Array) -> Bools:
    """Nodes (n,) whose value > 0 is finite and less than their neighbours': one at least of each part faced.

    Of neighbours whose values differ by rounding alone, the first one has the least.
    """
    places = np.empty(len(values), np.int64)
    places[np.argsort(np.log(values).round(DIGITS), kind="stable")] = np.arange(len(values))
    least = places.copy()
    np.minimum.at(least, slave.facets, places[slave.facets].min(axis=1, keepdims=True))
    return np.asarray(np.isfinite(values) & (places == least))


def product_degree(slave: Surface, master: Surface) -> int:
    """Quadrature degree for psi_j phi_k; the map of a quadrilateral doubles it, the radius in axisymmetry adds one."""
    product = slave.degree + max(slave.degree, master.degree)
    return product * (1 + (slave.shape == "quadrilateral")) + slave.axisymmetric


def _points(facing: Facing, degree: int, share: Sparse) -> Points:
    """The integration points of the overlap, with `share` (n, n) of `positive_shares`."""
    slave, master, found = facing.slave, facing.master, facing.points(degree)
    psi = mortar_integrals(slave, master, found)[3]
    own, other = On(found.slave_facet, found.slave_local), On(found.master_facet, found.master_local)
    at_edge, basis = own.basis(slave) @ slave.at_edge, other.basis(master)
    opposite = basis @ master.node_normals()
    normals, gap = midway_normals(found.normals, opposite, found.gap, at_edge, basis @ master.at_edge)
    return Points(
        weights=found.weights,
        relative=relative_to(own, slave, other, master),
        gap=gap,
        normals=normals,
        psi=(share @ psi).tocsr(),
        phi=(share @ shares(own, slave, found.weights)).tocsr(),
        own=own,
        other=other,
        whole=np.ones(len(found.weights), bool),
    )
