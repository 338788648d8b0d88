"""Semismooth Newton on the surface problem: contact laws are linearised, the bodies are solved exactly."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain

from stickslip.geometry.arrays import Array
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.newton import path, simpler_laws
from stickslip.solvers.newton.active_set import ActiveSet
from stickslip.solvers.newton.attempts import Attempts
from stickslip.solvers.newton.solution import OnStep, Solution, ignore
from stickslip.solvers.newton.starts import Start, again, first_starts, other_starts

HOPPING = 1e-2  # weight of the proximal term where plain Newton hops between active sets [-]
FIRM = (1e-3, 1e-5)  # weights of the proximal term from the first start [-]
FIRMER = (1e-3, 1e-4, 1e-2, 1e-6, 1e-5)  # likewise from the best iterate so far

Linear = Callable[[ActiveSet, Array], tuple[Array, Array]]  # linearised laws, u_c of the iterate: p [Pa] and u_c [m]


@dataclass(frozen=True, kw_only=True)
class SemismoothNewton:
    """Solves p = P_C(p + gamma (w - gap)) for tractions and contact displacement together.

    The active set (stick, slip, open) follows from the trial tractions p_hat = p + gamma (w - gap), gamma = E / depth.
    Plain Newton comes first. Where two contacts press on an edge that bodies share, as under a bolt's head, their rows
    almost depend on each other: it then hops between active sets of a few such points, and is damped from the best
    iterate on, see `Attempts`. If it fails otherwise, it is damped from the start; then follow the ends of paths, see
    `path`, solutions with simpler laws, see `simpler_laws`, and other trial tractions to start from, before the step
    counts as failed. None of this costs a volume solve but starts whose displacement is not known.

    Source: Alart & Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991); Hüeber, Stadler & Wohlmuth,
    SIAM J. Sci. Comput. 30 (2008). Proximal term: Rockafellar, SIAM J. Control Optim. 14 (1976).
    """

    rtol: float
    max_it: int
    linear: Linear  # solves the bodies with the linearised laws; LinAlgError: the active set leaves a rigid mode free

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        attempt = Attempts(problem, _Exact(problem, self.linear), self.rtol, self.max_it, on_step)
        for start, proximal in self._chain(problem, p, attempt):
            attempt(start, proximal)
            if attempt.over:
                break
        assert attempt.best is not None
        return replace(attempt.best, history=tuple(attempt.history))

    def _chain(self, problem: SurfaceProblem, p: Array, attempts: Attempts) -> Iterator[tuple[Start, float | None]]:
        """Starts, and the weight of the proximal term of a damped attempt; None: plain Newton.

        Args:
            problem: the contact problem of the step.
            p: tractions (rows,) [Pa] of the last step.
            attempts: those so far.
        """
        firsts = []
        for start in chain(simpler_laws.resting(problem, p, self), first_starts(problem, p)):
            firsts.append(start)
            yield start, None
            if attempts.stalled and attempts.best is not None:
                yield again(problem, attempts.best), HOPPING
        for proximal in FIRM:
            yield firsts[-1], proximal
        assert attempts.best is not None
        for start in path.ends(problem, p, attempts.best):
            yield start, None
            if problem.surface.floating:  # next to nothing may hold them
                yield start, FIRM[-1]
        for start in simpler_laws.ends(problem, attempts.best.p, self):
            yield start, None
        for proximal in FIRMER:
            yield again(problem, attempts.best), proximal
        for start in other_starts(problem, p):
            yield start, None


@dataclass(frozen=True)
class _Exact:
    """The bodies, solved exactly: u is the displacement of the contact dofs."""

    problem: SurfaceProblem
    linear: Linear

    def solve(self, laws: ActiveSet, p: Array, u: Array) -> tuple[Array, Array]:
        return self.linear(laws, u)

    def relative(self, p: Array, u: Array) -> Array:
        return self.problem.relative_displacement(u)
