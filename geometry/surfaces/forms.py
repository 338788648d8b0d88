"""Matrices of a scalar field on a side: Laplace-Beltrami stiffness, consistent mass and lumped mass."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Sparse
from stickslip.geometry.surfaces.surface import Surface


def surface_stiffness(surface: Surface) -> Sparse:
    """Laplace-Beltrami stiffness ∫ grad phi_i . grad phi_j ds (n, n) [m^(d-3)] of the nodal basis phi.

    grad is the gradient along the surface.
    """
    degree = 2 * surface.degree
    weights, _ = surface.quadrature(degree)
    points, _ = dx.reference_rule(surface.shape, degree)
    gradient = dx.reference_basis(surface.shape, surface.degree, points)[1]
    tangents = np.einsum("aqk,fki->fqai", gradient, surface.points[surface.facets])
    inverse = np.linalg.inv(tangents @ tangents.swapaxes(2, 3))  # of the first fundamental form
    return _assembled(surface, np.einsum("fq,aqi,fqab,bqj->fij", weights, gradient, inverse, gradient, optimize=True))


def consistent_mass(surface: Surface) -> Sparse:
    """Consistent mass ∫ phi_i phi_j ds (n, n) [m^(d-1)] of the nodal basis phi."""
    weights, basis = surface.quadrature(2 * surface.degree + surface.axisymmetric)
    return _assembled(surface, np.einsum("fq,qi,qj->fij", weights, basis, basis, optimize=True))


def _assembled(surface: Surface, local: Array) -> Sparse:
    """Sum (n, n) of the matrices of the facets (f, k, k)."""
    i = np.broadcast_to(surface.facets[:, :, None], local.shape)
    j = np.broadcast_to(surface.facets[:, None, :], local.shape)
    n = len(surface.nodes)
    matrix: Sparse = sparse.csr_matrix((local.ravel(), (i.ravel(), j.ravel())), shape=(n, n))
    return matrix


def lumped_mass(surface: Surface) -> Array:
    """Lumped mass (n,) [m^(d-1)] of the nodal basis, all positive: each facet's area in the ratio of its ∫ phi_i² ds.

    Source: Hinton, Rock & Zienkiewicz, Earthquake Eng. Struct. Dyn. 4 (1976).
    """
    weights, basis = surface.quadrature(2 * surface.degree + surface.axisymmetric)
    share = weights @ basis**2
    return surface.scatter(share * (weights.sum(axis=1) / share.sum(axis=1))[:, None])
