"""What bodies give at their contact sides, to within constants free of mesh size: no volume solve is needed."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from geometry.surface import Surface
from geometry.surface_forms import surface_mass, surface_stiffness
from solvers.inverse_root import InverseRoot
from solvers.system import System

Array = NDArray[np.float64]


class SurfaceMetric:
    """F = C^(1/2) M^(-1/2) (M^(-1/2) L M^(-1/2) + H^-2)^(-1/2) M^(-1/2) C^(1/2) on the contact dofs [m/N].

    L and M are the Laplace-Beltrami operator and the lumped mass of all sides that contacts name, as one surface, on
    each component of displacement; C = 2 (1 - nu^2) / E, the half-plane's; H the depth of the body below the side.
    A force of wave length l << H then gives way over l, as on a half-space, a longer one over H. Dofs that supports
    hold are left out of L and M: the displacement goes to zero there.
    """

    def __init__(self, L: Any, mass: Array, depth: Array, compliance: Array) -> None:
        """
        Args:
            L: (c, c) sparse [N/m for a unit stress].
            mass: (c,) [m^(d-1)].
            depth: (c,) [m].
            compliance: C (c,) [1/Pa].
        """
        scale = sparse.diags(1 / np.sqrt(mass))
        self.compliance, self._outer = compliance, np.sqrt(compliance / mass)
        self._A = sparse.csr_matrix(scale @ L @ scale + sparse.diags(depth**-2))
        self._root = InverseRoot(self._A, float(np.min(depth**-2, initial=np.inf)))

    @property
    def size(self) -> int:
        """c, without driven obstacles."""
        return len(self._outer)

    def __call__(self, force: Array) -> Array:
        """Displacement [m] under forces (c,) or (c, k) [N]."""
        outer = self._outer.reshape(-1, *[1] * (force.ndim - 1))
        return np.asarray(outer * self._root(outer * force))

    @property
    def diagonal(self) -> Array:
        """About that of F (c,) [m/N]."""
        return np.asarray(self._outer**2 / np.sqrt(self._A.diagonal()))

    def stiffness(self, displacement: Array) -> Array:
        """Forces (c,) [N] that cause it: F^-1."""
        return np.asarray(self._A @ self._root(displacement / self._outer) / self._outer)


def surface_metric(system: System) -> SurfaceMetric:
    """The metric of a scene's contact sides."""
    c, d = len(system.contact_dofs), system.mesh.dim
    L, sums, seen = sparse.csr_matrix((c, c)), np.zeros((3, c)), set[str]()
    for rows in system.contacts:
        contact, trace = system.scene.contacts[rows.name], system.trace(rows)
        first = 0
        for name, side in ((contact.surface, rows.surface), (contact.against, rows.master)):
            if side is None or name in seen:
                first += len(side.nodes) if side else 0
                continue
            seen.add(name)
            onto = trace[d * first : d * (first + len(side.nodes))]
            first += len(side.nodes)
            mass, (depth, compliance) = surface_mass(side), _depth_and_compliance(system, name, side)
            L = L + onto.T @ sparse.kron(surface_stiffness(side), sparse.eye(d)) @ onto
            sums += np.array([1.0, depth, compliance])[:, None] * (onto.multiply(onto).T @ np.repeat(mass, d))
    mass, depth, compliance = sums  # where sides of different bodies share nodes: their mean
    return SurfaceMetric(L, mass, depth / mass, compliance / mass)


def _depth_and_compliance(system: System, side: str, surface: Surface) -> tuple[float, float]:
    """H [m], the body's extent along the side's normals, and C [1/Pa]."""
    body = side.split(".")[0]
    material, (low, high) = system.scene.bodies[body], system.mesh.body_box(body)
    contraction = 0.0 if system.scene.model == "plane stress" else material.nu**2
    depth = float(np.abs(surface.node_normals()).mean(axis=0) @ (high - low))
    return depth, 2 * (1 - contraction) / material.E
