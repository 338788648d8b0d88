"""Contact with a rigid obstacle: biorthogonal multipliers at nodes, compliance pressure at quadrature points.

With the dual basis the weighted gap of a node is its own gap (in the basis phi~ of `Surface`), so a node's row is its
displacement in the local frame.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from geometry.obstacles import Obstacle
from geometry.surfaces.surface import Surface
from solvers.contact.coupling import Coupling, Points


def rigid_coupling(surface: Surface, obstacle: Obstacle) -> Coupling:
    """The surface against a shape that needs no mesh."""
    return Coupling(
        surface=surface,
        master=None,
        weights=surface.node_weights(),
        relative=surface.transform,
        gap=surface.transform @ obstacle.signed_gap(surface.points),
        normals=-obstacle.normals(surface.points),
        carries=np.ones(len(surface.points), bool),
        points=lambda degree: _points(surface, obstacle, degree),
    )


def _points(surface: Surface, obstacle: Obstacle, degree: int) -> Points:
    """Facet quadrature points: exactly the form j_n."""
    weights, basis = surface.quadrature(degree)
    dual = surface.dual_basis(degree)
    (f, q), k, n = weights.shape, surface.facets.shape[1], len(surface.points)
    row = np.repeat(np.arange(f * q), k)
    node = np.repeat(surface.facets[:, None, :], q, axis=1).ravel()
    relative = sparse.csr_matrix((np.broadcast_to(basis, (f, q, k)).ravel(), (row, node)), shape=(f * q, n))
    psi = sparse.csr_matrix(((dual * weights[:, :, None]).ravel(), (node, row)), shape=(n, f * q))
    x = relative @ surface.points
    return Points(weights.ravel(), relative, obstacle.signed_gap(x), -obstacle.normals(x), psi)
