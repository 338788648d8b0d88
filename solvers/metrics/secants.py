"""A flexibility that learns by secant (quasi-Newton, block DFP) updates from measured forces and displacements."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from mpi4py import MPI
from scipy.linalg import cholesky, solve_triangular

from stickslip.geometry.arrays import EXACT, Array, Ints
from stickslip.geometry.protocols import Comm
from stickslip.solvers.parallel.serialise import Plain
from stickslip.solvers.parallel.shares import Shares

KEPT = 100  # pairs
NOISE = 3.0  # that part must also exceed the asymmetry of measured work this many times


class Secants:
    """The block DFP update of a guess F by pairs of forces S (c, s) and measured displacements Y (c, s):

        F+ = F - F S (S^T F S)^-1 S^T F + Y (S^T Y)^-1 Y^T,

    positive definite with F+ S = Y (the secant equations), for every positive definite F. Pairs that depend on the
    others are left out. Inexact volume solves make S^T Y asymmetric; the independent part must exceed that asymmetry.

    Each rank stores its share of the rows of all pairs, see `Shares`: all calls are collective, with the same arguments
    on every rank.

    Source: Schnabel, Quasi-Newton methods using multiple secant equations, Univ. Colorado CU-CS-247-83 (1983).
    """

    def __init__(
        self, guess: Callable[[Array], Array], forces: Array, displacements: Array, comm: Comm = MPI.COMM_SELF
    ) -> None:
        """
        Args:
            guess: F, symmetric and positive definite; takes forces (c,) or (c, k) [N] to displacements [m].
            forces, displacements: independent pairs (c, s) [N], [m] that are known from the start and never dropped.
            comm: the ranks that share the pairs.
        """
        self.guess, self._sure, self._shares = guess, forces.shape[1], Shares(comm, len(forces))
        own = self._shares.own
        self._S, self._Y = np.ascontiguousarray(forces[own]), np.ascontiguousarray(displacements[own])
        self._guessed = np.ascontiguousarray(guess(forces)[own])
        self._prepare()

    @property
    def count(self) -> int:
        """Number s of pairs in use."""
        return int(self._S.shape[1])

    def learn(self, force: Array, displacement: Array) -> None:
        """Add a pair: a force (c,) [N] and the displacement (c,) [m] that a volume solve gave for it."""
        size = np.sqrt(max(float(force @ displacement), 0.0))
        if not (size > 0 and np.isfinite(size)):  # no work, or less than the error of the solve, or NaN
            return
        known = self._S, self._Y, self._guessed
        try:
            self._take(force / size, displacement / size)
        except np.linalg.LinAlgError:  # its independent part is rounding: go on without it
            self._S, self._Y, self._guessed = known

    def _take(self, force: Array, displacement: Array) -> None:
        """Add a pair of unit work; drop the oldest if there are too many, and those that depend on the others.

        Raises:
            LinAlgError: the work matrix S^T Y is not positive definite.
        """
        if self.count == self._sure + KEPT:
            self._keep(np.delete(np.arange(self.count), self._sure))
        own = self._shares.own
        self._S = np.column_stack([self._S, force[own]])
        self._Y = np.column_stack([self._Y, displacement[own]])
        self._guessed = np.column_stack([self._guessed, self.guess(force)[own]])
        work = self._shares.sum(self._S.T @ self._Y)
        noise = float(np.abs(work - work.T)[self._sure :, self._sure :].max(initial=0.0))
        # least part of a pair's work that must be independent of the others, if volume solves are exact
        self._keep(_independent((work + work.T) / 2, self._sure, max(EXACT, NOISE * noise)))
        self._prepare()

    def _keep(self, chosen: Ints) -> None:
        # contiguous in C order, as after reading from a file: rounding depends on it
        self._S, self._Y, self._guessed = (
            np.ascontiguousarray(pairs[:, chosen]) for pairs in (self._S, self._Y, self._guessed)
        )

    def snapshot(self) -> dict[str, Plain]:
        """All pairs, this rank's share of their rows; see `restore`."""
        return {"forces": self._S, "displacements": self._Y, "guessed": self._guessed}

    def restore(self, snapshot: dict[str, Plain]) -> None:
        """Take the pairs of a `snapshot` of an object with the same guess, instead of those given at the start."""
        self._S, self._Y, self._guessed = snapshot["forces"], snapshot["displacements"], snapshot["guessed"]
        self._prepare()

    def _prepare(self) -> None:
        measured, guessed = self._shares.sum(np.array([self._S.T @ self._Y, self._S.T @ self._guessed]))
        self.more, self.less = _root(self._Y, measured), _root(self._guessed, guessed)

    def __call__(self, force: Array) -> Array:
        """Displacement F+ f [m] of forces f (c,) or (c, k) [N], with F+ = F + more more^T - less less^T."""
        own = self._shares.own
        amounts = self._shares.sum(np.array([self.more.T @ force[own], self.less.T @ force[own]]))
        return self._shares.whole(self.guess(force)[own] + self.more @ amounts[0] - self.less @ amounts[1])


def _root(Z: Array, work: Array) -> Array:
    """Z L^-T (c, s) with work = L L^T, so that its product with its transpose is Z work^-1 Z^T."""
    if not len(work):
        return Z
    return np.asarray(solve_triangular(cholesky((work + work.T) / 2, lower=True), Z.T, lower=True).T)


def _independent(work: Array, sure: int, least: float) -> Ints:
    """Independent pairs, chosen by a pivoted Cholesky factorisation: next the pair most independent of those chosen.

    Args:
        work: (s, s) symmetric.
        sure: number of pairs, the first ones, that are always chosen.
        least: smallest part of a pair's work that must be independent of the others.

    Returns:
        Indices of the chosen pairs, increasing.
    """
    left, scale = work.copy(), np.diag(work).copy()
    chosen: list[int] = []
    for k in range(len(work)):
        new = np.diag(left) / scale
        new[chosen] = -np.inf
        at = k if k < sure else int(np.argmax(new))
        if k >= sure and new[at] <= least:
            break
        left -= np.outer(left[at], left[at]) / left[at, at]
        chosen.append(at)
    return np.sort(np.array(chosen, np.int64))
