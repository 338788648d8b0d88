"""Metrics of the contact surface: an approximation of the bodies' flexibility that learns from measured answers.

The first guess is a boundary operator of order -1, spectrally equivalent to the Delassus operator, that needs no volume
solve. Secant (quasi-Newton, block DFP) updates make it exact for the forces whose displacements are known.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc
from scipy import sparse
from scipy.linalg import cholesky, solve_triangular

from stickslip.geometry.arrays import EXACT, Array, Ints
from stickslip.geometry.mesh.ranks import of_all_ranks
from stickslip.geometry.protocols import Comm, Sparse
from stickslip.geometry.surfaces.surface import Surface, lumped_mass, surface_stiffness
from stickslip.solvers.linear.cholesky import InverseRoot, SparseCholesky
from stickslip.solvers.parallel.serialise import Plain
from stickslip.solvers.scene.material import Material, Orthotropic
from stickslip.solvers.system.system import System, contact_sides

DIRECTIONS = 64  # of the trapezoidal rule over half a turn, which converges geometrically


def surface_compliance(C: Array, along: Array, normal: Array) -> Array:
    """L^-1 (d, d) [1/Pa] of the half-plane of a stiffness C (d, d, d, d) [Pa] with two directions (d,).

    A line load f on the half-plane moves its surface by -L^-1 f ln|x| / pi, and a part that is the same on either side
    of the load. Isotropic, L^-1 is 2 (1 - nu²) / E along the normal and along the surface.

    Source: Barnett & Lothe, Phys. Norvegica 7 (1973); Ting, Anisotropic Elasticity (1996), 7.3 to 7.6 and 8.5.
    """
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
    for normal in normals[:: max(1, len(normals) // 8)]:  # about as many
        for along in np.linalg.svd(normal[None])[2][1:]:  # across the normal: one direction in 2D, two in 3D
            compliance = surface_compliance(C, along, normal)
            frame = np.array([along, normal])
            found.append(np.sqrt(np.linalg.det(frame @ compliance @ frame.T)))
    return float(np.mean(found))


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
            springs[self._at] = 1e-2 * K.diagonal()[self._at]  # the layer may be the whole of a floating body
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
    cut = CELLS * system.mesh.degree * mass ** (1 / (d - 1))
    layer = None if d == 2 else ContactLayer(system, CELLS)  # in 2D the formula alone is as good
    depth, compliance = depth / mass, compliance / mass
    return SurfaceMetric(
        L=L, mass=mass, depth=depth, compliance=compliance, layer=layer, cut=cut, comm=system.mesh.comm
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


SHARED = 5000  # rows; with fewer, messages cost more than they save, and every rank has all rows


class Shares:
    """This rank's share of n rows. `own` is the slice of its rows; all other calls are collective.

    >>> from mpi4py import MPI
    >>> Shares(MPI.COMM_SELF, 3).own
    slice(0, 3, None)
    """

    def __init__(self, comm: Comm, rows: int) -> None:
        self._comm = comm if comm.size > 1 and rows >= SHARED else None
        ends = [0, rows] if self._comm is None else (rows * np.arange(comm.size + 1) // comm.size).tolist()
        rank = 0 if self._comm is None else comm.rank
        self.own = slice(ends[rank], ends[rank + 1])

    def sum(self, value: Array) -> Array:
        """Sum over the shares, the same on every rank."""
        return value if self._comm is None else self._comm.allreduce(value)

    def whole(self, own: Array) -> Array:
        """The rows (n, ...) of all shares on every rank, from this rank's."""
        return own if self._comm is None else of_all_ranks(self._comm, own)


