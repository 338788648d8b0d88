"""Preconditioned conjugate gradients that recycle the search directions of earlier right-hand sides (deflation).

The same Krylov spaces give the edges of a spectrum, by Lanczos' method.

Each solve starts from the best solution in the span of the stored directions and keeps its own directions conjugate to
them, so later solves with the same matrix need fewer iterations.

Source: Erhel & Guyomarc'h, SIAM J. Matrix Anal. Appl. 21 (2000), 1279-1299 (augmented conjugate gradients).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Literal, Protocol

import numpy as np
from mpi4py import MPI
from scipy.sparse.linalg import LinearOperator, eigsh

from stickslip.geometry.arrays import LAST_DIGITS, Array, Ints
from stickslip.geometry.errors import SolverError
from stickslip.geometry.protocols import Comm, Mat, Vec
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.parallel.serialise import Own, Plain


class SearchDirections:
    """Stored directions d_j and products A d_j with d_i . A d_j = 1 if i = j, else 0; each rank holds its own part.

    They deflate a solve: `advance` solves exactly in their span, `conjugate` keeps later directions out of it.
    """

    def __init__(self, comm: Comm, owned: int, most: int, known: SearchDirections | None = None) -> None:
        """
        Args:
            comm: mpi4py communicator.
            owned: number of entries of a vector on this rank.
            most: number of directions to store; a further one replaces the oldest.
            known: other directions that deflate a solve too, and stay as they are; None: there are none.
        """
        self.comm, self.most, self.count, self.known = comm, most, 0, known
        self._D, self._AD = np.empty((most, owned)), np.empty((most, owned))

    def advance(self, x: Array, r: Array) -> None:
        """Move x (owned,) to the least energy in x + span(d_j), and update r = b - A x; in place; collective."""
        if self.known:
            self.known.advance(x, r)
        if k := min(self.count, self.most):
            along = self.comm.allreduce(self._D[:k] @ r)
            x += along @ self._D[:k]
            r -= along @ self._AD[:k]

    def response(self, local: Ints) -> float:
        """Largest ratio of an entry of a vector in their span to its energy norm; collective.

        That is max_i (sum_j d_j[i]^2)^(1/2) over the entries i of all ranks.

        Args:
            local: positions in this rank's part of the entries that are asked for.
        """
        own = float(np.sqrt(self._squares(local).max(initial=0.0)))
        return float(self.comm.allreduce(own, op=MPI.MAX))

    def _squares(self, local: Ints) -> Array:
        """sum_j d_j[i]^2 of some own entries."""
        found = np.sum(self._D[: min(self.count, self.most), local] ** 2, axis=0)
        return np.asarray(found if self.known is None else found + self.known._squares(local))

    def conjugate(self, z: Array) -> None:
        """Make z (owned,) conjugate (A-orthogonal) to all directions, in place; collective."""
        if self.known:
            self.known.conjugate(z)
        if k := min(self.count, self.most):
            z -= self.comm.allreduce(self._AD[:k] @ z) @ self._D[:k]

    def keep(self, d: Array, Ad: Array, norm: float) -> None:
        """Store a direction d (owned,).

        Args:
            d, Ad: the direction and its product with A.
            norm: energy norm (d . A d)^(1/2).
        """
        place = self.count % self.most
        np.divide(d, norm, out=self._D[place])
        np.divide(Ad, norm, out=self._AD[place])
        self.count += 1

    def snapshot(self) -> dict[str, Plain]:
        """All stored directions; see `restore`."""
        k = min(self.count, self.most)
        return {"count": self.count, "D": Own(self._D[:k].T), "AD": Own(self._AD[:k].T)}

    def restore(self, snapshot: dict[str, Plain]) -> None:
        """Store the directions of a `snapshot` instead of the present ones."""
        self.count = snapshot["count"]
        k = min(self.count, self.most)
        self._D[:k], self._AD[:k] = snapshot["D"].T, snapshot["AD"].T


UNKNOWN = 0.5  # smallest contraction per iteration that is assumed before two steps allow an estimate


class StoppingCriterion(Protocol):
    """When a solve stops. Arrays are this rank's part (owned,); both questions are collective."""

    def met(self, x: Array, z: Array, energy: float) -> bool:
        """Asked before each step.

        Args:
            x: the iterate.
            z: the preconditioned residual M^-1 r, an estimate of the error.
            energy: r . z, an estimate of the squared energy norm of the error.
        """

    def moved(self, x: Array, change: Array) -> bool:
        """Asked after each step from x - change to x."""


