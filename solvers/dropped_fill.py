"""What an incomplete LU factorisation drops: given back to the diagonal, it makes the relaxed ones of the plain one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry.errors import MachineError

Array = NDArray[np.float64]


def dropped_fill(A: Any, relaxation: float) -> Array:
    """Sum over each row (n,) of the fill that falls outside A's pattern in its relaxed ILU(0).

    The relaxed factorisation adds `relaxation` times that sum to the pivot as it goes: 0 is ILU(0), 1 the modified one,
    which keeps row sums. Row by row it is therefore ILU(0) of A + relaxation * diag(sum), which any library makes.

    Args:
        A: (n, n) sparse, with all of its diagonal in the pattern.

    Source: Saad, Iterative Methods for Sparse Linear Systems (2003), 10.3.5; the source of the published methods names
    Elman, BIT 29 (1989).

    Raises:
        MachineError: a pivot is zero.

    >>> from scipy import sparse
    >>> A = sparse.csr_matrix(np.array([[4.0, -1, -1], [-1, 4, 0], [-1, 0, 4]]))
    >>> dropped_fill(A, 0.0)  # -1/4 at (1, 2) and at (2, 1)
    array([ 0.  , -0.25, -0.25])
    """
    A = A.tocsr()
    A.sort_indices()
    n = A.shape[0]
    fill, row = np.zeros(n), np.zeros(n)  # the row at work, zero wherever nothing was reached
    pivots: list[float] = []
    columns: list[NDArray[np.int32]] = []  # of U, right of the diagonal
    values: list[Array] = []
    for i in range(n):
        own = A.indices[A.indptr[i] : A.indptr[i + 1]]
        row[own] = A.data[A.indptr[i] : A.indptr[i + 1]]
        reached = [own]
        at = int(np.searchsorted(own, i))
        for k in own[:at].tolist():
            row[columns[k]] -= row[k] / pivots[k] * values[k]
            reached.append(columns[k])
        kept = row[own]
        row[own] = 0.0
        touched = np.unique(np.concatenate(reached))
        fill[i] = row[touched].sum()
        row[touched] = 0.0
        pivot = float(kept[at] + relaxation * fill[i])
        if not abs(pivot) > 0:
            raise MachineError(f"incomplete LU: pivot {i} is {pivot}")
        pivots.append(pivot)
        columns.append(own[at + 1 :])
        values.append(kept[at + 1 :])
    return fill
