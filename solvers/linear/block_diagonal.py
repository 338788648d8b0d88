"""A symmetric matrix of dense blocks: the stiffness of bodies that touch but share no node couples no two of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import DTypeLike
from scipy import sparse
from scipy.linalg import block_diag

from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.protocols import Sparse


@dataclass(frozen=True)
class BlockDiagonal:
    """Blocks (n_k, n_k) at the increasing indices (n_k,), which together are all of 0, ..., n - 1.

    NumPy takes it as the dense matrix (n, n) where it needs one.
    """

    indices: tuple[Ints, ...]
    blocks: tuple[Array, ...]

    @classmethod
    def whole(cls, matrix: Array) -> BlockDiagonal:
        """One block."""
        return cls((np.arange(len(matrix)),), (matrix,))

    def __len__(self) -> int:
        return sum(len(index) for index in self.indices)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> Array:
        if len(self.blocks) == 1:
            return self.blocks[0]
        dense = np.zeros((len(self), len(self)))
        for index, block in zip(self.indices, self.blocks, strict=True):
            dense[np.ix_(index, index)] = block
        return dense

    def __matmul__(self, x: Array) -> Array:
        """The product with x (n,) or (n, k)."""
        if len(self.blocks) == 1:
            return np.asarray(self.blocks[0] @ x)
        found = np.empty(x.shape)
        for index, block in zip(self.indices, self.blocks, strict=True):
            found[index] = block @ x[index]
        return found

    def between(self, left: Sparse, right: Sparse) -> Array:
        """left A right (l, r), of left (l, n) and right (n, r)."""
        left, right = sparse.csc_matrix(left), sparse.csr_matrix(right)
        found = np.zeros((left.shape[0], right.shape[1]))
        for index, block in zip(self.indices, self.blocks, strict=True):
            rows, columns = left[:, index], right[index]
            touched = np.flatnonzero(np.bincount(columns.indices, minlength=right.shape[1]))
            some = np.flatnonzero(np.bincount(rows.indices, minlength=left.shape[0]))
            moved = (columns[:, touched].T @ block).T
            found[np.ix_(some, touched)] += rows.tocsr()[some] @ moved
        return found

    def of_blocks(self, change: Callable[[Ints, Array], Array]) -> BlockDiagonal:
        """The matrix whose blocks a function makes of the indices and blocks of this one."""
        return BlockDiagonal(self.indices, tuple(change(*each) for each in zip(self.indices, self.blocks, strict=True)))

    def together(self, group: Ints) -> BlockDiagonal:
        """The same matrix with blocks of the same group, of 0, 1, ... (blocks,), as one."""
        made = []
        for k in np.unique(group):
            own = np.flatnonzero(group == k)
            index = np.concatenate([self.indices[i] for i in own])
            order = np.argsort(index)
            made.append((index[order], block_diag(*(self.blocks[i] for i in own))[np.ix_(order, order)]))
        return BlockDiagonal(tuple(index for index, _ in made), tuple(block for _, block in made))

    def extended(self, more: int) -> BlockDiagonal:
        """With `more` rows and columns of zeros at the end, each a block."""
        if not more:
            return self
        added = tuple(np.array([len(self) + k]) for k in range(more))
        return BlockDiagonal(self.indices + added, self.blocks + (np.zeros((1, 1)),) * more)

    @property
    def diagonal(self) -> Array:
        """Diagonal (n,)."""
        found = np.empty(len(self))
        for index, block in zip(self.indices, self.blocks, strict=True):
            found[index] = np.diag(block)
        return found

    @property
    def trace(self) -> float:
        """Sum of the diagonal."""
        return float(sum(np.trace(block) for block in self.blocks))

    @property
    def magnitude(self) -> float:
        """Sum of the magnitudes of all entries."""
        return float(sum(np.abs(block).sum() for block in self.blocks))


def joined(count: int, parts: Sequence[tuple[Ints, Array]]) -> BlockDiagonal:
    """Of the blocks that are not empty; of none, if there are `count` = 0 rows, one empty block."""
    full = [part for part in parts if len(part[0])]
    if not full:
        return BlockDiagonal.whole(np.zeros((count, count)))
    return BlockDiagonal(tuple(index for index, _ in full), tuple(block for _, block in full))
