"""Attempts of semismooth Newton from several starts, plain or damped, at one problem on the surface."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from stickslip.geometry.arrays import EXACT, Array
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.newton.active_set import ActiveSet, linearise
from stickslip.solvers.newton.line_search import LineSearch
from stickslip.solvers.newton.solution import OnStep, Solution, Stall, Status, Step, ignore
from stickslip.solvers.newton.starts import Start

STALL_WINDOW = 20  # iterations in which the smallest residual must halve; fronts of slip go on by a node in each
RETREATS = 6  # how often trial tractions that leave the bodies without hold are halved towards earlier ones
ATTEMPT = 60  # iterations of an attempt


class Bodies(Protocol):
    """How the bodies answer: exactly, or by a model. `u` is their displacement, in unknowns of their own."""

    def solve(self, laws: ActiveSet, p: Array, u: Array) -> tuple[Array, Array]:
        """Tractions (rows,) [Pa] and displacement that satisfy the linearised laws, from an iterate (p, u).

        Raises:
            LinAlgError: the active set leaves a rigid mode free.
        """
        ...

    def relative(self, p: Array, u: Array) -> Array:
        """Relative displacement w (rows,) [m]; affine in p (rows,) [Pa] and u together."""
        ...


@dataclass
class Attempts:
    """The attempts so far, and the best iterate of all of them.

    Where all laws are piecewise linear the next iterate of plain Newton depends on the active set alone: it arrives, or
    comes back to where it was and cycles from there on. A damped attempt looks for the length of its steps by a line
    search, and adds a proximal term to the laws that fades out with the residual, see `ActiveSet.proximal`.
    """

    problem: SurfaceProblem
    bodies: Bodies
    rtol: float
    max_it: int
    on_step: OnStep = ignore
    history: list[Step] = field(default_factory=list)
    best: Solution | None = None  # the iterate with the smallest residual; its u_c is `u` of the bodies
    stalled: bool = False  # whether the last attempt ended because the smallest residual did not halve

    @property
    def over(self) -> bool:
        """Whether the problem is solved, or the iterations ran out."""
        ran_out = len(self.history) > self.max_it
        return ran_out or (self.best is not None and self.best.status is Status.CONVERGED)

    def __call__(self, start: Start, proximal: float | None = None) -> None:
        """Iterate until it converges, cycles or stalls.

        Args:
            start: where to begin.
            proximal: weight of the proximal term of a damped attempt [-]; None: plain Newton.
        """
        problem, gamma = self.problem, start.factor * self.problem.gamma
        p, u, p_hat, known = start.p, start.u_c, start.p_hat, start.in_equilibrium
        w, held = self.bodies.relative(p, u), p_hat
        stalled, visited = Stall(STALL_WINDOW, 0.5), list[tuple[Array, Array]]()
        search, self.stalled = LineSearch(problem, gamma), False
        for k in range(ATTEMPT):
            weight = 0.0
            if known:
                residual = self._judge(p, w, u, first=k)
                if self.over or not np.isfinite(residual):
                    return
                self.stalled = k > 0 and stalled(k, residual)
                if self.stalled or (k > 0 and proximal is None and _repeats((p, w), visited)):
                    return
                visited.append((p, w))
                weight = min(1.0, residual) * (proximal or 0.0)
            solved = self._solve(p_hat, held, gamma, (p, u), weight)
            if solved is None:
                self._keep(Solution(p, w, u, Status.NO_HOLD, np.inf, ()))
                return
            p_new, u_new, held = solved
            w_new = self.bodies.relative(p_new, u_new)
            t = search(p, w, p_new, w_new) if weight else 1.0
            if t < 1.0:
                p_new, u_new, w_new = p + t * (p_new - p), u + t * (u_new - u), w + t * (w_new - w)
            p, u, w, known = p_new, u_new, w_new, True
            p_hat = p + gamma * (w - problem.gap)

    def _judge(self, p: Array, w: Array, u: Array, first: int) -> float:
        """Residual of an iterate, written down; `first`: its number if nothing was written down before."""
        residual = max(self.problem.natural_residual(p, w), self.problem.imbalance(p))
        number = self.history[-1].iteration + 1 if self.history else first
        self.history.append(Step(number, residual, self.problem.volume_solves))
        self.on_step(self.history[-1])
        if np.isnan(residual):
            status = Status.NOT_FINITE
        elif residual <= self.rtol:
            status = Status.CONVERGED
        else:
            status = Status.MAX_IT if len(self.history) > self.max_it else Status.STALLED
        self._keep(Solution(p, w, u, status, residual, ()))
        return residual

    def _keep(self, solution: Solution) -> None:
        """Keep a solution if it is the best one so far; NaN is worst."""
        if self.best is None or np.isnan(self.best.residual) or solution.residual < self.best.residual:
            self.best = solution
        elif solution.status is Status.MAX_IT:
            self.best = replace(self.best, status=Status.MAX_IT)

    def _solve(
        self, p_hat: Array, held: Array, gamma: Array, at: tuple[Array, Array], weight: float
    ) -> tuple[Array, Array, Array] | None:
        """Solve with the laws linearised at p_hat (rows,) [Pa], or nearer to `held` if the bodies are not held there.

        Args:
            p_hat: trial tractions (rows,) [Pa].
            held: trial tractions (rows,) [Pa] to go back towards, those of the last solve or of the start.
            gamma: (rows,) [Pa/m].
            at: the iterate, p (rows,) [Pa] and u.
            weight: of the proximal term [-]; 0: without.

        Returns:
            Tractions (rows,) [Pa], displacement u, and the trial tractions that were used; None if the bodies were not
            held at any of them.
        """
        for _ in range(RETREATS):
            try:
                laws = linearise(self.problem, p_hat, gamma)
                return *self.bodies.solve(laws.proximal(at[0], weight) if weight else laws, *at), p_hat
            except np.linalg.LinAlgError:
                p_hat = (p_hat + held) / 2
        return None


def _repeats(iterate: tuple[Array, Array], visited: list[tuple[Array, Array]]) -> bool:
    """Whether tractions and motion (rows,) are those of an earlier iterate: from there on the iteration cycles."""

    def same(x: Array, y: Array) -> bool:
        # relative change up to which two iterates are the same
        return bool(np.abs(x - y).max(initial=0.0) <= EXACT * np.abs(x).max(initial=0.0))

    return any(all(map(same, iterate, before)) for before in visited)
