"""Node-to-segment (2D) and node-to-face (3D): each slave node meets the master facet along its normal.

A contact element is a slave node with the nodes of that facet: three in 2D, four or five in 3D at order 1.

Source: Pop (1999), section 4.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from geometry.surfaces.search import pair
from geometry.surfaces.surface import Surface
from solvers.contact.coupling import Coupling, Points, between


def nodal_coupling(slave: Surface, master: Surface, reach: float) -> Coupling:
    """Everything lives at the slave's nodes, with their own weights; a node that meets no facet carries nothing."""
    along = slave.node_normals()
    found = pair(slave.points, along, master, reach)
    partners = found.weights(master)
    missed = (found.facet < 0).astype(float)
    met = abs(slave.transform) @ missed == 0  # a coefficient of phi~ may need several nodes
    weights = np.where(met, slave.node_weights(), 0.0)
    relative = sparse.hstack([slave.transform, -(slave.transform @ partners)], format="csr")
    gap = np.where(met, slave.transform @ np.where(missed, 0.0, found.gap), 0.0)
    normals, gap = between(along, partners @ master.node_normals(), gap)

    def points(degree: int) -> Points:
        """The nodes that meet a facet, whatever the degree."""
        psi = sparse.diags(weights, format="csc")[:, met]
        return Points(weights[met], relative[met], gap[met], normals[met], psi.tocsr())

    return Coupling(slave, master, weights, relative, gap, normals, met, points)
