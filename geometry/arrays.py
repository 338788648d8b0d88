"""Array types that all packages use in signatures, levels of rounding, and products of many small matrices at once.

A tolerance is one of the levels times the size of what is compared; the line that does so says which size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
AnyArray = NDArray[Any]

EPS = float(np.finfo(np.float64).eps)  # 2.2e-16
TINY = float(np.finfo(np.float64).tiny) / EPS  # 1e-292: keeps denominators, logarithms and roots from zero
LAST_DIGITS = 64 * EPS  # 1.4e-14: of one sum or product, and where Newton's method for a few unknowns ends
EXACT = 1e-12  # of what linear systems and long sums yield
HALF_DIGITS = EPS**0.5  # 1.5e-8: what a system leaves that is singular but for rounding
ROUNDING = 1e-9  # of coordinates, shape functions, forces and motions that went through several of those
CLOSE = 1e-6  # of what other programs hand over, of directions, and of answers that are improved afterwards
SLIGHT = 1e-3  # a part that the eye does not see, and by which numbers tell nothing apart

STEPS = 60  # of Gauss and Newton's method to the nearest point of a surface, at most; near it about 6 are enough
CHUNK = 20_000  # rows of long arrays that are worked on at a time: bounds the memory


class Rows:
    """Base of dataclasses whose fields are arrays, each with one row for each of the same things."""

    def at(self, chosen: AnyArray) -> Self:
        """The rows that are chosen, by number or by a mask."""
        return self.each(lambda rows: rows[chosen])

    def each(self, change: Callable[[AnyArray], AnyArray]) -> Self:
        """With the same change of every array."""
        return type(self)(**{name: change(rows) for name, rows in vars(self).items()})

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """The rows of all parts, one part after the other."""
        return cls(**{name: np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])})


def cross(arms: Array, forces: Array) -> Array:
    """Cross products over the last axis: (..., 3) in space; in the plane numbers (...), which numpy 2 does not make.

    >>> float(cross(np.array([1.0, 0.0]), np.array([0.0, 2.0])))
    2.0
    """
    if arms.shape[-1] == 3:
        return np.asarray(np.cross(arms, forces))
    return np.asarray(arms[..., 0] * forces[..., 1] - arms[..., 1] * forces[..., 0])


def inverse_and_determinant(matrices: Array) -> tuple[Array, Array]:
    """Inverse (k, i, ...) and determinant (...) of matrices (i, k, ...), by their cofactors.

    LAPACK, which OpenBLAS runs on all cores for each matrix, takes 8 to 30 times longer, most on a busy machine.
    """
    if len(matrices) == 2:
        (a, b), (c, d) = matrices
        cofactors = np.array([[d, -b], [-c, a]])
    else:
        edges = matrices.swapaxes(0, 1)
        cofactors = np.array([np.cross(edges[k - 2], edges[k - 1], axis=0) for k in range(3)])
    det = (cofactors[0] * matrices[:, 0]).sum(axis=0)
    return cofactors / det, det


def connected(size: int, i: Ints, j: Ints) -> Ints:
    """Number (size,) of the part that each of `size` places is in, of those that pairs i, j (n,) join.

    >>> connected(4, np.array([0, 3]), np.array([2, 1])).tolist()
    [0, 1, 0, 1]
    """
    from scipy import sparse  # late: a file of a user is read without it
    from scipy.sparse.csgraph import connected_components

    graph = sparse.coo_matrix((np.ones(len(i), bool), (i, j)), shape=(size, size))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def inverses(matrices: Array) -> Array:
    """Inverses (m, d, d) of matrices (m, d, d)."""
    return np.moveaxis(inverse_and_determinant(np.moveaxis(matrices, 0, -1))[0], -1, 0)


def products(matrices: Array, x: Array) -> Array:
    """Products (m d,) of matrices (m, d, d) with the parts of x (m d,).

    >>> products(np.array([[[0.0, 1.0], [1.0, 0.0]]]), np.array([2.0, 3.0]))
    array([3., 2.])
    """
    return np.asarray(np.einsum("mij,mj->mi", matrices, x.reshape(matrices.shape[:2])).ravel())
