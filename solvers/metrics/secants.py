"""A guess of the flexibility that learns: forces whose displacement was measured give exactly that, ever after."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from geometry.arrays import Array, Ints

KEPT = 100  # pairs
EXACT = 1e-12  # part of a pair's work that must be new where volume solves are exact
NOISE = 3.0  # times the asymmetry of measured work that the new part must exceed


class Secants:
    """F+ = F - F S (S^T F S)^-1 S^T F + Y (S^T Y)^-1 Y^T for pairs of forces S and displacements Y (c, s).

    Positive definite and F+ S = Y, whatever the guess F: the block form of the DFP update of quasi-Newton methods.
    Pairs that say nothing new are left out. Measured work S^T Y is as asymmetric as volume solves are inexact, and
    what is new must exceed that.

    Source: Schnabel, Quasi-Newton methods using multiple secant equations, Univ. Colorado CU-CS-247-83 (1983).
    """

    def __init__(self, guess: Callable[[Array], Array], forces: Array, displacements: Array) -> None:
        """
        Args:
            guess: F, symmetric and positive definite; takes (c,) and (c, k) [N] to [m].
            forces, displacements: independent pairs (c, s) that are known to begin with and never dropped.
        """
        self.guess, self._sure = guess, forces.shape[1]
        self._S, self._Y = np.ascontiguousarray(forces), np.ascontiguousarray(displacements)
        self._guessed = np.ascontiguousarray(guess(forces))
        self._prepare()

    @property
    def count(self) -> int:
        """Pairs in use."""
        return int(self._S.shape[1])

    def learn(self, force: Array, displacement: Array) -> None:
        """Take up a pair (c,) of a force and the displacement that a volume solve gave."""
        size = np.sqrt(max(float(force @ displacement), 0.0))
        if not (size > 0 and np.isfinite(size)):  # no work, or less than the error of the solve
            return
        known = self._S, self._Y, self._guessed
        try:
            self._take(force / size, displacement / size)
        except np.linalg.LinAlgError:  # what is new in it is rounding after all
            self._S, self._Y, self._guessed = known

    def _take(self, force: Array, displacement: Array) -> None:
        """The pair, of unit work, among the others.

        Raises:
            LinAlgError: the work of all pairs together is not positive.
        """
        if self.count == self._sure + KEPT:
            self._keep(np.delete(np.arange(self.count), self._sure))
        self._S = np.column_stack([self._S, force])
        self._Y = np.column_stack([self._Y, displacement])
        self._guessed = np.column_stack([self._guessed, self.guess(force)])
        work = self._S.T @ self._Y
        noise = float(np.abs(work - work.T)[self._sure :, self._sure :].max(initial=0.0))
        self._keep(_independent((work + work.T) / 2, self._sure, max(EXACT, NOISE * noise)))
        self._prepare()

    def _keep(self, chosen: Ints) -> None:
        # in C's order, as they are read from a file: rounding depends on it
        self._S, self._Y, self._guessed = (
            np.ascontiguousarray(pairs[:, chosen]) for pairs in (self._S, self._Y, self._guessed)
        )

    def snapshot(self) -> dict[str, Array]:
        """All that was learnt; see `restore`."""
        return {"forces": self._S, "displacements": self._Y, "guessed": self._guessed}

    def restore(self, snapshot: dict[str, Array]) -> None:
        """Know what a `snapshot` holds by one with the same guess, instead of what was known to begin with."""
        self._S, self._Y, self._guessed = snapshot["forces"], snapshot["displacements"], snapshot["guessed"]
        self._prepare()

    def _prepare(self) -> None:
        more, less = _root(self._Y, self._S.T @ self._Y), _root(self._guessed, self._S.T @ self._guessed)
        self.more, self.less = more, less

    def __call__(self, force: Array) -> Array:
        """F+ times forces (c,) or (c, k) [m]; F+ = F + more more^T - less less^T."""
        return np.asarray(self.guess(force) + self.more @ (self.more.T @ force) - self.less @ (self.less.T @ force))


def _root(Z: Array, work: Array) -> Array:
    """Z work^(-1/2) (c, s)."""
    if not len(work):
        return Z
    return np.asarray(solve_triangular(cholesky((work + work.T) / 2, lower=True), Z.T, lower=True).T)


def _independent(work: Array, sure: int, least: float) -> Ints:
    """Indices of pairs, increasing, the first `sure` of them always, whose work is new by more than a part `least`.

    Cholesky with diagonal pivots: the pair that is newest to those chosen comes next.
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
