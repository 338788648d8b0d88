"""Coupling of a slave surface with what it may touch: weights, relative displacement, gap and normals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array, Bools, Ints
from stickslip.geometry.protocols import Sparse
from stickslip.geometry.surfaces.surface import Surface


@dataclass(frozen=True)
class On:
    """Where q points lie on a surface."""

    facet: Ints  # (q,) row of its facets
    local: Array  # (q, d-1) reference coordinates there

    def basis(self, surface: Surface) -> Sparse:
        """Values of the surface's basis functions at the points (q, n)."""
        values = dx.reference_basis(surface.shape, surface.degree, self.local)[0]
        row = np.repeat(np.arange(len(self.facet)), values.shape[1])
        entries = (values.ravel(), (row, surface.facets[self.facet].ravel()))
        found: Sparse = sparse.csr_matrix(entries, shape=(len(self.facet), len(surface.nodes)))
        return found


def relative_to(own: On, surface: Surface, other: On | None, master: Surface | None) -> Sparse:
    """Displacements of the nodes of both sides to relative displacement at q points (q, n + n_master)."""
    if other is None or master is None:
        return own.basis(surface)
    found: Sparse = sparse.hstack([own.basis(surface), -other.basis(master)], format="csr")
    return found


def shares(own: On, surface: Surface, weights: Array) -> Sparse:
    """Values of a field at q points to its integrals ∫ phi~_j (n, q), from the points' weights (q,) [m^(d-1)]."""
    found: Sparse = surface.forces_transform @ own.basis(surface).T @ sparse.diags(weights)
    return found.tocsr()


@dataclass(frozen=True, kw_only=True)
class Points:
    """The q integration points of the slave surface at which a compliance law gives pressure by displacement."""

    weights: Array  # (q,) [m^(d-1)]
    relative: Sparse  # (q, n + n_master): nodal displacements of both sides to relative displacement
    gap: Array  # (q,) [m], positive when open
    normals: Array  # (q, d) unit, towards the other side
    psi: Sparse  # (n, q): values of a field to its integrals ∫ psi_j, psi_j the dual basis, by slave node
    phi: Sparse  # (n, q): likewise to its integrals ∫ phi~_j, see `shares`
    own: On  # where they lie on the slave
    other: On | None  # the points that they face on the master; None: a rigid obstacle


@dataclass(frozen=True, kw_only=True)
class Coupling:
    """A slave surface of n nodes and a master of n_master (a rigid obstacle: 0), in the basis phi~ of `Surface`."""

    surface: Surface
    master: Surface | None  # None: a rigid obstacle
    weights: Array  # (n,) [m^(d-1)] ∫ phi~_j over the part that faces the other side, and shares of neighbours; >= 0
    relative: Sparse  # (n, n + n_master): nodal displacements of both sides to relative displacement
    gap: Array  # (n,) [m], positive when open
    normals: Array  # (n, d) unit, towards the other side, half way between both sides' own
    carries: Bools  # (n,) nodes with a multiplier of their own; the weight of the others goes to neighbours
    points: Callable[[int], Points]  # takes a quadrature degree


def midway_normals(own: Array, other: Array, gap: Array) -> tuple[Array, Array]:
    """Unit normals half way between those of two sides, and the gaps measured along them.

    Neither side is preferred: equal bodies pressed against each other do not shear where they touch.

    Args:
        own: unit normals of this side (m, d).
        other: unit normals of the other side, opposite each point (m, d); 0 where nothing faces the point.
        gap: gaps along `own` (m,) [m].

    Returns:
        Normals (m, d) and gaps (m,) [m].

    >>> tilted = np.array([[0.6, -0.8]])
    >>> normals, gap = midway_normals(tilted, np.array([[0.6, 0.8]]), np.array([0.5]))
    >>> normals.tolist(), gap.tolist()
    ([[0.0, -1.0]], [0.4])
    """
    normals = own - other
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return normals, gap * np.einsum("md,md->m", own, normals)
