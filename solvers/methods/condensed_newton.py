"""Semismooth Newton on the condensed surface problem: the laws are linearised, the bodies stay exact."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from geometry.arrays import Array
from solvers.interface.limit_analysis import balancing_tractions
from solvers.interface.problem import SurfaceProblem
from solvers.methods.applicability import Applicability
from solvers.methods.method import Stateless, Turn
from solvers.newton import condensed_system as newton_system
from solvers.newton.active_set import linearise
from solvers.newton.solution import OnStep, Solution, Status, Step, ignore

STALL_WINDOW = 12  # iterations in which the least residual must halve
RETREATS = 6  # times that trial tractions under which nothing holds the bodies are taken back by half
ATTEMPT = 60  # iterations before another start is tried


@dataclass(frozen=True, kw_only=True)
class CondensedNewton(Stateless):
    """Solves p = P_C(p + gamma (w - gap)) for tractions and contact displacement together.

    Which point sticks, slips or is open follows from the trial tractions p_hat = p + gamma (w - gap),
    gamma = E / depth; an iteration that cycles starts again elsewhere before the step is given up.

    Source: Alart & Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991); Hüeber, Stadler & Wohlmuth,
    SIAM J. Sci. Comput. 30 (2008).
    """

    NAME: ClassVar = "condensed-newton"
    WHEN: ClassVar = "1–16 iterations at every mesh size tried, hard to break; needs the condensed form"
    WORKS_WITH: ClassVar = Applicability(floating=True, matrix_free=False)
    ROW: ClassVar = 1
    TURNS: ClassVar = (Turn("condensed", 1),)

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        history: list[Step] = []
        best: Solution | None = None
        for start in _starts(problem, p):
            attempt = self._attempt(problem, start, history, on_step)
            if best is None or attempt.status is Status.CONVERGED or attempt.residual < best.residual:
                best = attempt
            if attempt.status is Status.CONVERGED or len(history) > self.max_it:
                break
        assert best is not None
        return replace(best, history=tuple(history))

    def _attempt(self, problem: SurfaceProblem, start: Start, history: list[Step], on_step: OnStep) -> Solution:
        p, u_c, gamma = start.p, start.u_c, start.factor * problem.gamma
        w = problem.relative_displacement(u_c)
        p_hat = start.p_hat
        least, found_at, status = np.inf, 0, Status.STALLED
        held = start.p_hat
        for k in range(ATTEMPT):
            residual = np.inf  # until w belongs to p
            if k or start.in_equilibrium:
                residual = problem.natural_residual(p, w)
                history.append(Step(history[-1].iteration + 1 if history else k, residual, problem.volume_solves))
                on_step(history[-1])
            if np.isnan(residual):
                status = Status.NOT_FINITE
                break
            if residual <= self.rtol:
                status = Status.CONVERGED
                break
            if len(history) > self.max_it:
                status = Status.MAX_IT
                break
            if residual < least / 2:
                least, found_at = residual, k
            elif k - found_at > STALL_WINDOW:
                break
            solved = _solve(problem, p_hat, held, gamma)
            if solved is None:
                status = Status.NO_HOLD
                break
            p, u_c, held = solved
            w = problem.relative_displacement(u_c)
            p_hat = p + gamma * (w - problem.gap)
        return Solution(p, w, u_c, status, residual, ())


@dataclass(frozen=True)
class Start:
    """Where an attempt begins."""

    p: Array  # (rows,) [Pa]
    u_c: Array  # (c,) [m]
    p_hat: Array  # trial tractions (rows,) [Pa]
    factor: float  # of gamma
    in_equilibrium: bool  # whether u_c belongs to p


def _starts(problem: SurfaceProblem, p: Array) -> Iterator[Start]:
    """From the last step's tractions, from none, from everything closed and sticking; then with another gamma.

    Tractions of a floating body have no displacement of their own: which points they press says enough. Where it has
    room to move, closing everything pulls more than its load presses: it starts from tractions that hold rigid bodies.
    """
    normal = problem.surface.normal_rows
    nowhere = np.zeros(problem.surface.size)
    if problem.surface.floating and problem.p_ref == 0:  # no load, no motion: nothing happens
        yield Start(np.zeros_like(p), nowhere, np.zeros_like(p), 1.0, True)
        return
    if problem.surface.floating and p.any():
        yield Start(p, nowhere, p, 1.0, False)
    closed = np.concatenate([np.full(normal, problem.p_ref), np.zeros(len(p) - normal)])
    rigid: Array | None = None
    for factor in (1.0, 0.1, 10.0):
        for tractions in [] if problem.surface.floating else [p, np.zeros_like(p)] if p.any() else [p]:
            u_c = problem.contact_displacement(tractions)
            r = problem.relative_displacement(u_c) - problem.gap
            yield Start(tractions, u_c, tractions + factor * problem.gamma * r, factor, True)
        yield Start(p, nowhere, closed, factor, False)
        if problem.surface.floating:
            rigid = balancing_tractions(problem) if rigid is None else rigid
            if rigid is not None:
                yield Start(rigid, nowhere, rigid, factor, False)


def _solve(problem: SurfaceProblem, p_hat: Array, held: Array, gamma: Array) -> tuple[Array, Array, Array] | None:
    """Tractions and displacement of the laws linearised at p_hat, or as near to it as they hold the bodies.

    Going back is towards trial tractions that did. Returns also where it was; None if nowhere.
    """
    for _ in range(RETREATS):
        try:
            return *newton_system.solve(linearise(problem, p_hat, gamma)), p_hat
        except np.linalg.LinAlgError:
            p_hat = (p_hat + held) / 2
    return None
