"""Mortar between two bodies: weighted gaps and slips over the part of the slave that faces the master.

All weights are positive: a node that would weigh less than nothing hands its dual function to its neighbours.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from geometry import dolfinx_versions as dx
from geometry.overlap import overlap
from geometry.surface import Surface
from solvers.operators.carriers import take_over
from solvers.operators.coupling import Coupling, Points, between
from solvers.operators.mortar import mortar_integrals

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
LITTLE = 0.01  # of a node's weight: less faces the master
FAR = 10.0  # ∫ |psi_j| by ∫ psi_j: below 5 on whole facets, far more where a node's values are extrapolated


def mortar_coupling(slave: Surface, master: Surface, reach: float) -> Coupling:
    """Biorthogonal multipliers at the slave's nodes; what nothing faces carries none."""
    found = overlap(slave, master, reach, _degree(slave, master))
    weights, P, gap, psi = mortar_integrals(slave, master, found)
    facing = weights != 0
    own = sparse.diags(facing.astype(float)) @ slave.transform
    gap = np.where(facing, gap, 0.0)
    other = P @ master.node_normals()
    spread = np.divide(abs(psi).sum(axis=1).A1, weights, out=np.full(len(weights), np.inf), where=weights > 0)
    far = facing & ((spread > FAR) | (weights <= LITTLE * slave.node_weights()))
    if far.any():
        gap[far], other[far] = np.clip(gap[far], found.gap.min(), found.gap.max()), 0.0
    normals, gap = between(slave.node_normals(), other, gap)
    share = _handed_over(slave, weights, facing & (~far | _least(slave, spread)))
    total = np.asarray(share @ weights)
    each = np.divide(1.0, total, out=np.zeros(len(total)), where=total > 0)
    mean = sparse.diags(each) @ share @ sparse.diags(weights)
    return Coupling(
        slave,
        master,
        total,
        (mean @ sparse.hstack([own, -P])).tocsr(),
        mean @ gap,
        normals,
        total > 0,
        points=lambda degree: _points(slave, master, reach, max(degree, _degree(slave, master)), share),
    )


def _handed_over(slave: Surface, weights: Array, carries: NDArray[np.bool_]) -> Any:
    """Shares (n, n): what nodes that carry nothing weigh goes to their neighbours, and all that is left is positive.

    A carrier that is given more of less than nothing than it weighs itself hands over too. What a part of the surface
    weighs in all is its area: the last carrier there is keeps a positive weight.
    """
    n, facing = len(weights), weights != 0
    while True:
        share = take_over(slave, np.where(carries, np.arange(n), -1), facing, n)
        positive = carries & (share @ weights > 0)
        if np.array_equal(positive, carries):
            return share
        carries = positive


def _least(slave: Surface, values: Array) -> NDArray[np.bool_]:
    """Nodes (n,) whose value is finite and no larger than their neighbours': one at least of each part faced."""
    least = values.copy()
    np.minimum.at(least, slave.facets, values[slave.facets].min(axis=1, keepdims=True))
    return np.asarray(np.isfinite(values) & (values == least))


def _degree(slave: Surface, master: Surface) -> int:
    """Total degree of psi_j phi_k; the map of a quadrilateral doubles it."""
    product = slave.degree + max(slave.degree, master.degree)
    return product * (1 + (slave.shape == "quadrilateral")) + slave.axisymmetric


def _points(slave: Surface, master: Surface, reach: float, degree: int, share: Any) -> Points:
    """The integration points themselves."""
    found = overlap(slave, master, reach, degree)
    psi: Any = mortar_integrals(slave, master, found)[3]
    own = _values(slave, found.slave_facet, found.slave_local)
    other = _values(master, found.master_facet, found.master_local)
    relative = sparse.hstack([own, -other], format="csr")
    normals, gap = between(found.normals, other @ master.node_normals(), found.gap)
    return Points(found.weights, relative, gap, normals, (share @ psi).tocsr())


def _values(surface: Surface, facet: Ints, local: Array) -> sparse.csr_matrix:
    """Basis (q, n) of a surface at points given by facet and reference coordinates."""
    basis = dx.reference_basis(surface.shape, surface.degree, local)[0]
    rows = np.repeat(np.arange(len(facet)), basis.shape[1])
    entries = (basis.ravel(), (rows, surface.facets[facet].ravel()))
    return sparse.csr_matrix(entries, shape=(len(facet), len(surface.nodes)))
