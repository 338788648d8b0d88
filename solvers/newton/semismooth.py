"""Semismooth Newton on the surface problem: contact laws are linearised, the bodies are solved exactly."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from stickslip.geometry.arrays import Array
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import OnStep, Solution, ignore
from stickslip.solvers.newton.active_set import ActiveSet
from stickslip.solvers.newton.attempts import FIRM, Attempts, Start, again, first_starts
from stickslip.solvers.newton.path import path_from_open

Linear = Callable[[ActiveSet, Array], tuple[Array, Array]]  # linearised laws, u_c of the iterate: p [Pa] and u_c [m]


@dataclass(frozen=True, kw_only=True)
class SemismoothNewton:
    """Solves p = P_C(p + gamma (w - gap)) for tractions and contact displacement together.

    The active set (stick, slip, open) follows from the trial tractions p_hat = p + gamma (w - gap), gamma = E / depth.
    Plain Newton comes first. Where two contacts press on an edge that bodies share, as under a bolt's head, their rows
    almost depend on each other: it then hops between active sets of a few such points, and is damped from the best
    iterate on, see `Attempts`. If it fails otherwise, it is damped from the start; then follow the ends of the path
    that leads there in the plane, see `path`, and damped attempts from the best iterate, before the step counts as
    failed. None of this costs a volume solve but starts whose displacement is not known.

    Source: Alart & Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991); Hüeber, Stadler & Wohlmuth,
    SIAM J. Sci. Comput. 30 (2008). Proximal term: Rockafellar, SIAM J. Control Optim. 14 (1976).
    """

    rtol: float
    max_it: int
    linear: Linear  # solves the bodies with the linearised laws; LinAlgError: the active set leaves a rigid mode free

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        attempt = Attempts(problem, _Exact(problem, self.linear), self.rtol, self.max_it, on_step)
        return attempt.follow(self._chain(problem, p, attempt))

    def _chain(self, problem: SurfaceProblem, p: Array, attempts: Attempts) -> Iterator[tuple[Start, float | None]]:
        """Starts, and the weight of the proximal term of a damped attempt; None: plain Newton.

        Args:
            problem: the contact problem of the step.
            p: tractions (rows,) [Pa] of the last step.
            attempts: those so far.
        """
        firsts = []
        for start in first_starts(problem, p):
            firsts.append(start)
            yield start, None
            if attempts.stalled and attempts.best is not None:
                yield again(problem, attempts.best), 1e-2
        for proximal in FIRM:
            yield firsts[-1], proximal
        for start in path_from_open(problem):
            yield start, None
        for proximal in FIRM:
            assert attempts.best is not None
            yield again(problem, attempts.best), proximal


@dataclass(frozen=True)
class _Exact:
    """The bodies, solved exactly: u is the displacement of the contact dofs."""

    problem: SurfaceProblem
    linear: Linear

    def solve(self, laws: ActiveSet, p: Array, u: Array) -> tuple[Array, Array]:
        return self.linear(laws, u)

    def relative(self, p: Array, u: Array) -> Array:
        return self.problem.relative_displacement(u)
