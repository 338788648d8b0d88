"""Node-to-segment (2D) and node-to-face (3D) contact: each slave node is paired with the master facet along its normal.

A contact element is a slave node with the nodes of that facet: three in 2D, four or five in 3D at order 1.

Source: Pop (1999), section 4.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Bools
from stickslip.geometry.surfaces.search import pair
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.contact.coupling import Coupling, On, Points, midway_normals


def nodal_coupling(slave: Surface, master: Surface, reach: float) -> Coupling:
    """Coupling at the slave's nodes, with their own weights; a node that meets no facet carries no multiplier.

    Args:
        slave, master: the two surfaces.
        reach: farthest gap [m] across which a facet is looked for.
    """
    along = slave.node_normals()
    found = pair(slave.points, along, master, reach)
    partners = found.weights(master)
    missed = (found.facet < 0).astype(float)
    met = abs(slave.transform) @ missed == 0  # a coefficient of phi~ may need several nodes
    weights = np.where(met, slave.node_weights(), 0.0)
    relative = sparse.hstack([slave.transform, -(slave.transform @ partners)], format="csr")
    gap = np.where(met, slave.transform @ np.where(missed, 0.0, found.gap), 0.0)
    normals, gap = midway_normals(along, partners @ master.node_normals(), gap)

    def points(degree: int) -> Points:
        """The nodes that meet a facet, for every degree."""
        psi = sparse.diags(weights, format="csc")[:, met]
        return Points(
            weights=weights[met],
            relative=relative[met],
            gap=gap[met],
            normals=normals[met],
            psi=psi.tocsr(),
            phi=psi.tocsr(),
            own=_on_nodes(slave, met),
            other=On(found.facet[met], found.local[met]),
        )

    return Coupling(
        surface=slave,
        master=master,
        weights=weights,
        relative=relative,
        gap=gap,
        normals=normals,
        carries=met,
        points=points,
    )


def _on_nodes(surface: Surface, chosen: Bools) -> On:
    """Chosen nodes (n,) of a surface as points of it, each on the first facet that has it."""
    k = surface.facets.shape[1]
    at = np.unique(surface.facets.ravel(), return_index=True)[1][chosen]
    return On(at // k, dx.reference_nodes(surface.shape, surface.degree)[at % k])
