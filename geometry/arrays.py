"""Array types that all packages use in signatures; products and inverses of many small matrices at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
AnyArray = NDArray[Any]


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


def inverses(matrices: Array) -> Array:
    """Inverses (m, d, d) of matrices (m, d, d)."""
    return np.moveaxis(inverse_and_determinant(np.moveaxis(matrices, 0, -1))[0], -1, 0)


def products(matrices: Array, x: Array) -> Array:
    """Products (m d,) of matrices (m, d, d) with the parts of x (m d,).

    >>> products(np.array([[[0.0, 1.0], [1.0, 0.0]]]), np.array([2.0, 3.0]))
    array([3., 2.])
    """
    return np.asarray(np.einsum("mij,mj->mi", matrices, x.reshape(matrices.shape[:2])).ravel())
