"""The bodies as the contact rows feel them where every contact dof is measured by a row: no inverse is needed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
SINGULAR = 1e-8  # smallest pivot of N beside its largest at which rows do not measure every dof


@dataclass(frozen=True)
class RowStiffness:
    """W p = N^-T f_c - H (w - offset) on the rows that may carry tractions, m = c of them.

    The same equation as S u_c = f_c - N^T W p, multiplied by N^-T: exact, whether the bodies are held or not.
    """

    index: Ints  # (m,) numbers of these rows among all
    H: Array  # (m, m) N^-T S N^-1 [N/m], symmetric
    _N: Any  # LU factor of these rows of N

    @classmethod
    def of(cls, N: Any, S: Array, carrying: NDArray[np.bool_]) -> RowStiffness | None:
        """
        Args:
            N: (rows, c) sparse.
            S: (c, c) stiffness of the contact dofs [N/m].
            carrying: (rows,) rows that may carry tractions.

        Returns:
            None where these rows do not measure each dof once.
        """
        index = np.flatnonzero(carrying)
        if not len(index) or len(index) != len(S):
            return None
        try:
            factor = splu(N[index].tocsc())
        except RuntimeError:  # SuperLU: exactly singular
            return None
        pivots = np.abs(factor.U.diagonal())
        if pivots.min() < SINGULAR * pivots.max():
            return None
        half = factor.solve(np.asfortranarray(S), "T")
        return cls(index, np.asarray(factor.solve(np.asfortranarray(half.T), "T")), factor)

    def forces(self, f_c: Array) -> Array:
        """N^-T f_c (m,) [N]: what forces on the contact dofs do to the rows."""
        return np.asarray(self._N.solve(f_c, "T"))

    def displacement(self, relative: Array) -> Array:
        """u_c (c,) [m] at which the rows measure this (m,)."""
        return np.asarray(self._N.solve(relative))
