"""What bodies give at their contact sides, to within constants free of mesh size: no volume solve is needed."""

from __future__ import annotations

from typing import Any

import numpy as np
from petsc4py import PETSc
from scipy import sparse

from geometry.arrays import Array
from geometry.surfaces.forms import surface_mass, surface_stiffness
from geometry.surfaces.surface import Surface
from solvers.linear.cholesky import SparseCholesky
from solvers.linear.inverse_root import InverseRoot
from solvers.system.sides import contact_sides
from solvers.system.system import System

BED = 1e-2  # of the stiffness of a contact dof: springs in case that the layer is the whole of a body that floats


class ContactLayer:
    """Displacement of the contact dofs that forces there cause in the layer alone, a lower bound of the bodies' own.

    Corners and edges of the sides, graded cells, the normal displacement of tangential forces: all that happens within
    a few cells is in it. Every rank has the whole layer.
    """

    def __init__(self, system: System, cells: int) -> None:
        """Cut it out and factorise it; collective.

        Args:
            cells: how many of them one below the other.
        """
        contact = np.asarray(system.contact_dofs, PETSc.IntType)
        layer = PETSc.IS().createGeneral(contact, comm=PETSc.COMM_SELF)
        system.K_B.increaseOverlap(layer, cells)
        layer.sort()
        (cut,) = system.K_B.createSubMatrices([layer], [layer])
        indptr, indices, data = cut.getValuesCSR()
        self._at = np.searchsorted(layer.getIndices(), contact)
        K = sparse.csr_matrix((data, indices, indptr), shape=cut.getSize())
        springs = np.zeros(K.shape[0])
        if len(springs) and system.rigid_modes.shape[1]:
            springs[self._at] = BED * K.diagonal()[self._at]
        self._factor = SparseCholesky(K + sparse.diags(springs))
        self._size = K.shape[0]

    def __call__(self, force: Array) -> Array:
        """Displacement [m] under forces (c,) or (c, k) [N]."""
        whole = np.zeros((self._size, *force.shape[1:]))
        whole[self._at] = force
        return self._factor.solve(whole)[self._at]


CELLS = 2  # of the layer next to the contact sides, in space
NONE = np.zeros(0)


class SurfaceMetric:
    """F = C^(1/2) M^(-1/2) (M^(-1/2) L M^(-1/2) + H^-2)^(-1/2) M^(-1/2) C^(1/2) on the contact dofs [m/N].

    L and M are the Laplace-Beltrami operator and the lumped mass of all sides that contacts name, as one surface, on
    each component of displacement; C = 2 (1 - nu^2) / E, the half-plane's; H the depth of the body below the side.
    A force of wave length l << H then gives way over l, as on a half-space, a longer one over H. Dofs that supports
    hold are left out of L and M: the displacement goes to zero there.
    """

    def __init__(
        self, L: Any, mass: Array, depth: Array, compliance: Array, layer: ContactLayer | None = None, cut: Array = NONE
    ) -> None:
        """
        Args:
            L: (c, c) sparse [N/m for a unit stress].
            mass: (c,) [m^(d-1)].
            depth: (c,) [m].
            compliance: C (c,) [1/Pa].
            layer: what the bodies give down to the depth `cut` (c,) [m]; the same formula for both depths says how
                much more they give below. Without it the formula stands alone.
        """
        scale = sparse.diags(1 / np.sqrt(mass))
        self.compliance, self._outer = compliance, np.sqrt(compliance / mass)
        inner = sparse.csr_matrix(scale @ L @ scale)
        self._A = inner + sparse.diags(depth**-2)
        self._root = InverseRoot(self._A, float(np.min(depth**-2, initial=np.inf)))
        self._layer = layer
        if layer is not None:
            cut = np.minimum(cut, depth)
            self._above = InverseRoot(inner + sparse.diags(cut**-2), float(np.min(cut**-2, initial=np.inf)))

    @property
    def size(self) -> int:
        """c, without driven obstacles."""
        return len(self._outer)

    def __call__(self, force: Array) -> Array:
        """Displacement [m] under forces (c,) or (c, k) [N]."""
        outer = self._outer.reshape(-1, *[1] * (force.ndim - 1))
        x = outer * force
        if self._layer is None:
            return np.asarray(outer * self._root(x))
        return np.asarray(self._layer(force) + outer * (self._root(x) - self._above(x)))

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
    L, sums = sparse.csr_matrix((c, c)), np.zeros((3, c))
    for name, side, onto in contact_sides(system):
        mass, (depth, compliance) = surface_mass(side), _depth_and_compliance(system, name, side)
        L = L + onto.T @ sparse.kron(surface_stiffness(side), sparse.eye(d)) @ onto
        sums += np.array([1.0, depth, compliance])[:, None] * (onto.multiply(onto).T @ np.repeat(mass, d))
    mass, depth, compliance = sums  # where sides of different bodies share nodes: their mean
    if d == 2:  # there the formula alone is as good
        return SurfaceMetric(L, mass, depth / mass, compliance / mass)
    cut = CELLS * system.mesh.degree * mass ** (1 / (d - 1))
    return SurfaceMetric(L, mass, depth / mass, compliance / mass, ContactLayer(system, CELLS), cut)


def _depth_and_compliance(system: System, side: str, surface: Surface) -> tuple[float, float]:
    """H [m], the body's extent along the side's normals, and C [1/Pa]."""
    body = side.split(".")[0]
    material, (low, high) = system.problem.bodies[body], system.mesh.body_box(body)
    contraction = 0.0 if system.problem.model == "plane stress" else material.nu**2
    depth = float(np.abs(surface.node_normals()).mean(axis=0) @ (high - low))
    return depth, 2 * (1 - contraction) / material.E
