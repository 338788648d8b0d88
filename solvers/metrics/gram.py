"""The published preconditioner: a Gram matrix of H1, factorised, as a metric of contact forces or tractions."""

from __future__ import annotations

from typing import Any

import numpy as np
from petsc4py import PETSc
from scipy import sparse
from scipy.linalg import eigvalsh
from scipy.sparse.csgraph import dijkstra

from geometry import dolfinx_versions as dx
from geometry.arrays import Array, Bools, Ints
from geometry.surfaces.forms import surface_product, surface_stiffness
from solvers.contact.admissible_set import AdmissibleSet
from solvers.contact.rows import ContactRows
from solvers.interface.factorised import FactorisedVolume
from solvers.interface.flexibility import DelassusOperator
from solvers.interface.problem import SurfaceProblem
from solvers.interface.schur_complement import CondensedSurface
from solvers.linear.incomplete_cholesky import incomplete_cholesky
from solvers.metrics.dense import DenseMetric, inverse_root
from solvers.parallel.counters import Counters
from solvers.scene.gram import Gram
from solvers.system.system import System, free_stiffness


class GramMetric:
    """Q of a scene, once for all steps; on the rows of a surface problem, with the step that Uzawa's method takes."""

    def __init__(self, system: System, gram: Gram) -> None:
        """Assemble and factorise the Gram matrix; collective."""
        self.gram, self.length = gram, gram.length or system.extent
        self._compliance = None if gram.space == "multiplier" else np.linalg.inv(volume_block(system, gram))
        self._last: dict[tuple[DelassusOperator, float], DenseMetric] = {}

    def on(self, problem: SurfaceProblem, relaxation: float) -> DenseMetric:
        """Q / alpha with alpha = relaxation / lambda_max(Q^-1 B K_B^-1 B^T)."""
        surface, carrying = problem.surface, problem.cone.carrying
        key = surface, relaxation
        if key not in self._last:
            self._last.clear()  # of other pairs
            Q = self.on_tractions(surface, problem.cone)
            root = inverse_root(Q[np.ix_(carrying, carrying)])
            largest = self._spectrum(surface, carrying, root).max(initial=0.0) or 1.0
            self._last[key] = DenseMetric(surface, Q, carrying, root, relaxation / float(largest))
        return self._last[key]

    def on_tractions(self, surface: DelassusOperator, cone: AdmissibleSet) -> Array:
        """Q (rows, rows) in p^T Q p: the published one if it belongs to tractions, else W Q W."""
        if self._compliance is None:
            Q = multiplier_gram(cone, self.length).toarray()
            Q = Q if self.gram.factor == "complete" else incomplete_cholesky(Q, drop_of(self.gram)).trailing(len(Q))
        else:
            Q = surface.N @ self._compliance @ surface.N.T
        return np.asarray(surface.W[:, None] * Q * surface.W if self.gram.unknown == "forces" else Q)

    def spectrum(self, surface: DelassusOperator, cone: AdmissibleSet) -> Array:
        """Eigenvalues of Q^-1 B K_B^-1 B^T on the rows that carry tractions, increasing."""
        on = cone.carrying
        return self._spectrum(surface, on, inverse_root(self.on_tractions(surface, cone)[np.ix_(on, on)]))

    def _spectrum(self, surface: DelassusOperator, on: Bools, root: Array) -> Array:
        assert isinstance(surface, CondensedSurface)
        B = surface.N[on].T.multiply(surface.W[on]) @ root  # forces on the contact dofs (c, r)
        return np.asarray(eigvalsh(B.T @ surface.flexibility @ B))


def drop_of(gram: Gram) -> float | None:
    """The tolerance that `incomplete_cholesky` takes."""
    return {"complete": 0.0, "drop": gram.drop, "ic0": None}[gram.factor]


def volume_block(system: System, gram: Gram) -> Array:
    """Q^-1 on forces (c, c): P_cc P_cc^T, contact dofs last, of the Gram matrix of displacements; collective.

    Of the complete factor that is the Schur complement, of order 1 as the inverse of B K_B^-1 B^T is: the reading
    that may hope for independence of h.
    """
    matrix, contact = volume_gram(system, gram.length or system.extent), system.contact_dofs
    if gram.factor == "complete" and len(contact):
        return FactorisedVolume(matrix, contact, Counters()).S
    whole, _ = contact_last(matrix, contact)
    return incomplete_cholesky(whole, drop_of(gram)).trailing(len(contact))


def volume_gram(system: System, length: float) -> Any:
    """Gamma of the basis of free displacements, PETSc; collective."""
    weak = system.weak
    return free_stiffness(dx.assemble_matrix(weak.compile(weak.gram(length))), system.T, system.constraints)


def contact_last(matrix: Any, contact: Ints) -> tuple[Any, Ints]:
    """A distributed matrix whole on every rank (scipy), the farther from contact the earlier, and that order.

    By edges of the mesh; an incomplete factor leaves least behind at the contact dofs if elimination moves there.
    """
    every = PETSc.IS().createStride(matrix.size[0], step=1, comm=PETSc.COMM_SELF)
    (whole,) = matrix.createSubMatrices([every], [every])
    indptr, indices, data = whole.getValuesCSR()
    A = sparse.csr_matrix((data, indices, indptr), shape=whole.getSize())
    if not len(contact):
        return A, np.arange(A.shape[0])
    away = dijkstra(abs(A), directed=False, indices=contact, unweighted=True, min_only=True)
    away[contact] = -1.0
    order = np.argsort(-away, kind="stable")
    return A[order][:, order], order


def multiplier_gram(cone: AdmissibleSet, length: float) -> Any:
    """Gamma of the traces of the displacement basis at multiplier nodes (rows, rows), sparse.

    The multipliers' own dual basis jumps and is in no H1: it is taken by its nodes.
    """
    normal = [_side_gram(c, c.psi.multiply(1 / _positive(c.node_weights)[:, None]).T, length) for c in cone.contacts]
    tangential = [
        sparse.kron(_side_gram(c, c.share_t, length), sparse.eye(c.free.shape[1])) for c in cone.contacts
    ]  # fmt: skip
    return sparse.block_diag([*normal, *tangential], format="csr")


def _side_gram(c: ContactRows, share: Any, length: float) -> Any:
    """Of one contact's points, `share` (m, n) the nodes that each stands for."""
    side = c.surface
    product = surface_stiffness(side) + surface_product(side) / length**2
    basis = share @ side.forces_transform
    return basis @ product @ basis.T


def _positive(weights: Array) -> Array:
    return np.where(weights > 0, weights, 1.0)
