"""Contact with a rigid obstacle: dual (biorthogonal) multipliers at nodes, compliance pressure at quadrature points.

With the dual basis the weighted gap of a node is the gap at that node (in the basis phi~ of `Surface`), so its row is
its displacement in the local frame.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from geometry.obstacles import Obstacle
from geometry.surfaces.surface import Surface
from solvers.contact.coupling import Coupling, Points


def rigid_coupling(surface: Surface, obstacle: Obstacle) -> Coupling:
    """Coupling of a surface with a shape that is given by a formula and has no mesh."""
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
    """The quadrature points of the facets: with them the rows give exactly the form j_n."""
    weights, basis = surface.quadrature(degree)
    dual = surface.dual_basis(degree)
    (f, q), k, n = weights.shape, surface.facets.shape[1], len(surface.points)
    row = np.repeat(np.arange(f * q), k)
    node = np.repeat(surface.facets[:, None, :], q, axis=1).ravel()
    relative = sparse.csr_matrix((np.broadcast_to(basis, (f, q, k)).ravel(), (row, node)), shape=(f * q, n))
    psi = sparse.csr_matrix(((dual * weights[:, :, None]).ravel(), (node, row)), shape=(n, f * q))
    x = relative @ surface.points
    return Points(
        weights=weights.ravel(),
        relative=relative,
        gap=obstacle.signed_gap(x),
        normals=-obstacle.normals(x),
        psi=psi,
    )