class ContactErrorCriterion:
    """Stops when no contact dof is off by more than `error`, or than `relative` times the largest contact dof.

    Two estimates of that error must both be small:
    the last step times q / (1 - q), q the contraction seen over the last two steps;
    the energy norm of the error before the step times `response()`, the most that a contact dof moves per unit of
    energy norm, as far as the search directions known so far show it.
    """

    def __init__(
        self, *, comm: Comm, local: Ints, error: float, relative: float, response: Callable[[], float]
    ) -> None:
        """
        Args:
            comm: mpi4py communicator.
            local: positions of the contact dofs in this rank's part of a vector.
            error: allowed error [m].
            relative: allowed error, relative to the largest contact dof.
            response: see `SearchDirections.response`; collective.
        """
        self.comm, self.local, self.error, self.relative, self.response = comm, local, error, relative, response
        self.steps: list[float] = []
        self._left = 0.0

    def met(self, x: Array, z: Array, energy: float) -> bool:
        self._left = float(np.sqrt(energy))
        if energy == 0.0:  # the residual is zero
            return True
        return not self.steps and self._small(x, z, 2.0)  # error, relative to a multigrid cycle on the residual

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
        # twice the estimate; steps alone do not show an error that hardly falls, such as bending of a slender body
        return bool(2.0 * share * step <= enough) and self._left * self.response() <= enough

    def _rate(self) -> float:
        """Estimated contraction per iteration."""
        last = self.steps[-3:]
        if len(last) < 2 or not last[0]:
            return UNKNOWN
        seen = (last[-1] / last[0]) ** (1 / (len(last) - 1))
        # limits of the estimated contraction
        return float(np.clip(seen, 0.3 if len(last) == 3 else UNKNOWN, 0.95))


class EnergyErrorCriterion:
    """Stops when the error is below `relative` times the solution, both in the energy norm.

    Where the solution is smaller than the error of the start, that error takes its place: less is rounding.
    `reached` is the last estimate of the relative error.
    """

    def __init__(self, comm: Comm, f: Array, relative: float) -> None:
        """
        Args:
            comm: mpi4py communicator.
            f: this rank's part (owned,) of the right-hand side.
            relative: allowed relative error.
        """
        self.comm, self.f, self.relative = comm, f, relative
        self.reached, self._first = 0.0, 0.0

    def met(self, x: Array, z: Array, energy: float) -> bool:
        stored = self.comm.allreduce(float(self.f @ x))  # x . A x, up to the residual
        self._first = self._first or energy
        self.reached = float(np.sqrt(energy / max(stored, self._first))) if energy else 0.0
        return self.reached <= self.relative

    def moved(self, x: Array, change: Array) -> bool:
        return False


class ResidualCriterion:
    """Stops when the residual norm (r . M^-1 r)^(1/2) is at most `allowed(first)`, `first` its value at the start.

    M is the preconditioner, so this norm is close to the energy norm of the error. `reached` is its last value.
    """

    def __init__(self, allowed: Callable[[float], float]) -> None:
        """
        Args:
            allowed: takes the norm at the start to the norm at which to stop.
        """
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


MOST_ITERATIONS = 1000  # of one solve; with multigrid 10 to 25 are usual


