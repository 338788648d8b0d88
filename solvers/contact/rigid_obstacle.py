"""Contact with a rigid obstacle: dual (biorthogonal) multipliers at nodes, compliance pressure at quadrature points.

With the dual basis the weighted gap of a node is the gap at that node (in the basis phi~ of `Surface`), so its row is
its displacement in the local frame.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import CLOSE, Array
from stickslip.geometry.errors import SceneError
from stickslip.geometry.obstacles import Obstacle
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.contact.coupling import Coupling, On, Points, shares


def rigid_coupling(surface: Surface, obstacle: Obstacle) -> Coupling:
    """Coupling of a surface with a shape that is given by a formula and has no mesh."""
    gap, normals = seen_from(obstacle, surface.points)
    return Coupling(
        surface=surface,
        master=None,
        weights=surface.node_weights(),
        relative=surface.transform,
        gap=surface.transform @ gap,
        normals=-normals,
        carries=np.ones(len(surface.points), bool),
        points=lambda degree: _points(surface, obstacle, degree),
    )


def seen_from(obstacle: Obstacle, points: Array) -> tuple[Array, Array]:
    """Distance (m,) [m] of points (m, d) from the obstacle, and unit normals (m, d) out of it.

    Raises:
        SceneError: its formulas give something else.
    """
    gap, normals = obstacle.signed_gap(points), obstacle.normals(points)
    long = np.linalg.norm(normals, axis=1)
    # by which a normal may be longer or shorter than 1
    wrong = np.flatnonzero(~np.isfinite(gap) | ~(np.abs(long - 1) < CLOSE))
    if len(wrong):
        k, kind = wrong[0], type(obstacle).__name__
        place = ", ".join(f"{x:g}" for x in points[k])
        raise SceneError(
            f"obstacle {kind}: at ({place}) its distance is {gap[k]:g} and its normal {long[k]:g} long; expected a "
            "number, and a unit vector"
        )
    return gap, normals


def _points(surface: Surface, obstacle: Obstacle, degree: int) -> Points:
    """The quadrature points of the facets: with them the rows give exactly the form j_n."""
    weights = surface.quadrature(degree)[0]
    dual = surface.dual_basis(degree)
    (f, q), k, n = weights.shape, surface.facets.shape[1], len(surface.points)
    row = np.repeat(np.arange(f * q), k)
    node = np.repeat(surface.facets[:, None, :], q, axis=1).ravel()
    own = On(np.repeat(np.arange(f), q), np.tile(dx.reference_rule(surface.shape, degree)[0], (f, 1)))
    relative = own.basis(surface)
    psi = sparse.csr_matrix(((dual * weights[:, :, None]).ravel(), (node, row)), shape=(n, f * q))
    gap, normals = seen_from(obstacle, relative @ surface.points)
    return Points(
        weights=weights.ravel(),
        relative=relative,
        gap=gap,
        normals=-normals,
        psi=psi,
        phi=shares(own, surface, weights.ravel()),
        own=own,
        other=None,
    )
