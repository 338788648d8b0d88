"""Uzawa with the published preconditioner: step and projection in the metric of a Gram matrix of H1.

The matrix is factorised, completely, or incompletely: A = P P^T - S, S the entries dropped outside a pattern or below a
tolerance.

Source: Pop (1999), (5.6) and (5.7).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy import sparse
from scipy.linalg import eigh, eigvalsh
from scipy.sparse.csgraph import dijkstra

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import EXACT, Array, Bools, Ints
from stickslip.geometry.errors import MachineError, require
from stickslip.geometry.keys import Key, Noun
from stickslip.geometry.protocols import Mat, Sparse
from stickslip.geometry.surfaces.surface import consistent_mass, surface_stiffness
from stickslip.solvers.classical.uzawa import Outer, Relaxation, Solved
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.interface.flexibility import DelassusOperator
from stickslip.solvers.interface.prepare import condensed
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import OnStep, Solution, ignore
from stickslip.solvers.methods.method import Applicability, Keys, Method, Ready, Refusal, SameEveryStep, Setup
from stickslip.solvers.newton.surface_model import nearest_in_cone
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.system.stiffness import Stiffness
from stickslip.solvers.system.system import System


@dataclass(frozen=True, kw_only=True)
class Gram(Noun):
    """H1 Gram matrix of finite element basis functions, and its Cholesky factor."""

    space: Annotated[
        Literal["volume", "multiplier"],
        Key("-", "basis: of displacements, Q^-1 from the factor's block of contact dofs; or of tractions, Q"),
    ] = "volume"
    factor: Annotated[
        Literal["complete", "drop", "ic0"], Key("-", "complete, with a drop tolerance, or in the matrix's own pattern")
    ] = "complete"
    drop: Annotated[float, Key("-", "for factor = drop: tolerance, relative to the norm of a column")] = 1e-3
    unknown: Annotated[Literal["forces", "tractions"], Key("-", "unknown that it is the metric of")] = "forces"
    length: Annotated[
        float | None,
        Key("m", "l in the product, integral of grad u : grad v + u . v / l^2; absent: the bodies' extent"),
    ] = None

    def __post_init__(self) -> None:
        require(0 < self.drop < 1, "drop", self.drop, "must lie between 0 and 1, for example 1e-3")
        require(self.length is None or self.length > 0, "length", self.length, "must be positive")


@dataclass(frozen=True, eq=False, kw_only=True)
class DenseMetric:
    """Q / alpha in place of the Delassus operator; implements `newton.surface_model.Metric`."""

    surface: DelassusOperator
    Q: Array  # (rows, rows), p^T Q p for tractions p
    carrying: Bools  # (rows,) rows that may carry a traction
    root: Array  # T with T T^T = Q^-1 on these rows, see `inverse_root`
    alpha: float  # step of Uzawa's method

    @cached_property
    def matrix(self) -> Array:
        """W^-1 Q / alpha (rows, rows) [m/Pa]."""
        return np.asarray(self.Q / (self.alpha * self.surface.W[:, None]))

    @cached_property
    def diagonal(self) -> Array:
        """That of `matrix` (rows,) [m/Pa]."""
        return np.diag(self.matrix)

    def __call__(self, p: Array) -> Array:
        """Relative displacement (rows,) [m] by this metric from tractions (rows,) [Pa]."""
        return np.asarray(self.matrix @ p)

    def inverse(self, w: Array) -> Array:
        """Tractions alpha Q^-1 W w (rows,) [Pa] from relative displacement w (rows,) [m]."""
        found = np.zeros_like(w)
        found[self.carrying] = self.alpha * self.root @ (self.root.T @ (self.surface.W * w)[self.carrying])
        return found


def inverse_root(Q: Array) -> Array:
    """T (rows, r) with T T^T = Q^-1 (the pseudo-inverse), r the rank of Q (rows, rows).

    Q is singular where a compliant face has more points than nodes: tractions without nodal forces have norm zero.
    """
    values, vectors = eigh(Q)
    kept = values > EXACT * values.max(initial=0.0)  # of the largest eigenvalue; a smaller one is zero
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]))


@dataclass(frozen=True)
class IncompleteFactor:
    """The lower triangular factor P, in the order of A."""

    P: Sparse  # (n, n) csc
    shift: float  # added to A's diagonal, relative to it, so that all pivots are positive

    def trailing(self, count: int) -> Array:
        """P_cc P_cc^T of the last `count` unknowns (count, count): for a complete factor, A's Schur complement."""
        P_cc = self.P[-count:, -count:].toarray() if count else np.zeros((0, 0))
        return np.asarray(P_cc @ P_cc.T)


