"""A stiffness without the entries that rounding alone has left.

Where cells are boxes, of a hexahedral mesh a third: what one cell couples by shear, its neighbour takes back. Products
and multigrid cycles then take half the time.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from petsc4py import PETSc

from stickslip.geometry.protocols import Mat

ROUNDED = 1e-14  # of the diagonal
WORTH = 0.1  # share of the entries that pays for another matrix
CHUNK = 100_000  # rows at a time: memory


def without_rounding(K: Mat) -> Mat:
    """K without its entries of the size of rounding errors, and K gone; K itself if they are few; collective.

    They are added to the entries of their node, so that a body that moves as a whole feels no more forces than before;
    but columns get other sums.
    """
    dim, low = K.block_size, K.getOwnershipRange()[0]
    size = ROUNDED * np.abs(K.getDiagonal().array_r)
    pointer, column, value = K.getValuesCSR()
    counts, end = np.zeros(len(size), np.int64), 0
    for first, last in pairwise([*range(0, len(size), CHUNK), len(size)]):
        part = slice(pointer[first], pointer[last])
        j, x = column[part], value[part]
        i = np.repeat(np.arange(first, last), np.diff(pointer[first : last + 1]))
        own = j // dim == (i + low) // dim
        kept = own | (np.abs(x) > size[i])
        at = (i - first) * dim + j % dim
        left = np.bincount(at, np.where(kept, 0.0, x), (last - first) * dim)
        x[own] += left[at[own]]
        counts[first:last] = np.bincount(i[kept] - first, minlength=last - first)
        count = np.count_nonzero(kept)
        column[end : end + count], value[end : end + count] = j[kept], x[kept]  # to the front, in place
        end += count
    few, many = K.comm.tompi4py().allreduce(np.array([end, len(value)]))
    if few > (1 - WORTH) * many:
        return K
    sizes, comm, form = K.getSizes(), K.comm, K.getAttr("form")
    K.destroy()
    csr = (np.append(0, np.cumsum(counts)).astype(PETSc.IntType), column[:end], value[:end])
    found: Mat = PETSc.Mat().createAIJ(sizes, bsize=dim, csr=csr, comm=comm)
    found.assemble()
    found.setAttr("form", form)
    return found
