"""How much the surface of an anisotropic half-plane gives, by integrals of the stiffness over all directions.

A line load f on the half-plane moves its surface by -L^-1 f ln|x| / pi, and a part that is the same on either side of
the load. Isotropic, L^-1 is 2 (1 - nu²) / E along the normal and along the surface.

Source: Barnett & Lothe, Phys. Norvegica 7 (1973); Ting, Anisotropic Elasticity (1996), sections 7.3 to 7.6 and 8.5.
"""

from __future__ import annotations

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.scene.orthotropic import Orthotropic

DIRECTIONS = 64  # of the trapezoidal rule over half a turn, which converges geometrically
MOST = 8  # normals of which the mean is taken


def surface_compliance(C: Array, along: Array, normal: Array) -> Array:
    """L^-1 (d, d) [1/Pa] of the half-plane of a stiffness C (d, d, d, d) [Pa] with two directions (d,)."""
    L = np.zeros((len(normal), len(normal)))
    for angle in np.arange(DIRECTIONS) * np.pi / DIRECTIONS:
        m, n = np.cos(angle) * along + np.sin(angle) * normal, np.cos(angle) * normal - np.sin(angle) * along
        Q, R, T = (np.einsum("ijkl,j,l->ik", C, a, b) for a, b in ((m, m), (m, n), (n, n)))
        L += (Q - R @ np.linalg.solve(T, R.T)) / DIRECTIONS
    return np.linalg.inv(L)


def mean_compliance(body: Orthotropic, normals: Array, plane_stress: bool) -> float:
    """One number for all sides of a body [1/Pa]: isotropic it would be 2 (1 - nu²) / E, in plane stress 2 / E.

    The mean over some of the normals (m, d), and in 3D over two directions of the surface, of the geometric mean of
    what the surface gives along the normal and along that direction.
    """
    d = normals.shape[1]
    C = body.tensor_in(plane_stress)[:d, :d, :d, :d]
    found = []
    for normal in normals[:: max(1, len(normals) // MOST)]:
        for along in np.linalg.svd(normal[None])[2][1:]:  # across the normal: one direction in 2D, two in 3D
            compliance = surface_compliance(C, along, normal)
            frame = np.array([along, normal])
            found.append(np.sqrt(np.linalg.det(frame @ compliance @ frame.T)))
    return float(np.mean(found))