def incomplete_cholesky(A: Array | Sparse, drop: float | None = None) -> IncompleteFactor:
    """Factorise column by column, each from those to its left (left-looking).

    Where a pivot is not positive, A's diagonal is raised until all are.

    Args:
        A: (n, n) symmetric, positive definite; the zeros of a dense matrix are not in its pattern.
        drop: entries of at most `drop` times the norm of A's column are left out; 0 drops no entry and gives the
            complete factor. None drops the entries outside A's own pattern, IC(0).

    Source: Meijerink & van der Vorst, Math. Comp. 31 (1977); the shift: Manteuffel, Math. Comp. 34 (1980).

    Raises:
        MachineError: some pivot stays negative however the diagonal is raised: A is not positive definite.

    >>> A = sparse.csr_matrix(np.array([[4.0, 2.0, 0.0], [2.0, 5.0, 2.0], [0.0, 2.0, 5.0]]))
    >>> incomplete_cholesky(A).P.toarray()  # tridiagonal: there is no fill to drop
    array([[2., 0., 0.],
           [1., 2., 0.],
           [0., 1., 2.]])
    """
    lower = sparse.tril(A, format="csc")
    lower.sort_indices()
    for shift in (0.0, *(1e-3 * 2.0 ** np.arange(11)).tolist()):  # of the diagonal
        P = _factor(lower, drop, 1 + shift)
        if P is not None:
            return IncompleteFactor(P, shift)
    raise MachineError("incomplete Cholesky: a pivot stays negative; the Gram matrix is not positive definite")


def _factor(lower: Sparse, drop: float | None, raised: float) -> Sparse | None:
    """P (n, n) of A with its diagonal times `raised`; None if a pivot is not positive."""
    n = lower.shape[0]
    least = 0.0 if drop is None else drop * np.sqrt(np.asarray(lower.multiply(lower).sum(axis=0)).ravel())
    least = np.broadcast_to(least, n)
    left: list[list[int]] = [[] for _ in range(n)]  # columns of P with an entry in that row
    rows: list[NDArray[np.int32]] = []
    values: list[Array] = []
    column = np.zeros(n)  # work space, zero between the columns
    for j in range(n):
        own = lower.indices[lower.indptr[j] : lower.indptr[j + 1]]
        column[own] = lower.data[lower.indptr[j] : lower.indptr[j + 1]]
        column[j] *= raised
        reached = [own]
        for k in left[j]:
            at = int(np.searchsorted(rows[k], j))
            below = rows[k][at:]
            column[below] -= values[k][at] * values[k][at:]
            reached.append(below)
        if not column[j] > 0:
            return None
        found = np.unique(np.concatenate(reached))
        kept = own if drop is None else found[(np.abs(column[found]) > least[j]) | (found == j)]
        rows.append(kept)
        values.append(column[kept] / np.sqrt(column[j]))
        for i in kept[1:].tolist():
            left[i].append(j)
        column[found] = 0.0
    pointer = np.cumsum([0, *(len(each) for each in rows)])
    return sparse.csc_matrix(
        (np.concatenate([[], *values]), np.concatenate([lower.indices[:0], *rows]), pointer), lower.shape
    )


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
    A = sparse.csr_matrix((data, indices, indptr), shape=whole.getSize())
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
    return sparse.block_diag([*normal, *tangential], format="csr")


def _side_gram(c: ContactRows, share: Sparse, length: float) -> Sparse:
    """Gram matrix (m, m) of one contact's points; `share` (m, n) are the nodes that each stands for."""
    side = c.surface
    product = surface_stiffness(side) + consistent_mass(side) / length**2
    basis = share @ side.forces_transform
    return basis @ product @ basis.T


