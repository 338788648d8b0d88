"""Search directions of earlier solves, kept conjugate: a new right-hand side begins where they lead."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from solvers.plain import Own

Array = NDArray[np.float64]
MOST = 40  # directions; of 80, the last are rounding for slender bodies. One costs two vectors, and two products a step


class SearchDirections:
    """Directions d_j and A d_j, d_i . A d_j = 1 if i = j, else 0; each rank holds its own part of them.

    Source: Erhel & Guyomarc'h, SIAM J. Matrix Anal. Appl. 21 (2000), 1279-1299 (augmented conjugate gradients).
    """

    def __init__(self, comm: Any, owned: int, most: int) -> None:
        """
        Args:
            comm: mpi4py communicator.
            owned: entries of a vector on this rank.
            most: when there are more, the oldest one is forgotten.
        """
        self.comm, self.most, self.count = comm, most, 0
        self._D, self._AD = np.empty((most, owned)), np.empty((most, owned))

    def advance(self, x: Array, r: Array) -> None:
        """Bring x to where A x = b is solved as well as the directions can; r = b - A x follows. In place."""
        if k := min(self.count, self.most):
            along = self.comm.allreduce(self._D[:k] @ r)
            x += along @ self._D[:k]
            r -= along @ self._AD[:k]

    def response(self, local: NDArray[np.int64]) -> float:
        """Most that an entry `local` of a vector in their span has, beside the vector's energy norm; collective."""
        known = self._D[: min(self.count, self.most), local]
        own = float(np.sqrt(np.sum(known**2, axis=0).max(initial=0.0)))
        return float(self.comm.allreduce(own, op=MPI.MAX))

    def conjugate(self, z: Array) -> None:
        """Make z conjugate to all of them, in place."""
        if k := min(self.count, self.most):
            z -= self.comm.allreduce(self._AD[:k] @ z) @ self._D[:k]

    def keep(self, d: Array, Ad: Array, norm: float) -> None:
        """Remember a direction, its product with A, and its energy norm."""
        place = self.count % self.most
        np.divide(d, norm, out=self._D[place])
        np.divide(Ad, norm, out=self._AD[place])
        self.count += 1

    def kept(self) -> dict[str, Any]:
        """All that is remembered; see `restore`."""
        k = min(self.count, self.most)
        return {"count": self.count, "D": Own(self._D[:k].T), "AD": Own(self._AD[:k].T)}

    def restore(self, kept: dict[str, Any]) -> None:
        """Remember what was `kept`."""
        self.count = kept["count"]
        k = min(self.count, self.most)
        self._D[:k], self._AD[:k] = kept["D"].T, kept["AD"].T
