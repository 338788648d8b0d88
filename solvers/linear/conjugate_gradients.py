"""Preconditioned conjugate gradients that remember the search directions of earlier right-hand sides."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from mpi4py import MPI

from geometry.arrays import Array, Ints
from geometry.errors import SolverError
from solvers.parallel.counters import Counters
from solvers.parallel.serialise import Own

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

    def response(self, local: Ints) -> float:
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

    def snapshot(self) -> dict[str, Any]:
        """All that is remembered; see `restore`."""
        k = min(self.count, self.most)
        return {"count": self.count, "D": Own(self._D[:k].T), "AD": Own(self._AD[:k].T)}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Remember what a `snapshot` holds."""
        self.count = snapshot["count"]
        k = min(self.count, self.most)
        self._D[:k], self._AD[:k] = snapshot["D"].T, snapshot["AD"].T


SAFETY = 2.0  # of the estimated error
UNKNOWN = 0.5  # contraction of an iteration, at least, before two of them tell it
SLOWEST, FASTEST = 0.95, 0.3  # contraction that is believed
MULTIGRID = 2.0  # the error over what one multigrid cycle makes of the residual


class StoppingCriterion(Protocol):
    """What a solve is asked for. Arrays are this rank's part; both questions are collective."""

    def met(self, x: Array, z: Array, energy: float) -> bool:
        """Before a step: z is the preconditioned residual, about the error, and `energy` its square in energy norm."""

    def moved(self, x: Array, change: Array) -> bool:
        """After a step from x - change to x."""


class ContactErrorCriterion:
    """The largest error of the contact dofs is below `error` [m], or below `relative` beside the largest of them.

    What is left after a step is that step times q / (1 - q), q the contraction seen over the last two steps; and no
    more than the energy norm of the error before it times `response`, the most that a contact dof moves beside that.
    Both must be small: the second one rests on the search directions known so far.
    """

    def __init__(self, comm: Any, local: Ints, error: float, relative: float, response: Callable[[], float]) -> None:
        self.comm, self.local, self.error, self.relative, self.response = comm, local, error, relative, response
        self.steps: list[float] = []
        self._left = 0.0

    def met(self, x: Array, z: Array, energy: float) -> bool:
        self._left = float(np.sqrt(energy))
        if energy == 0.0:  # nothing is left
            return True
        return not self.steps and self._small(x, z, MULTIGRID)

    def moved(self, x: Array, change: Array) -> bool:
        return self._small(x, change, None)

    def _small(self, x: Array, change: Array, share: float | None) -> bool:
        own = [float(np.abs(v[self.local]).max(initial=0.0)) for v in (change, x)]
        step, size = (self.comm.allreduce(value, op=MPI.MAX) for value in own)
        if share is None:
            self.steps.append(float(step))
            rate = self._rate()
            share = rate / (1 - rate)
        enough = max(self.error, self.relative * size)
        # steps alone do not see an error that hardly shrinks, as that of a slender body's bending
        return bool(SAFETY * share * step <= enough) and self._left * self.response() <= enough

    def _rate(self) -> float:
        """Contraction an iteration."""
        last = self.steps[-3:]
        if len(last) < 2 or not last[0]:
            return UNKNOWN
        seen = (last[-1] / last[0]) ** (1 / (len(last) - 1))
        return float(np.clip(seen, FASTEST if len(last) == 3 else UNKNOWN, SLOWEST))


class EnergyErrorCriterion:
    """The error is below `relative` beside the solution, both in the energy norm; `reached` is what it came to.

    Where the solution is next to nothing, the error is measured beside that of the start: less is rounding.
    """

    def __init__(self, comm: Any, f: Array, relative: float) -> None:
        self.comm, self.f, self.relative = comm, f, relative
        self.reached, self._first = 0.0, 0.0

    def met(self, x: Array, z: Array, energy: float) -> bool:
        stored = self.comm.allreduce(float(self.f @ x))  # x . A x, but for the residual
        self._first = self._first or energy
        self.reached = float(np.sqrt(energy / max(stored, self._first))) if energy else 0.0
        return self.reached <= self.relative

    def moved(self, x: Array, change: Array) -> bool:
        return False


class ResidualCriterion:
    """The residual is no larger than `allowed` of its first size, both measured by the preconditioner.

    That is about the energy norm of the error.
    """

    def __init__(self, allowed: Callable[[float], float]) -> None:
        self.allowed = allowed
        self.first: float | None = None
        self.reached = 0.0

    def met(self, x: Array, z: Array, energy: float) -> bool:
        self.reached = float(np.sqrt(energy))
        if self.first is None:
            self.first = self.reached
        return self.reached <= self.allowed(self.first)

    def moved(self, x: Array, change: Array) -> bool:
        return False


ROUNDING = 1e-14  # of the solution, in energy norm: no criterion is nearer than that
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

    def solve(self, b: Array, x: Array, criterion: StoppingCriterion) -> None:
        """Improve x (owned,) until the criterion is reached.

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
            if criterion.met(x, d, left) or left <= rounding:
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
            if criterion.moved(x, d):
                return
        raise SolverError('the iterative volume solve does not converge; set solver.surface = "condensed"')

    def _apply(self, act: Callable[[Any, Any], None], x: Array) -> Array:
        """Result of a PETSc operation; valid until the next one."""
        self._in.array[:] = x
        act(self._in, self._out)
        return np.asarray(self._out.array_r)

    def _dot(self, a: Array, b: Array) -> float:
        return float(self.comm.allreduce(a @ b))
