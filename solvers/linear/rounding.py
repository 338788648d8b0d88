"""A stiffness without the entries that rounding alone has left.

Where cells are boxes, of a hexahedral mesh a third: what one cell couples by shear, its neighbour takes back. It takes
as long as 15 iterations of conjugate gradients, after which products and multigrid cycles take half the time.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from petsc4py import PETSc

from stickslip.geometry.arrays import LAST_DIGITS, Array
from stickslip.geometry.protocols import Mat

CHUNK = 5000  # rows at a time: memory


def without_rounding(K: Mat) -> Mat:
    """K without its entries of the size of rounding errors, and K gone; K itself if they are few; collective.

    They are added to the entries of their node, so that a body that moves as a whole feels no more forces than before;
    but columns get other sums.
    """
    size = LAST_DIGITS * np.abs(K.getDiagonal().array_r)  # of the diagonal
    if _share(K, size) < 0.1:  # they do not pay for another matrix
        return K
    dim, low = K.block_size, K.getOwnershipRange()[0]
    pointer, column, value = K.getValuesCSR()
    counts, end = np.diff(pointer).astype(np.int64), 0
    for first, last in pairwise([*range(0, len(size), CHUNK), len(size)]):
        part, each, rows = slice(pointer[first], pointer[last]), counts[first:last].copy(), np.arange(last - first)
        j, x, row = column[part], value[part], np.repeat(rows, each)
        from_node = j - np.repeat(((rows + first + low) // dim * dim).astype(j.dtype), each)
        own = (from_node >= 0) & (from_node < dim)
        kept = own | (np.abs(x) > np.repeat(size[first:last], each))
        gone = np.flatnonzero(~kept)
        left = np.bincount(row[gone] * dim + j[gone] % dim, x[gone], len(rows) * dim)
        x[own] += left[row[own] * dim + from_node[own]]
        counts[first:last] -= np.bincount(row[gone], minlength=len(rows))
        count = len(x) - len(gone)
        column[end : end + count], value[end : end + count] = j[kept], x[kept]  # to the front, in place
        end += count
    sizes, comm, form = K.getSizes(), K.comm, K.getAttr("form")
    K.destroy()
    csr = (np.append(0, np.cumsum(counts)).astype(PETSc.IntType), column[:end], value[:end])
    found: Mat = PETSc.Mat().createAIJ(sizes, bsize=dim, csr=csr, comm=comm)
    found.assemble()
    found.setAttr("form", form)
    return found


def _share(K: Mat, size: Array) -> float:
    """Share of the entries of K that are not larger than `size` (owned,) of their row, of some rows; collective."""
    low, high = K.getOwnershipRange()
    rows = np.unique(np.linspace(low, high - 1, 300).astype(int)) if high > low else []
    found = [(np.count_nonzero(np.abs(x) <= size[i - low]), len(x)) for i in rows for x in [K.getRow(i)[1]]]
    few, many = K.comm.tompi4py().allreduce(np.array(found, np.int64).reshape(-1, 2).sum(axis=0))
    return float(few / many) if many else 0.0
