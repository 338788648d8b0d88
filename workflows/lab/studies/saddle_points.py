"""Uzawa's iteration on linear saddle points: contraction factor in theory and measured, exact and inexact solves.

A contact problem has this form when every point is closed and sticks: there is no projection, and Uzawa's iteration is
Richardson's on the Schur complement S = B A^-1 B^T + C, the Delassus operator with C = -K_C. Everything is small and
dense, so that the norms of the theory can be measured.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import eigvalsh

from stickslip.geometry.arrays import Array

TAIL = 20  # last iterations, over which the asymptotic factor is measured
NOTHING = 1e-10  # of the first error: less is rounding
RUNAWAY = 1e12  # times the first error: the iteration diverges


@dataclass(frozen=True, kw_only=True)
class SaddlePoint:
    """[A B^T; B -C] [x; y] = [p; q], A (n, n) positive definite, C (m, m) positive semidefinite.

    Source: Pop (1999), (1.1).
    """

    A: Array  # (n, n)
    B: Array  # (m, n)
    C: Array  # (m, m)
    p: Array  # (n,)
    q: Array  # (m,)

    @cached_property
    def solution(self) -> tuple[Array, Array]:
        """x (n,) and y (m,)."""
        whole = np.block([[self.A, self.B.T], [self.B, -self.C]])
        x, y = np.split(np.linalg.solve(whole, np.concatenate([self.p, self.q])), [len(self.p)])
        return x, y

    @cached_property
    def flexibility(self) -> Array:
        """The Delassus operator B A^-1 B^T (m, m)."""
        return np.asarray(self.B @ np.linalg.solve(self.A, self.B.T))

    @property
    def S(self) -> Array:
        """The Schur complement B A^-1 B^T + C (m, m), the matrix of (5.5)."""
        return self.flexibility + self.C


@dataclass(frozen=True)
class Bounds:
    """Constants of a problem in the metric Q of its multipliers, on which the theory depends."""

    s: float  # ||B x||_(Q^-1) <= s ||x||_A
    c: float  # ||C y||_(Q^-1) <= c ||y||_Q
    eigenvalues: Array  # (m,) of Q^-1 S, increasing

    @classmethod
    def of(cls, problem: SaddlePoint, Q: Array) -> Bounds:
        """The constants of a problem for Q (m, m), symmetric and positive definite."""
        s, c = (max(eigvalsh(M, Q)[-1], 0.0) for M in (problem.flexibility, problem.C))
        return cls(float(np.sqrt(s)), float(c), eigvalsh(problem.S, Q))

    @property
    def limit(self) -> float:
        """2 / lambda_1, the upper limit of alpha. Source: Pop (1999), section 5, remarks."""
        return float(2 / self.eigenvalues[-1])

    def factor(self, alpha: float) -> float:
        """max |1 - alpha lambda|, the factor of ||y - y_k||_Q per iteration with exact inner solves."""
        return float(np.abs(1 - alpha * self.eigenvalues).max())


class Inner(ABC):
    """Rule for the inner solves: how x_(k+1) is found from A x = b, b = p - B^T y_k, and its allowed residual delta_k.

    The rule implies the bound ||delta_k||_(A^-1) <= e ||x - x_k||_A + f ||y - y_k||_Q.
    """

    @abstractmethod
    def promise(self, bounds: Bounds) -> tuple[float, float]:
        """The constants e and f of that bound."""

    @abstractmethod
    def allowed(self, problem: SaddlePoint, x: Array, y: Array, Q: Array) -> float:
        """Largest ||delta_k||_(A^-1) that the rule allows after x_k (n,) and y_k (m,)."""

    def solve(self, problem: SaddlePoint, x: Array, y: Array, alpha: float, Q: Array) -> Array:
        """x_(k+1) (n,), by conjugate gradients from x_k."""
        b = problem.p - problem.B.T @ y
        return conjugate_gradients(problem.A, b, x, self.allowed(problem, x, y, Q))

    def rate(self, bounds: Bounds, alpha: float) -> tuple[float, float]:
        """Spectral radius of the matrix M that bounds both errors of one iteration by those of the one before,

            (||x - x_(k+1)||_A, ||y - y_(k+1)||_Q) <= M (||x - x_k||_A, ||y - y_k||_Q),

        and the weight w in whose norm, (w ||x||_A² + ||y||_Q²)^(1/2), no iteration does worse.
        """
        e, f = self.promise(bounds)
        across, back = bounds.s + f, alpha * bounds.s * e
        down = bounds.factor(alpha) + alpha * bounds.s * f
        return float(e + down + np.sqrt((e - down) ** 2 + 4 * across * back)) / 2, back / across


@dataclass(frozen=True)
class Exact(Inner):
    """Exact inner solves: delta_k = 0."""

    def promise(self, bounds: Bounds) -> tuple[float, float]:
        return 0.0, 0.0

    def allowed(self, problem: SaddlePoint, x: Array, y: Array, Q: Array) -> float:
        return 0.0

    def solve(self, problem: SaddlePoint, x: Array, y: Array, alpha: float, Q: Array) -> Array:
        return np.asarray(np.linalg.solve(problem.A, problem.p - problem.B.T @ y))


@dataclass(frozen=True)
class Reducing(Inner):
    """The inner solve reduces its own residual by a factor: ||delta_k|| <= delta ||b - A x_k||.

    For C = 0 and alpha lambda_1 <= 1 `rate` is that of the source's theorem on the nonlinear iteration, and `w` that of
    its norm, with gamma = 1 - alpha lambda_min there; for other alpha and C it follows in the same way.

    Source: Bramble, Pasciak & Vassilev, SIAM J. Numer. Anal. 34 (1997), section 4.
    """

    delta: float

    def promise(self, bounds: Bounds) -> tuple[float, float]:
        return self.delta, self.delta * bounds.s

    def allowed(self, problem: SaddlePoint, x: Array, y: Array, Q: Array) -> float:
        return self.delta * dual(problem.p - problem.B.T @ y - problem.A @ x, problem.A)


@dataclass(frozen=True)
class Tied(Inner):
    """The residual of the inner system is tied to that of the outer one: ||delta_k|| <= tau ||B x_k - C y_k - q||.

    The rule is that of the source; `rate` is derived here, in the norms of the matrices instead of Euclidean ones, so
    that it does not depend on their condition numbers.

    Source: Elman & Golub, SIAM J. Numer. Anal. 31 (1994), section 2.
    """

    tau: float

    def promise(self, bounds: Bounds) -> tuple[float, float]:
        return self.tau * bounds.s, self.tau * bounds.c

    def allowed(self, problem: SaddlePoint, x: Array, y: Array, Q: Array) -> float:
        return self.tau * dual(problem.B @ x - problem.C @ y - problem.q, Q)


@dataclass(frozen=True)
class Worst(Inner):
    """The worst inner solve that a rule allows: the largest residual, in the direction worst for the multipliers.

    It uses the solution of the problem.
    """

    rule: Inner

    def promise(self, bounds: Bounds) -> tuple[float, float]:
        return self.rule.promise(bounds)

    def allowed(self, problem: SaddlePoint, x: Array, y: Array, Q: Array) -> float:
        return self.rule.allowed(problem, x, y, Q)

    def solve(self, problem: SaddlePoint, x: Array, y: Array, alpha: float, Q: Array) -> Array:
        error = problem.solution[1] - y
        harm = -problem.B.T @ (error - alpha * np.linalg.solve(Q, problem.S @ error))
        delta = harm * self.allowed(problem, x, y, Q) / dual(harm, problem.A)
        return np.asarray(np.linalg.solve(problem.A, problem.p - problem.B.T @ y + delta))


@dataclass(frozen=True, kw_only=True)
class InexactRichardson:
    """x_(k+1): A x = p - B^T y_k + delta_k; y_(k+1) = y_k + alpha Q^-1 (B x_(k+1) - C y_k - q).

    Source: Pop (1999), (1.2); with exact inner solves (5.4).
    """

    alpha: float
    Q: Array  # (m, m) metric of the multipliers
    inner: Inner = field(default_factory=Exact)
    iterations: int = 1000

    def __call__(self, problem: SaddlePoint, x: Array, y: Array) -> Array:
        """Errors (k, 2), ||x - x_k||_A and ||y - y_k||_Q of each iteration, until only rounding is left or it diverges.

        Args:
            problem: the saddle point.
            x, y: start, (n,) and (m,).
        """
        errors = [self._errors(problem, x, y)]
        for _ in range(self.iterations):
            x = self.inner.solve(problem, x, y, self.alpha, self.Q)
            y = y + self.alpha * np.linalg.solve(self.Q, problem.B @ x - problem.C @ y - problem.q)
            errors.append(self._errors(problem, x, y))
            if not NOTHING * errors[0][1] < errors[-1][1] < RUNAWAY * errors[0][1]:
                break
        return np.array(errors)

    def _errors(self, problem: SaddlePoint, x: Array, y: Array) -> tuple[float, float]:
        exact_x, exact_y = problem.solution
        return size(exact_x - x, problem.A), size(exact_y - y, self.Q)


def size(v: Array, M: Array) -> float:
    """The norm ||v||_M = (v^T M v)^(1/2)."""
    return float(np.sqrt(v @ M @ v))


def dual(v: Array, M: Array) -> float:
    """The dual norm ||v||_(M^-1) = (v^T M^-1 v)^(1/2)."""
    return float(np.sqrt(v @ np.linalg.solve(M, v)))


def measured(errors: Array, weight: float) -> tuple[float, float]:
    """Largest and asymptotic factor per iteration of the error (weight ||x||_A² + ||y||_Q²)^(1/2).

    Args:
        errors: (k, 2) of `InexactRichardson`.
        weight: of the first column.

    >>> measured(np.array([[1.0, 8.0], [1.0, 4.0], [1.0, 1.0]]), 0.0)
    (0.5, 0.35355...)
    """
    norm = np.sqrt(errors**2 @ [weight, 1.0])
    tail = min(TAIL, len(norm) - 1)
    return float(np.max(norm[1:] / norm[:-1])), float((norm[-1] / norm[-1 - tail]) ** (1 / tail))


def conjugate_gradients(A: Array, b: Array, x: Array, allowed: float) -> Array:
    """Improve x (n,) until ||b - A x||_(A^-1) <= allowed; that norm falls in every iteration."""
    r = b - A @ x
    d = r
    for _ in range(10 * len(b)):
        if dual(r, A) <= allowed:
            break
        Ad = A @ d
        before = r @ r
        step = before / (d @ Ad)
        x, r = x + step * d, r - step * Ad
        d = r + r @ r / before * d
    return x


def membrane(n: int, softness: float = 0.0, seed: int = 0) -> SaddlePoint:
    """A square membrane of n x n nodes, held on three sides, in contact along the fourth, with random loads.

    Its Delassus operator B A^-1 B^T is of order -1, as in elastic contact. Use Q = W = h I.

    Args:
        n: nodes along a side.
        softness: C = softness h I, the compliance 1/omega of the contact itself, that of a penalty.
        seed: of the loads.
    """
    h = 1 / (n + 1)
    chain = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    across, end = np.eye(n), np.eye(n)
    end[0, 0] = 0.5  # the side in contact is free and has half a cell below it
    free = chain - np.outer(np.eye(n)[0], np.eye(n)[0])
    A = np.asarray(np.kron(free, across) + np.kron(end, chain), np.float64)
    B = h * np.eye(n, n * n)
    random = np.random.default_rng(seed)
    p, q = random.normal(size=n * n), random.normal(size=n)
    return SaddlePoint(A=A, B=B, C=softness * h * np.eye(n), p=p, q=q)


NODES = 8  # along a side of the membrane
SOFTNESS = {"0": 0.0, "W/omega": 0.3}  # C; 1/omega is about the largest eigenvalue of W^-1 B A^-1 B^T
STEPS = (0.25, 0.5, 0.8, 0.99, 1.01)  # parts of the limit 2 / lambda_1
RULES: dict[str, Inner] = {
    "exact": Exact(),
    "CG, residual falls to .03": Reducing(0.03),
    "worst residual, .03": Worst(Reducing(0.03)),
    "CG, residual falls to .3": Reducing(0.3),
    "worst residual, .3": Worst(Reducing(0.3)),
    "CG, tied to .1 of the outer one": Tied(0.1),
    "worst residual tied to .1": Worst(Tied(0.1)),
}
WIDTHS = (9, 33, 9, 9, 9, 12)


def factors(problem: SaddlePoint, Q: Array, inner: Inner, part: float) -> tuple[float, float, int]:
    """Contraction factor in theory, measured factor of the last iterations, number of iterations."""
    bounds = Bounds.of(problem, Q)
    alpha = part * bounds.limit
    rate, weight = inner.rate(bounds, alpha)
    start = np.random.default_rng(1).normal(size=len(problem.q))
    errors = InexactRichardson(alpha=alpha, Q=Q, inner=inner)(problem, np.zeros(len(problem.p)), start)
    return rate, measured(errors, weight)[1], len(errors) - 1


def table() -> Iterator[tuple[str, ...]]:
    """Rows of text: C, the inner solve, alpha lambda_1 / 2, both factors, iterations."""
    for C, softness in SOFTNESS.items():
        problem = membrane(NODES, softness)
        Q = np.eye(NODES) / (NODES + 1)
        for rule, inner in RULES.items():
            for part in STEPS:
                rate, found, iterations = factors(problem, Q, inner, part)
                end = "diverges" if found > 1 else f"{iterations}"
                yield C, rule, f"{part:g}", f"{rate:.4f}", f"{found:.4f}", end


if __name__ == "__main__":
    heads = ("C", "inner solve", "a l_1/2", "theory", "measured", "iterations")
    for row in (heads, *table()):
        print("".join(cell.ljust(width) for cell, width in zip(row, WIDTHS, strict=True)).rstrip())