class ConjugateGradients:
    """Solves A x = b for one A and many b; all calls are collective."""

    def __init__(self, A: Mat, precondition: Callable[[Vec, Vec], None], counters: Counters) -> None:
        """
        Args:
            A: symmetric, positive definite on the space of the right-hand sides.
            precondition: takes (r, z) and writes z = M^-1 r, M symmetric and close to A.
            counters: counts the iterations.
        """
        self.A, self.precondition, self.counters = A, precondition, counters
        self.comm = A.comm.tompi4py()
        self._in, self._out = A.createVecRight(), A.createVecLeft()
        # directions; of 80, the last are rounding for slender bodies. Each costs two vectors, two products a step
        self.remember(40)

    def remember(self, most: int) -> None:
        """Forget all search directions; store up to `most` of them, at least one, from now on."""
        self.directions = SearchDirections(self.comm, self._in.getLocalSize(), most)

    @contextmanager
    def apart(self, most: int) -> Iterator[None]:
        """Inside the block up to `most` directions are stored beside those known so far, and forgotten after it."""
        before = self.directions
        self.directions = SearchDirections(self.comm, self._in.getLocalSize(), most, before)
        try:
            yield
        finally:
            self.directions = before

    def solve(self, b: Array, x: Array, criterion: StoppingCriterion) -> None:
        """Improve x until the criterion is met, in place.

        Args:
            b: this rank's part (owned,) of the right-hand side.
            x: this rank's part (owned,) of the start, then of the solution.
            criterion: when to stop.

        Raises:
            SolverError: it is not met, or A or the preconditioner is not positive definite.
        """
        r = b - self._apply(self.A.mult, x)
        self.directions.advance(x, r)
        size = abs(self._dot(b, x))
        for _ in range(MOST_ITERATIONS):
            d = self._apply(self.precondition, r).copy()
            left = self._dot(r, d)
            if not left >= 0.0:  # the preconditioner is not positive definite, or NaN
                break
            size = max(size, left)  # a start at zero is as far off as the solution is large
            # of the solution, in energy norm: no criterion asks for less
            if criterion.met(x, d, left) or left <= LAST_DIGITS**2 * size:
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

    def _apply(self, act: Callable[[Vec, Vec], None], x: Array) -> Array:
        """Result (owned,) of a PETSc operation; valid until the next call."""
        self._in.array[:] = x
        act(self._in, self._out)
        return np.asarray(self._out.array_r)

    def _dot(self, a: Array, b: Array) -> float:
        return float(self.comm.allreduce(a @ b))


LANCZOS = 1e-4  # relative error of an eigenvalue


def extreme_eigenvalue(apply: Callable[[Array], Array], start: Array, which: Literal["LA", "SA"] = "LA") -> float:
    """Return the largest (LA) or smallest (SA) eigenvalue of an operator on vectors (n,), by Lanczos' method (ARPACK).

    LANCZOS is added to the largest one, so that a step size that divides by it is rather too small. Small operators,
    whose products are as many, are made dense.

    Args:
        apply: the operator.
        start: (n,), the same on every rank, and not normal to the direction that is sought.

    >>> round(extreme_eigenvalue(lambda x: np.arange(1.0, 61.0) * x, np.ones(60), "SA"), 3)
    1.0
    """
    vectors = 20 if which == "LA" else 40  # small ones are crowded in all uses here
    if len(start) <= vectors:
        values = np.linalg.eigvalsh(np.array([apply(unit) for unit in np.eye(len(start))]).reshape(2 * (len(start),)))
        return float(values[-1 if which == "LA" else 0])
    operator = LinearOperator(2 * (len(start),), matvec=apply, dtype=float)
    (found,) = eigsh(operator, k=1, which=which, v0=start, tol=LANCZOS, ncv=vectors, return_eigenvectors=False)
    return float(found) * (1 + LANCZOS if which == "LA" else 1)


def without_symmetry(count: int) -> Array:
    """Return a start (count,) of Lanczos' method that is no eigenvector of bodies with a plane of symmetry."""
    return np.asarray(1 + np.sin(np.arange(count)))
