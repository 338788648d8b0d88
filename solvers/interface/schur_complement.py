"""The Schur complement S of K_B on the contact dofs (static condensation), dense, the same for all load steps.

S is the discrete Steklov-Poincaré operator; its inverse gives the Delassus operator B K_B^-1 B^T exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from petsc4py import PETSc
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpotri
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from stickslip.geometry.arrays import HALF_DIGITS, LAST_DIGITS, Array, Bools, Ints
from stickslip.geometry.protocols import Sparse, Vec
from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.interface.flexibility import DelassusOperator, Load
from stickslip.solvers.linear.block_diagonal import BlockDiagonal
from stickslip.solvers.parallel.serialise import Own, Plain


class MemoisedMap:
    """Memoises a costly linear map of distributed vectors: on the span of earlier arguments it costs no call.

    All load steps whose loads differ by a factor cost one call.
    """

    def __init__(self, apply: Callable[[Vec], Array], size: int, before: MemoisedMap | None = None) -> None:
        """
        Args:
            apply: the linear map of a vector to (size,); collective.
            size: length of the results.
            before: of the same map, or of one that is about it.
        """
        self._apply, self._size = apply, size
        self._known: list[tuple[Vec, Array]] = list(before._known) if before else []  # orthonormal, and their images

    def __call__(self, vector: Vec) -> Array:
        """Image (size,) of a vector, exact to rounding; collective."""
        unit = 2.0 ** np.frexp(vector.norm(PETSc.NormType.INFINITY))[1]  # else squares may be 0 or infinite
        rest, image = vector * (1 / unit), np.zeros(self._size)
        size = rest.norm()
        for _ in range(2):  # Gram-Schmidt twice: then the rest of a vector in the span is rounding
            for direction, its_image in self._known:
                part = rest.dot(direction)
                rest.axpy(-part, direction)
                image += part * its_image
        length = rest.norm()
        if not np.isfinite(length) or length > 10 * LAST_DIGITS * size:  # else it lies in the span
            rest.scale(1 / length)
            its_image = self._apply(rest)
            image += length * its_image
            if len(self._known) < 8:  # loads that turn steadily through more directions gain nothing from it
                self._known.append((rest, its_image))
        return np.asarray(unit * image)

    def snapshot(self) -> dict[str, Plain]:
        """All known vectors and their images; see `restore`."""
        return {"vectors": [Own(v.array_r) for v, _ in self._known], "images": [image for _, image in self._known]}

    def restore(self, snapshot: dict[str, Plain], like: Vec) -> None:
        """Know what a `snapshot` holds, and nothing else.

        Args:
            snapshot: see `snapshot`.
            like: a vector of the layout of the arguments.
        """
        self._known = []
        for own, image in zip(snapshot["vectors"], snapshot["images"], strict=True):
            vector = like.duplicate()
            vector.array[:] = own
            self._known.append((vector, image))


CholeskyFactor = tuple[Array, bool]  # as scipy.linalg.cho_factor returns it


class SparseLU(Protocol):
    """The LU factors of a sparse matrix A, as scipy.sparse.linalg.splu returns them."""

    def solve(self, rhs: Array, trans: str = "N") -> Array: ...  # A^-1 rhs, or A^-T rhs with "T"


@dataclass(frozen=True, kw_only=True)
class RowStiffness:
    """The Schur complement by rows: W p = N^-T f_c - H (w - offset) on the m = c rows that may carry tractions.

    It is the equation S u_c = f_c - N^T W p multiplied by N^-T: exact, also for floating bodies.
    """

    index: Ints  # (m,) numbers of these rows among all
    H: Array  # (m, m) N^-T S N^-1 [N/m], symmetric
    factor: SparseLU  # of these rows of N

    @classmethod
    def of(cls, N: Sparse, S: BlockDiagonal, carrying: Bools) -> RowStiffness | None:
        """
        Args:
            N: (rows, c), displacement of the contact dofs to relative displacement.
            S: (c, c) Schur complement [N/m].
            carrying: (rows,) rows that may carry tractions.

        Returns:
            None if these rows of N are not square or singular.
        """
        index = np.flatnonzero(carrying)
        if not len(index) or len(index) != len(S):
            return None
        try:
            factor = splu(N[index].tocsc())
        except RuntimeError:  # SuperLU: exactly singular
            return None
        pivots = np.abs(factor.U.diagonal())
        # smallest pivot of N, relative to its largest, below which the rows do not determine every dof
        if pivots.min() < HALF_DIGITS * pivots.max():
            return None
        half = factor.solve(np.asfortranarray(np.asarray(S)), "T")
        H = np.asarray(factor.solve(np.asfortranarray(half.T), "T"))
        return cls(index=index, H=H, factor=factor)

    def forces(self, f_c: Array) -> Array:
        """Forces on the rows N^-T f_c (m,) [N] of forces on the contact dofs f_c (c,) [N]."""
        return np.asarray(self.factor.solve(f_c, "T"))

    def displacement(self, relative: Array) -> Array:
        """Displacement of the contact dofs N^-1 w (c,) [m] of a relative displacement w (m,) [m]."""
        return np.asarray(self.factor.solve(relative))


def _cholesky(A: Array) -> CholeskyFactor:
    factor: CholeskyFactor = cho_factor(A, lower=True, check_finite=False)
    return factor


def _inverse(factor: CholeskyFactor) -> Array:
    inverse, _ = dpotri(factor[0], lower=True)
    return np.asarray(np.tril(inverse) + np.tril(inverse, -1).T)


NO_ROWS = np.zeros(0, int), np.zeros((0, 0))
PAYS = 16  # the inverse is formed after c / PAYS forces: from then on it is cheaper than triangular solves


class CondensedSurface(DelassusOperator):
    """The Delassus operator by the Schur complement S of K_B: S u_c = f_c - N^T W p on the contact dofs."""

    exact = True

    def __init__(
        self, volume: FactorisedVolume, *, N: Sparse, W: Array, R: Array, normal_rows: int, driven: int
    ) -> None:
        """See `DelassusOperator`."""
        super().__init__(N=N, W=W, R=R, normal_rows=normal_rows, driven=driven, counters=volume.counters)
        self.volume = volume
        self.S = volume.S.extended(driven)
        self.total = self.S.magnitude
        self.rho = self.S.trace / max(len(self.S), 1)
        self._condensed = MemoisedMap(volume.condense, len(volume.S))
        self._forces = 0  # number of forces whose displacement was asked for
        self._dense: dict[str, Any] = {}  # factor and inverse, shared with the objects of other contact pairs
        self._row_stiffness: dict[bytes, RowStiffness | None] = {}
        self._delassus = NO_ROWS

    @property
    def held(self) -> tuple[CholeskyFactor, ...]:
        """Cholesky factors of the blocks of S + rho R R^T, which is positive definite."""
        if "held" not in self._dense:
            self._dense["held"] = tuple(
                _cholesky(block + self.rho * self.R[index] @ self.R[index].T)
                for index, block in zip(self.S.indices, self.S.blocks, strict=True)
            )
        factors: tuple[CholeskyFactor, ...] = self._dense["held"]
        return factors

    @property
    def flexibility(self) -> BlockDiagonal:
        """Inverse (S + rho R R^T)^-1 (c, c) [m/N]: the inverse of the Steklov-Poincaré operator."""
        if not len(self.S):  # no contact in the scene
            return self.S
        if "flexibility" not in self._dense:
            self._dense["flexibility"] = BlockDiagonal(self.S.indices, tuple(_inverse(each) for each in self.held))
        found: BlockDiagonal = self._dense["flexibility"]
        return found

    def coupling(self, left: Sparse, right: Sparse) -> Array:
        """left D right (l, r) of the Delassus matrix D = N (S + rho R R^T)^-1 N^T (rows, rows) [m/N].

        D is formed once, of the rows that were asked for so far.
        """
        left, right = sparse.csc_matrix(left), sparse.csr_matrix(right)
        rows, columns = np.flatnonzero(np.diff(left.indptr)), np.flatnonzero(np.diff(right.indptr))
        known, D = self._delassus
        more = np.setdiff1d(np.union1d(rows, columns), known)
        if len(more):
            known, before = np.concatenate([known, more]), known
            D = np.hstack([D, self.flexibility.between(self.N[before], self.N[more].T)])
            D = np.vstack([D, self.flexibility.between(self.N[more], self.N[known].T)])
            self._delassus = known, D
        place = np.empty(len(self.W), int)
        place[known] = np.arange(len(known))
        return np.asarray(left[:, rows] @ D[np.ix_(place[rows], place[columns])] @ right[columns])

    @property
    def delassus(self) -> Array:
        whole = sparse.identity(len(self.W))
        return np.asarray(self.coupling(whole, whole) * self.W)

    @cached_property
    def give(self) -> Array | None:
        blocks = zip(self.flexibility.indices, self.flexibility.blocks, strict=True)
        parts = ((self.N[:, index], block) for index, block in blocks)
        return self.W * sum(np.asarray(N.multiply(N @ block).sum(axis=1)).ravel() for N, block in parts)

    def factor(self, tangent: Array) -> CholeskyFactor:
        """Cholesky factor of S + tangent + rho R R^T, for a stiffness `tangent` (c, c) [N/m]."""
        return _cholesky(np.asarray(self.S) + self.rho * self.R @ self.R.T + tangent)

    def softened(self, H: Array, compliant: Array, free: Array) -> CondensedSurface:
        """The same with S - H M^-1 H^T in place of S: b dofs of the bodies are eliminated that no contact touches.

        Args:
            H: (c, b) forces on the contact dofs by unit values of these [N/m].
            compliant: (b, c) M^-1 H^T.
            free: (c, k) [m] displacements that then have no stiffness.
        """
        left, right = (np.array([np.abs(A[index]).sum(axis=0) for index in self.S.indices]) for A in (H, compliant.T))
        S = self.S.together(connected_components(left @ right.T)[1])
        softer = S.of_blocks(lambda index, block: block - H[index] @ compliant[:, index])
        return self._with(softer, np.linalg.qr(np.column_stack([self.R, free]))[0])

    def on_springs(self, stiffness: float) -> CondensedSurface:
        """The same with springs [N/m] that hold the rigid modes: no body floats."""
        held = self.S.of_blocks(lambda index, block: block + stiffness * self.R[index] @ self.R[index].T)
        return self._with(held, self.R[:, :0])

    def _with(self, S: BlockDiagonal, R: Array) -> CondensedSurface:
        """Bodies of the same rows with another Schur complement (c, c) [N/m], and rigid modes."""
        other = copy(self)
        other.S, other.R = S, R
        other._dense, other._row_stiffness, other._lambda_max, other._delassus = {}, {}, None, NO_ROWS
        other.__dict__.pop("give", None)
        return other

    def row_stiffness(self, carrying: Bools) -> RowStiffness | None:
        """The Schur complement by the rows `carrying` (rows,), None if they do not determine the contact dofs."""
        key = carrying.tobytes()
        if key not in self._row_stiffness:
            self._row_stiffness[key] = RowStiffness.of(self.N, self.S, carrying)
        return self._row_stiffness[key]

    def load(self, f_q: Vec, driving: Array, error: float = 0.0) -> Load:
        f_c = np.concatenate([self._condensed(f_q), driving])
        return Load(f_q=f_q, driving=driving, f_c=f_c, resultant=self.R.T @ f_c, free=self.displacement(f_c))

    def with_more(self, load: Load, forces: Vec, balanced: bool) -> Load:
        return self.with_condensed(load, forces, self.volume.condense(forces), balanced)

    def with_condensed(self, load: Load, forces: Vec, condensed: Array, balanced: bool = False) -> Load:
        """`with_more` of forces over the free dofs that are condensed (c,) [N] already."""
        more = np.concatenate([condensed, np.zeros(self.driven)])
        resultant = load.resultant if balanced else load.resultant + self.R.T @ more
        return replace(load, f_q=load.f_q + forces, f_c=load.f_c + more, resultant=resultant)

    def displacement(self, force: Array, error: float = 0.0) -> Array:
        if not len(force):
            return force
        self.counters.volume_solves += 1
        self._forces += 1
        if "flexibility" in self._dense or PAYS * self._forces > len(force):
            return self.flexibility @ force
        return self.by_factor(force)

    def by_factor(self, force: Array) -> Array:
        """The displacement under forces (c,) or (c, k) [N] by the factor alone, whether there is an inverse or not."""
        found = np.empty_like(force)
        for index, factor in zip(self.S.indices, self.held, strict=True):
            found[index] = cho_solve(factor, force[index])
        return found

    def under(self, load: Load, p: Array, error: float = 0.0) -> Array:
        return self.displacement(load.f_c - self.forces(p))

    def recover(self, load: Load, p: Array, u_c: Array) -> Vec:
        return self.volume.expand(load.f_q, u_c[: len(u_c) - self.driven])

    def snapshot(self) -> dict[str, Plain]:
        inverted = "flexibility" in self._dense
        counted = 0 if inverted else self._forces  # after the inverse is formed it has no effect
        return super().snapshot() | {"condensed": self._condensed.snapshot(), "forces": counted, "inverted": inverted}

    def restore(self, snapshot: dict[str, Plain]) -> None:
        super().restore(snapshot)
        self._condensed.restore(snapshot["condensed"], self.volume.K.createVecRight())
        self._forces = snapshot["forces"]
        if snapshot["inverted"]:  # displacements must come from the inverse again, with its rounding
            _ = self.flexibility

    def adopt(self, other: DelassusOperator) -> None:
        assert isinstance(other, CondensedSurface)
        self._condensed, self._dense = other._condensed, other._dense
        known, D = other._delassus
        if self.N.shape == other.N.shape:  # rows of other pairs are formed anew
            same = np.flatnonzero(np.asarray(abs(self.N - other.N).sum(axis=1)).ravel()[known] == 0)
            self._delassus = known[same], D[np.ix_(same, same)]