class Secants:
    """The block DFP update of a guess F by pairs of forces S (c, s) and measured displacements Y (c, s):

        F+ = F - F S (S^T F S)^-1 S^T F + Y (S^T Y)^-1 Y^T,

    positive definite with F+ S = Y (the secant equations), for every positive definite F. Pairs that depend on the
    others are left out. Inexact volume solves make S^T Y asymmetric; the independent part must exceed three times
    that asymmetry.

    Each rank stores its share of the rows of all pairs, see `Shares`: all calls are collective, with the same arguments
    on every rank.

    Source: Schnabel, Quasi-Newton methods using multiple secant equations, Univ. Colorado CU-CS-247-83 (1983).
    """

    def __init__(
        self, guess: Callable[[Array], Array], forces: Array, displacements: Array, comm: Comm = MPI.COMM_SELF
    ) -> None:
        """
        Args:
            guess: F, symmetric and positive definite; takes forces (c,) or (c, k) [N] to displacements [m].
            forces, displacements: independent pairs (c, s) [N], [m] that are known from the start and never dropped.
            comm: the ranks that share the pairs.
        """
        self.guess, self._sure, self._shares = guess, forces.shape[1], Shares(comm, len(forces))
        own = self._shares.own
        self._S, self._Y = np.ascontiguousarray(forces[own]), np.ascontiguousarray(displacements[own])
        self._guessed = np.ascontiguousarray(guess(forces)[own])
        self._prepare()

    @property
    def count(self) -> int:
        """Number s of pairs in use."""
        return int(self._S.shape[1])

    def learn(self, force: Array, displacement: Array) -> None:
        """Add a pair: a force (c,) [N] and the displacement (c,) [m] that a volume solve gave for it."""
        size = np.sqrt(max(float(force @ displacement), 0.0))
        if not (size > 0 and np.isfinite(size)):  # no work, or less than the error of the solve, or NaN
            return
        known = self._S, self._Y, self._guessed
        try:
            self._take(force / size, displacement / size)
        except np.linalg.LinAlgError:  # its independent part is rounding: go on without it
            self._S, self._Y, self._guessed = known

    def _take(self, force: Array, displacement: Array) -> None:
        """Add a pair of unit work; drop the oldest of more than a hundred, and those that depend on the others.

        Raises:
            LinAlgError: the work matrix S^T Y is not positive definite.
        """
        if self.count == self._sure + 100:
            self._keep(np.delete(np.arange(self.count), self._sure))
        own = self._shares.own
        self._S = np.column_stack([self._S, force[own]])
        self._Y = np.column_stack([self._Y, displacement[own]])
        self._guessed = np.column_stack([self._guessed, self.guess(force)[own]])
        work = self._shares.sum(self._S.T @ self._Y)
        noise = float(np.abs(work - work.T)[self._sure :, self._sure :].max(initial=0.0))
        # least part of a pair's work that must be independent of the others, if volume solves are exact
        self._keep(_independent((work + work.T) / 2, self._sure, max(EXACT, 3 * noise)))
        self._prepare()

    def _keep(self, chosen: Ints) -> None:
        # contiguous in C order, as after reading from a file: rounding depends on it
        self._S, self._Y, self._guessed = (
            np.ascontiguousarray(pairs[:, chosen]) for pairs in (self._S, self._Y, self._guessed)
        )

    def snapshot(self) -> dict[str, Plain]:
        """All pairs, this rank's share of their rows; see `restore`."""
        return {"forces": self._S, "displacements": self._Y, "guessed": self._guessed}

    def restore(self, snapshot: dict[str, Plain]) -> None:
        """Take the pairs of a `snapshot` of an object with the same guess, instead of those given at the start."""
        self._S, self._Y, self._guessed = snapshot["forces"], snapshot["displacements"], snapshot["guessed"]
        self._prepare()

    def _prepare(self) -> None:
        measured, guessed = self._shares.sum(np.array([self._S.T @ self._Y, self._S.T @ self._guessed]))
        self.more, self.less = _root(self._Y, measured), _root(self._guessed, guessed)

    def __call__(self, force: Array) -> Array:
        """Displacement F+ f [m] of forces f (c,) or (c, k) [N], with F+ = F + more more^T - less less^T."""
        own = self._shares.own
        amounts = self._shares.sum(np.array([self.more.T @ force[own], self.less.T @ force[own]]))
        return self._shares.whole(self.guess(force)[own] + self.more @ amounts[0] - self.less @ amounts[1])


def _root(Z: Array, work: Array) -> Array:
    """Z L^-T (c, s) with work = L L^T, so that its product with its transpose is Z work^-1 Z^T."""
    if not len(work):
        return Z
    return np.asarray(solve_triangular(cholesky((work + work.T) / 2, lower=True), Z.T, lower=True).T)


def _independent(work: Array, sure: int, least: float) -> Ints:
    """Independent pairs, chosen by a pivoted Cholesky factorisation: next the pair most independent of those chosen.

    Args:
        work: (s, s) symmetric.
        sure: number of pairs, the first ones, that are always chosen.
        least: smallest part of a pair's work that must be independent of the others.

    Returns:
        Indices of the chosen pairs, increasing.
    """
    left, scale = work.copy(), np.diag(work).copy()
    chosen: list[int] = []
    for k in range(len(work)):
        new = np.diag(left) / scale
        new[chosen] = -np.inf
        at = k if k < sure else int(np.argmax(new))
        if k >= sure and new[at] <= least:
            break
        left -= np.outer(left[at], left[at]) / left[at, at]
        chosen.append(at)
    return np.sort(np.array(chosen, np.int64))