def _positive(weights: Array) -> Array:
    return np.where(weights > 0, weights, 1.0)


@dataclass(frozen=True, kw_only=True)
class GramKeys(Keys):
    """Key of [solver] for the Gram matrix of the published preconditioner."""

    gram: Annotated[Gram, Key("-", "preconditioner of gram-uzawa, and of block-uzawa with preconditioner = gram")] = (
        Gram()
    )


@dataclass(frozen=True, kw_only=True)
class GramUzawa(Relaxation, GramKeys, Method):
    """p <- argmin over the cone of |q - p_hat|_Q, p_hat = p + alpha Q^-1 (B u - R_C), alpha = relaxation / lambda_max.

    lambda_max is that of Q^-1 B K_B^-1 B^T. The source can be read in two ways: Q is the Gram matrix of the
    multipliers, P P^T as (5.6) writes it; or Q^-1 is the block of contact dofs in the factor of the displacements' Gram
    matrix. The first is an operator of the wrong order, 2 instead of -1: condition numbers grow like h^-3, and on all
    but the coarsest meshes it ends in MAX_IT. The second is bounded in h for the complete factor only.

    The source has no projection, because its Newton steps fix the sticking points. Here the projection onto the cone is
    in the metric Q: a contact problem on the surface, whose friction bound follows the pressure. It converges for
    0 < relaxation < 2 and fixed bounds. Clipping point by point is not a projection in this metric, and may diverge.
    On compliant faces, whose tractions are at quadrature points, Q measures the nodal forces of the tractions and is
    singular; with the compliance of the law added it is regular.

    Source: Pop (1999), (5.6)-(5.7) and its last algorithm.
    """

    NAME: ClassVar = "gram-uzawa"
    WHEN: ClassVar = (
        "as published: preconditioned by the Cholesky factor of a Gram matrix. Complete, of the volume, on forces: "
        "as many iterations on every mesh (83–87 for two steps of `block` to 1e-6, condition number 9.6–10.4; "
        "`uzawa` 302–1563), at the price of a second factorisation; incomplete, it grows like 1/h; of the multiplier "
        "space, like 1/h³, worse than none"
    )
    WORKS_WITH: ClassVar = Applicability(floating=False, matrix_free=False, contends=False)
    ROW: ClassVar = 3

    def refusals(self, problem: Problem) -> Iterator[Refusal]:
        """Values of `gram` that need a basis of the tractions, which tractions at quadrature points do not have."""
        for name, pair in problem.pairs.items():
            if not pair.contact.normal.at_quadrature:
                continue
            why = f"has no basis in H1 for tractions at the quadrature points of contacts.{name}"
            if self.gram.space == "multiplier":
                yield "gram.space", self.gram.space, f"{why}; use volume"
            if self.gram.unknown == "tractions":
                yield "gram.unknown", self.gram.unknown, f"{why}; use forces"

    def build(self, setup: Setup) -> Ready:
        metric = GramMetric(setup.system, self.gram)
        return GramIteration(metric, relaxation=self.relaxation, rtol=self.rtol, max_it=self.max_it)


@dataclass(frozen=True)
class GramIteration(SameEveryStep):
    """The iteration, with the Gram matrix of the scene."""

    metric: GramMetric
    relaxation: float = 1.5  # [-]
    rtol: float = Method.rtol
    max_it: int = Method.max_it

    def renewed(self, setup: Setup) -> Ready:
        return self  # the metric is of the bodies, `on` that of the rows

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        metric = self.metric.on(problem, self.relaxation)

        def solve(p: Array) -> Solved:  # K_B u = R_B - B^T p: one volume solve
            return Solved(p, problem.contact_displacement(p), 1.0)  # alpha is in the metric

        def advance(step: SurfaceProblem, inner: Solved, w: Array, residual: float) -> Array | None:
            found = nearest_in_cone(step, metric, inner.p, w, max(residual, self.rtol))
            return None if found is None else found.p

        return Outer(rtol=self.rtol, max_it=self.max_it, advance=advance)(problem, p, solve, on_step)
