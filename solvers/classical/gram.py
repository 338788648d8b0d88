"""The published preconditioner: a Gram matrix of H1, factorised (complete or incomplete), as a metric of tractions.

Source: Pop (1999), (5.6) and (5.7).
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc
from scipy import sparse
from scipy.linalg import eigvalsh
from scipy.sparse.csgraph import dijkstra

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array, Bools, Ints
from stickslip.geometry.protocols import Mat, Sparse
from stickslip.geometry.surfaces.surface import consistent_mass, surface_stiffness
from stickslip.solvers.classical.incomplete_cholesky import incomplete_cholesky
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.interface.flexibility import DelassusOperator
from stickslip.solvers.interface.prepare import condensed
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.metrics.dense import DenseMetric, inverse_root
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.scene.gram import Gram
from stickslip.solvers.system.stiffness import Stiffness
from stickslip.solvers.system.system import System


class GramMetric:
    """The metric Q of a scene, assembled once for all steps; `on` gives it on the rows of a surface problem."""

    def __init__(self, system: System, gram: Gram) -> None:
        """Assemble and factorise the Gram matrix; collective.

        Args:
            system: the assembled scene.
            gram: which Gram matrix, and how it is factorised.
        """
        self.gram, self.length = gram, gram.length or system.extent
        self._compliance = None if gram.space == "multiplier" else np.linalg.inv(volume_block(system, gram))
        self._last: dict[tuple[DelassusOperator, float], DenseMetric] = {}

    def on(self, problem: SurfaceProblem, relaxation: float) -> DenseMetric:
        """Q / alpha with alpha = relaxation / lambda_max(Q^-1 B K_B^-1 B^T)."""
        surface, carrying = problem.surface, problem.cone.carrying
        key = surface, relaxation
        if key not in self._last:
            self._last.clear()  # those of other contact pairs are not needed again
            Q = self.on_tractions(surface, problem.cone)
            root = inverse_root(Q[np.ix_(carrying, carrying)])
            largest = self._spectrum(surface, carrying, root).max(initial=0.0) or 1.0
            self._last[key] = DenseMetric(
                surface=surface, Q=Q, carrying=carrying, root=root, alpha=relaxation / float(largest)
            )
        return self._last[key]

    def on_tractions(self, surface: DelassusOperator, cone: AdmissibleSet) -> Array:
        """Q (rows, rows) of p^T Q p for tractions p: the published matrix if it belongs to tractions, else W Q W."""
        if self._compliance is None:
            Q = multiplier_gram(cone, self.length).toarray()
            Q = Q if self.gram.factor == "complete" else incomplete_cholesky(Q, drop_of(self.gram)).trailing(len(Q))
        else:
            Q = surface.N @ self._compliance @ surface.N.T
        return np.asarray(surface.W[:, None] * Q * surface.W if self.gram.unknown == "forces" else Q)

    def spectrum(self, surface: DelassusOperator, cone: AdmissibleSet) -> Array:
        """Eigenvalues of Q^-1 B K_B^-1 B^T, the preconditioned Delassus operator, on the rows that carry tractions.

        Returns:
            (rows,) increasing; of as many as Q has rank.
        """
        on = cone.carrying
        return self._spectrum(surface, on, inverse_root(self.on_tractions(surface, cone)[np.ix_(on, on)]))

    def _spectrum(self, surface: DelassusOperator, on: Bools, root: Array) -> Array:
        B = surface.N[on].T.multiply(surface.W[on]) @ root  # forces on the contact dofs (c, r)
        return np.asarray(eigvalsh(B.T @ (condensed(surface).flexibility @ B)))


def drop_of(gram: Gram) -> float | None:
    """The tolerance `drop` of `incomplete_cholesky`."""
    return {"complete": 0.0, "drop": gram.drop, "ic0": None}[gram.factor]


def volume_block(system: System, gram: Gram) -> Array:
    """Q^-1 on forces (c, c): P_cc P_cc^T of the Gram matrix of displacements, contact dofs last; collective.

    For the complete factor that is the Schur complement, an operator of order 1 like the inverse of the Delassus
    operator B K_B^-1 B^T: the reading of the source that can be independent of the mesh size h.
    """
    matrix, contact = volume_gram(system, gram.length or system.extent), system.interface.dofs
    if gram.factor == "complete" and len(contact):
        return np.asarray(FactorisedVolume(matrix, contact, Counters()).S)
    whole, _ = contact_last(matrix, contact)
    return incomplete_cholesky(whole, drop_of(gram)).trailing(len(contact))


def volume_gram(system: System, length: float) -> Mat:
    """H1 Gram matrix of the basis of free displacements; collective.

    Args:
        system: the assembled scene.
        length: [m], weighs the L2 part by 1 / length².
    """
    weak = system.weak
    gram = dx.assemble_matrix(weak.compile(weak.gram(length)))
    return Stiffness.of(gram, system.T, system.constraints).free


def contact_last(matrix: Mat, contact: Ints) -> tuple[Sparse, Ints]:
    """A distributed matrix as a whole on every rank, reordered so that the contact dofs come last.

    The order is by distance from the contact dofs, counted in entries of the matrix, the farthest first: an incomplete
    factor then has the smallest error at the contact dofs.

    Args:
        matrix: (n, n).
        contact: numbers (c,) of the contact dofs.

    Returns:
        The reordered matrix (n, n), and the order (n,).
    """
    every = PETSc.IS().createStride(matrix.size[0], step=1, comm=PETSc.COMM_SELF)
    (whole,) = matrix.createSubMatrices([every], [every])
    indptr, indices, data = whole.getValuesCSR()
    A: Sparse = sparse.csr_matrix((data, indices, indptr), shape=whole.getSize())
    if not len(contact):
        return A, np.arange(A.shape[0])
    away = dijkstra(abs(A), directed=False, indices=contact, unweighted=True, min_only=True)
    away[contact] = -1.0
    order = np.argsort(-away, kind="stable")
    return A[order][:, order], order


def multiplier_gram(cone: AdmissibleSet, length: float) -> Sparse:
    """H1 Gram matrix (rows, rows) of the traces of the displacement basis at the multiplier nodes.

    The dual basis of the multipliers is discontinuous and not in H1: the displacement basis at its nodes is used.

    Args:
        cone: the contacts.
        length: [m], weighs the L2 part by 1 / length².
    """
    normal = [_side_gram(c, c.psi.multiply(1 / _positive(c.node_weights)[:, None]).T, length) for c in cone.contacts]
    tangential = [
        sparse.kron(_side_gram(c, c.share_t, length), sparse.eye(c.free.shape[1])) for c in cone.contacts
    ]  # fmt: skip
    gram: Sparse = sparse.block_diag([*normal, *tangential], format="csr")
    return gram


def _side_gram(c: ContactRows, share: Sparse, length: float) -> Sparse:
    """Gram matrix (m, m) of one contact's points; `share` (m, n) are the nodes that each stands for."""
    side = c.surface
    product = surface_stiffness(side) + consistent_mass(side) / length**2
    basis = share @ side.forces_transform
    gram: Sparse = basis @ product @ basis.T
    return gram


def _positive(weights: Array) -> Array:
    return np.where(weights > 0, weights, 1.0)
