"""Semismooth Newton on the surface problem: contact laws are linearised, the bodies are solved exactly."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from geometry.arrays import Array
from solvers.interface.problem import SurfaceProblem
from solvers.newton import path
from solvers.newton.active_set import ActiveSet, linearise
from solvers.newton.line_search import LineSearch
from solvers.newton.solution import OnStep, Solution, Stall, Status, Step, ignore
from solvers.newton.starts import Start, again, first_starts, other_starts

STALL_WINDOW = 20  # iterations in which the smallest residual of a damped attempt must halve
SAME = 1e-10  # relative change of all tractions up to which two iterates are the same
RETREATS = 6  # how often trial tractions that leave the bodies without hold are halved towards earlier ones
ATTEMPT = 60  # iterations before another start is tried
FIRM = (1e-3, 1e-5)  # weights of the proximal term from the first start [-]
FIRMER = (1e-3, 1e-4, 1e-2, 1e-6, 1e-5)  # likewise from the best iterate so far


Linear = Callable[[ActiveSet], tuple[Array, Array]]  # linearised laws to p (rows,) [Pa] and u_c (c,) [m]


@dataclass(frozen=True, kw_only=True)
class SemismoothNewton:
    """Solves p = P_C(p + gamma (w - gap)) for tractions and contact displacement together.

    The active set (stick, slip, open) follows from the trial tractions p_hat = p + gamma (w - gap), gamma = E / depth.
    Plain Newton comes first. Where all laws are piecewise linear its next iterate depends on the active set alone, so
    it ends with the solution or repeats a set, and then cycles. Then it is damped: a line search that does not ask for
    descent in every iteration, and a proximal term, w - epsilon (p - p_old) / gamma in place of w, with less and less
    weight. Neither costs a volume solve. After that come paths (see `path`) and other trial tractions to start from,
    before the step counts as failed.

    Source: Alart & Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991); Hüeber, Stadler & Wohlmuth,
    SIAM J. Sci. Comput. 30 (2008). Proximal term: Rockafellar, SIAM J. Control Optim. 14 (1976).
    """

    rtol: float
    max_it: int
    linear: Linear  # solves the bodies with the linearised laws; LinAlgError: the active set leaves a rigid mode free

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        run = _Run(self, problem, on_step)
        for start, proximal in _attempts(problem, p, run):
            run.attempt(start, proximal)
            if run.over:
                break
        assert run.best is not None
        return replace(run.best, history=tuple(run.history))


def _attempts(problem: SurfaceProblem, p: Array, run: _Run) -> Iterator[tuple[Start, float | None]]:
    """Starts, and the weight of the proximal term of a damped attempt; None: plain Newton."""
    firsts = []
    for start in first_starts(problem, p):
        firsts.append(start)
        yield start, None
    for proximal in FIRM:
        yield firsts[-1], proximal
    assert run.best is not None
    for start in path.ends(problem, p, run.best):
        yield start, None
    for proximal in FIRMER:
        yield again(problem, run.best), proximal
    for start in other_starts(problem, p):
        yield start, None


@dataclass
class _Run:
    """The attempts at one step."""

    newton: SemismoothNewton
    problem: SurfaceProblem
    on_step: OnStep
    history: list[Step] = field(default_factory=list)
    best: Solution | None = None  # the iterate with the smallest residual

    @property
    def over(self) -> bool:
        """Whether the step is solved, or the iterations ran out."""
        ran_out = len(self.history) > self.newton.max_it
        return ran_out or (self.best is not None and self.best.status is Status.CONVERGED)

    def attempt(self, start: Start, proximal: float | None) -> None:
        """Iterate from a start until it converges or cycles; damped if there is a weight of the proximal term."""
        problem, gamma = self.problem, start.factor * self.problem.gamma
        p, u_c, p_hat, known = start.p, start.u_c, start.p_hat, start.in_equilibrium
        w, held = problem.relative_displacement(u_c), p_hat
        stalled, search, visited = Stall(STALL_WINDOW, 0.5), LineSearch(problem, gamma), list[Array]()
        for k in range(ATTEMPT):
            if known:
                residual = self._judge(p, w, u_c, first=k)
                if self.over or not np.isfinite(residual):
                    return
                if k > 0 and (_repeats(p, visited) if proximal is None else stalled(k, residual)):
                    return
                visited.append(p)
            weight = proximal * min(1.0, residual) if proximal and known else None
            solved = self._solve(p_hat, held, gamma, p, u_c, weight)
            if solved is None:
                self._keep(Solution(p, w, u_c, Status.NO_HOLD, np.inf, ()))
                return
            p_new, u_new, held = solved
            w_new = problem.relative_displacement(u_new)
            if proximal is not None and known:
                t = search(p, w, p_new, w_new)
                p_new, u_new, w_new = p + t * (p_new - p), u_c + t * (u_new - u_c), w + t * (w_new - w)
            p, u_c, w, known = p_new, u_new, w_new, True
            p_hat = p + gamma * (w - problem.gap)

    def _judge(self, p: Array, w: Array, u_c: Array, first: int) -> float:
        """Residual of an iterate, written down; `first`: its number if nothing was written down before."""
        residual = max(self.problem.natural_residual(p, w), self.problem.imbalance(p))
        number = self.history[-1].iteration + 1 if self.history else first
        self.history.append(Step(number, residual, self.problem.volume_solves))
        self.on_step(self.history[-1])
        if np.isnan(residual):
            status = Status.NOT_FINITE
        elif residual <= self.newton.rtol:
            status = Status.CONVERGED
        else:
            status = Status.MAX_IT if len(self.history) > self.newton.max_it else Status.STALLED
        self._keep(Solution(p, w, u_c, status, residual, ()))
        return residual

    def _keep(self, solution: Solution) -> None:
        """Keep a solution if it is the best one so far."""
        if self.best is None or not self.best.residual <= solution.residual:
            self.best = solution
        elif solution.status is Status.MAX_IT:
            self.best = replace(self.best, status=Status.MAX_IT)

    def _solve(
        self, p_hat: Array, held: Array, gamma: Array, p: Array, u_c: Array, proximal: float | None
    ) -> tuple[Array, Array, Array] | None:
        """Solve with the laws linearised at p_hat (rows,) [Pa], or nearer to `held` if the bodies are not held there.

        Args:
            p_hat: trial tractions (rows,) [Pa].
            held: trial tractions (rows,) [Pa] to go back towards, those of the last solve or of the start.
            gamma: (rows,) [Pa/m].
            p: tractions (rows,) [Pa] of the iterate.
            u_c: displacement (c,) [m] of the iterate.
            proximal: weight of the proximal term [-]; None: without.

        Returns:
            Tractions (rows,) [Pa], contact displacement (c,) [m], and the trial tractions that were used; None if the
            bodies were not held at any of them.
        """
        for _ in range(RETREATS):
            try:
                laws = linearise(self.problem, p_hat, gamma)
                if proximal is not None:
                    laws = laws.proximal(p, u_c, proximal)
                return *self.newton.linear(laws), p_hat
            except np.linalg.LinAlgError:
                p_hat = (p_hat + held) / 2
        return None


def _repeats(p: Array, visited: list[Array]) -> bool:
    """Whether the tractions p (rows,) [Pa] are those of an earlier iterate: from there on the iteration cycles."""
    allowed = SAME * np.abs(p).max(initial=0.0)
    return any(np.abs(p - before).max(initial=0.0) <= allowed for before in visited)
