"""The contact problem with a guess of the flexibility, solved on the surface alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solvers.methods.linearised_laws import LinearisedLaws, linearise
from solvers.surface_problem import SurfaceProblem

Array = NDArray[np.float64]
RETREATS = 6  # times that trial tractions under which nothing holds the bodies are taken back by half
ATTEMPT = 30  # Newton iterations from one start
BALANCE = 1e-8  # force out of balance, relative, at which a solution of the linear system is none


@dataclass(frozen=True)
class SurfaceModel:
    """w(q, b) = w - G (q - p) + N R b about a point p where w is known, with R^T (f - B^T q) = 0."""

    problem: SurfaceProblem
    G: Array  # N F N^T W (rows, rows) [m/Pa]
    p: Array  # (rows,)
    w: Array  # (rows,)

    def at(self, p: Array, b: Array) -> Array:
        """w (rows,) at tractions p and rigid motions b (r,)."""
        surface = self.problem.surface
        return np.asarray(self.w - self.G @ (p - self.p) + surface.N @ (surface.R @ b))

    def solve(self, start: Array, gamma: Array, enough: float) -> tuple[Array, Array, float] | None:
        """Tractions and rigid motions by semismooth Newton from trial tractions, and the model's residual there.

        None if the linearised laws hold the bodies nowhere.
        """
        best: tuple[Array, Array, float] | None = None
        p_hat = held = start
        for _ in range(ATTEMPT):
            found = self._newton(p_hat, held, gamma)
            if found is None:
                break
            p, b, held = found
            w = self.at(p, b)
            residual = self.problem.natural_residual(p, w)
            if best is None or residual < best[2]:
                best = p, b, residual
            if residual <= enough:
                break
            p_hat = p + gamma * (w - self.problem.gap)
        return best

    def _newton(self, p_hat: Array, held: Array, gamma: Array) -> tuple[Array, Array, Array] | None:
        """As near to trial tractions as the laws linearised there hold the bodies; where that was."""
        for _ in range(RETREATS):
            try:
                return *self._step(linearise(self.problem, p_hat, gamma)), p_hat
            except np.linalg.LinAlgError:
                p_hat = (p_hat + held) / 2
        return None

    def _step(self, laws: LinearisedLaws) -> tuple[Array, Array]:
        """Tractions and rigid motions that satisfy the linearised laws; the open rows carry nothing.

        Raises:
            LinAlgError: the carried rows do not hold the bodies.
        """
        surface, gap = self.problem.surface, self.problem.gap
        carried, springs = np.flatnonzero(laws.carried), np.flatnonzero(laws.k)
        rows = np.concatenate([carried, springs])
        w_0, NR = self.w + self.G @ self.p, surface.N @ surface.R
        # carried: A_p p + A_w (w_0 - G p + N R b) = rhs; springs: p / k + G p - N R b = p_0 / k - gap + w_0
        system = (laws.A_p[:, rows] - laws.A_w @ self.G[:, rows], laws.A_w @ NR)
        spring = (self.G[np.ix_(springs, rows)].copy(), -NR[springs])
        spring[0][np.arange(len(springs)), len(carried) + np.arange(len(springs))] += 1 / laws.k[springs]
        hold = NR[rows].T * surface.W[rows]
        matrix = np.block([[np.asarray(system[0]), system[1]], list(spring), [hold, np.zeros((len(hold), len(hold)))]])
        load = self.problem.load.resultant
        right = np.concatenate(
            [laws.rhs - laws.A_w @ w_0, (laws.p_0 / np.where(laws.k > 0, laws.k, 1) - gap + w_0)[springs], load]
        )
        found = np.linalg.solve(matrix, right)
        p = np.zeros(len(self.p))
        p[rows] = found[: len(rows)]
        if np.abs(load - surface.R.T @ surface.forces(p)).sum() > BALANCE * np.abs(surface.forces(p)).sum():
            raise np.linalg.LinAlgError("the system is singular: some rigid motion is not held")
        return p, found[len(rows) :]
