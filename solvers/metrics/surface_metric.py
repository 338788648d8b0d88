"""A boundary operator of order -1, spectrally equivalent to the Delassus operator, that needs no volume solve."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy import sparse

from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Comm, Sparse
from stickslip.geometry.surfaces.surface import Surface, lumped_mass, surface_stiffness
from stickslip.solvers.linear.cholesky import SparseCholesky
from stickslip.solvers.linear.inverse_root import InverseRoot
from stickslip.solvers.metrics.half_plane import mean_compliance
from stickslip.solvers.scene.material import Material
from stickslip.solvers.scene.orthotropic import Orthotropic
from stickslip.solvers.system.sides import contact_sides
from stickslip.solvers.system.system import System

BED = 1e-2  # of the stiffness of a contact dof: springs, for a layer that is the whole of a floating body


class ContactLayer:
    """Flexibility of the layer of cells next to the contact dofs, held at its inner boundary: a lower bound of K_B^-1.

    It contains the effects of the nearest few cells: corners and edges of the sides, graded cells, the normal
    displacement of tangential forces. Every rank has the whole layer.
    """

    def __init__(self, system: System, cells: int) -> None:
        """Cut the layer out of K_B and factorise it; collective.

        Args:
            system: the assembled scene.
            cells: thickness of the layer, in cells.
        """
        contact = np.asarray(system.interface.dofs, PETSc.IntType)
        layer = PETSc.IS().createGeneral(contact, comm=PETSc.COMM_SELF)
        system.K_B.increaseOverlap(layer, cells)
        layer.sort()
        (cut,) = system.K_B.createSubMatrices([layer], [layer])
        indptr, indices, data = cut.getValuesCSR()
        self._at = np.searchsorted(layer.getIndices(), contact)
        K = sparse.csr_matrix((data, indices, indptr), shape=cut.getSize())
        springs = np.zeros(K.shape[0])
        if len(springs) and system.interface.rigid_modes.shape[1]:
            springs[self._at] = BED * K.diagonal()[self._at]
        self._factor = SparseCholesky(K + sparse.diags(springs))
        self._size = K.shape[0]

    def __call__(self, force: Array) -> Array:
        """Displacement [m] of the contact dofs under forces (c,) or (c, k) [N]."""
        whole = np.zeros((self._size, *force.shape[1:]))
        whole[self._at] = force
        return self._factor.solve(whole)[self._at]


CELLS = 2  # thickness of the layer next to the contact sides, in 3D
EMPTY = np.zeros(0)


class SurfaceMetric:
    """F = C^(1/2) M^(-1/2) (M^(-1/2) L M^(-1/2) + H^-2)^(-1/2) M^(-1/2) C^(1/2) on the contact dofs [m/N].

    An approximate inverse of the Steklov-Poincaré operator. L and M are the Laplace-Beltrami operator and the lumped
    mass of all contact sides, as one surface, on each component of displacement; C = 2 (1 - nu^2) / E, the
    compliance of the half-plane (of orthotropic bodies see `mean_compliance`); H the depth of the body below the
    side. A force of wave length l << H is then resisted over the depth l, as on a half-space, a longer one over H. Dofs
    that supports hold are left out of L and M: the displacement is zero there.
    """

    def __init__(
        self,
        *,
        L: Sparse,
        mass: Array,
        depth: Array,
        compliance: Array,
        layer: ContactLayer | None = None,
        cut: Array = EMPTY,
        comm: Comm = MPI.COMM_SELF,
    ) -> None:
        """
        Args:
            L: (c, c) [N/m for a unit stress].
            mass: M (c,) [m^(d-1)].
            depth: H (c,) [m].
            compliance: C (c,) [1/Pa].
            layer: flexibility of the bodies down to the depth `cut`; the formula for the depth H minus that for `cut`
                adds the part below. Without a layer the formula stands alone.
            cut: (c,) [m], depth of the layer.
            comm: the ranks of the bodies, which share what is learnt of them.
        """
        self.comm = comm
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
        """Number c of contact dofs, without those of driven obstacles."""
        return len(self._outer)

    def __call__(self, force: Array) -> Array:
        """Displacement [m] of the contact dofs under forces (c,) or (c, k) [N]."""
        outer = self._outer.reshape(-1, *[1] * (force.ndim - 1))
        x = outer * force
        if self._layer is None:
            return np.asarray(outer * self._root(x))
        return np.asarray(self._layer(force) + outer * (self._root(x) - self._above(x)))

    @property
    def diagonal(self) -> Array:
        """Approximate diagonal of F (c,) [m/N]."""
        return np.asarray(self._outer**2 / np.sqrt(self._A.diagonal()))

    def stiffness(self, displacement: Array) -> Array:
        """Forces (c,) [N] that cause a displacement (c,) [m]: F^-1 of the formula, without the layer."""
        return np.asarray(self._A @ self._root(displacement / self._outer) / self._outer)


def surface_metric(system: System) -> SurfaceMetric:
    """The metric of a scene's contact sides; collective."""
    c, d = len(system.interface.dofs), system.mesh.dim
    L, sums = sparse.csr_matrix((c, c)), np.zeros((3, c))
    for name, side, onto in contact_sides(system):
        mass, (depth, compliance) = lumped_mass(side), _depth_and_compliance(system, name, side)
        L = L + onto.T @ sparse.kron(surface_stiffness(side), sparse.eye(d)) @ onto
        sums += np.array([1.0, depth, compliance])[:, None] * (onto.multiply(onto).T @ np.repeat(mass, d))
    mass, depth, compliance = sums  # where sides of different bodies share nodes: sums, then their mean
    if d == 2:  # the formula alone is as good there
        return SurfaceMetric(L=L, mass=mass, depth=depth / mass, compliance=compliance / mass, comm=system.mesh.comm)
    cut = CELLS * system.mesh.degree * mass ** (1 / (d - 1))
    layer = ContactLayer(system, CELLS)
    return SurfaceMetric(
        L=L,
        mass=mass,
        depth=depth / mass,
        compliance=compliance / mass,
        layer=layer,
        cut=cut,
        comm=system.mesh.comm,
    )


def _depth_and_compliance(system: System, side: str, surface: Surface) -> tuple[float, float]:
    """Depth H [m], the body's extent along the mean normal of the side, and compliance C [1/Pa]."""
    body = side.split(".")[0]
    material, (low, high) = system.problem.bodies[body], system.mesh.body_box(body)
    plane_stress = system.problem.model == "plane stress"
    normals = surface.node_normals()
    depth = float(np.abs(normals).mean(axis=0) @ (high - low))
    if isinstance(material, Orthotropic):
        return depth, mean_compliance(material, normals, plane_stress)
    assert isinstance(material, Material)
    contraction = 0.0 if plane_stress else material.nu**2
    return depth, 2 * (1 - contraction) / material.E
