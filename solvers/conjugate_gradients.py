"""Preconditioned conjugate gradients that remember the search directions of earlier right-hand sides."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry.errors import SolverError
from solvers.counters import Counters
from solvers.search_directions import MOST, SearchDirections
from solvers.stopping import Goal

Array = NDArray[np.float64]
ROUNDING = 1e-14  # of the solution, in energy norm: no goal is nearer than that
MOST_ITERATIONS = 1000  # of one solve; multigrid takes a dozen or two


class ConjugateGradients:
    """Solves A x = b for one A and many b; collective."""

    def __init__(self, A: Any, precondition: Callable[[Any, Any], None], counters: Counters) -> None:
        """
        Args:
            A: PETSc matrix, symmetric, positive definite where the right-hand sides are.
            precondition: writes about A^-1 r into its second argument, PETSc vectors.
        """
        self.A, self.precondition, self.counters = A, precondition, counters
        self.comm = A.comm.tompi4py()
        self._in, self._out = A.createVecRight(), A.createVecLeft()
        self.remember(MOST)

    def remember(self, most: int) -> None:
        """Start anew with so many search directions to keep, at least one."""
        self.directions = SearchDirections(self.comm, self._in.getLocalSize(), most)

    def solve(self, b: Array, x: Array, goal: Goal) -> None:
        """Improve x (owned,) until the goal is reached.

        Raises:
            SolverError: it is not reached.
        """
        r = b - self._apply(self.A.mult, x)
        self.directions.advance(x, r)
        rounding = ROUNDING**2 * abs(self._dot(b, x))
        for _ in range(MOST_ITERATIONS):
            d = self._apply(self.precondition, r).copy()
            left = self._dot(r, d)
            if not left >= 0.0:  # the preconditioner is not positive definite, or something is no number
                break
            if goal.met(x, d, left) or left <= rounding:
                return
            self.directions.conjugate(d)
            Ad = self._apply(self.A.mult, d)
            energy = self._dot(d, Ad)
            if not energy > 0.0:
                break
            step = self._dot(r, d) / energy
            self.directions.keep(d, Ad, float(np.sqrt(energy)))
            r -= step * Ad
            d *= step
            x += d
            self.counters.linear_iterations += 1
            if goal.moved(x, d):
                return
        raise SolverError('the iterative volume solve does not converge; set solver.surface = "condensed"')

    def _apply(self, act: Callable[[Any, Any], None], x: Array) -> Array:
        """Result of a PETSc operation; valid until the next one."""
        self._in.array[:] = x
        act(self._in, self._out)
        return np.asarray(self._out.array_r)

    def _dot(self, a: Array, b: Array) -> float:
        return float(self.comm.allreduce(a @ b))
