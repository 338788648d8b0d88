"""Incomplete Cholesky factors: A = P P^T - S, S the entries dropped outside a pattern or below a tolerance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import MachineError
from stickslip.geometry.protocols import Sparse

FIRST_SHIFT = 1e-3  # of the diagonal, after a pivot that is not positive
SHIFTS = 12  # each twice the one before


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
    shift = 0.0
    for _ in range(SHIFTS):
        P = _factor(lower, drop, 1 + shift)
        if P is not None:
            return IncompleteFactor(P, shift)
        shift = 2 * shift or FIRST_SHIFT
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
    factor: Sparse = sparse.csc_matrix(
        (np.concatenate([[], *values]), np.concatenate([lower.indices[:0], *rows]), pointer), lower.shape
    )
    return factor
