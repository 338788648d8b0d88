"""Semismooth Newton on the surface problem: contact laws are linearised, the bodies are solved exactly."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from geometry.arrays import Array
from solvers.interface.limit_analysis import balancing_tractions
from solvers.interface.problem import SurfaceProblem
from solvers.newton.active_set import ActiveSet, linearise
from solvers.newton.solution import OnStep, Solution, Stall, Status, Step, ignore

STALL_WINDOW = 12  # iterations in which the smallest residual must halve
RETREATS = 6  # how often trial tractions that leave the bodies without hold are halved towards earlier ones
ATTEMPT = 60  # iterations before another start is tried


Linear = Callable[[ActiveSet], tuple[Array, Array]]  # linearised laws to p (rows,) [Pa] and u_c (c,) [m]


@dataclass(frozen=True, kw_only=True)
class SemismoothNewton:
    """Solves p = P_C(p + gamma (w - gap)) for tractions and contact displacement together.

    The active set (stick, slip, open) follows from the trial tractions p_hat = p + gamma (w - gap), gamma = E / depth.
    If the iteration cycles, it is restarted from other trial tractions before the step counts as failed.

    Source: Alart & Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991); Hüeber, Stadler & Wohlmuth,
    SIAM J. Sci. Comput. 30 (2008).
    """

    rtol: float
    max_it: int
    linear: Linear  # solves the bodies with the linearised laws; LinAlgError: the active set leaves a rigid mode free

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
        status, stalled = Status.STALLED, Stall(STALL_WINDOW, 0.5)
        held = start.p_hat
        for k in range(ATTEMPT):
            residual = np.inf  # not defined until w is the displacement under p
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
            if stalled(k, residual):
                break
            solved = self._solve(problem, p_hat, held, gamma)
            if solved is None:
                status = Status.NO_HOLD
                break
            p, u_c, held = solved
            w = problem.relative_displacement(u_c)
            p_hat = p + gamma * (w - problem.gap)
        return Solution(p, w, u_c, status, residual, ())

    def _solve(
        self, problem: SurfaceProblem, p_hat: Array, held: Array, gamma: Array
    ) -> tuple[Array, Array, Array] | None:
        """Solve with the laws linearised at p_hat (rows,) [Pa], or nearer to `held` if the bodies are not held there.

        Args:
            p_hat: trial tractions (rows,) [Pa].
            held: trial tractions (rows,) [Pa] to go back towards, those of the last solve or of the start.
            gamma: (rows,) [Pa/m].

        Returns:
            Tractions (rows,) [Pa], contact displacement (c,) [m], and the trial tractions that were used; None if the
            bodies were not held at any of them.
        """
        for _ in range(RETREATS):
            try:
                return *self.linear(linearise(problem, p_hat, gamma)), p_hat
            except np.linalg.LinAlgError:
                p_hat = (p_hat + held) / 2
        return None


@dataclass(frozen=True)
class Start:
    """Starting point of an attempt."""

    p: Array  # tractions (rows,) [Pa]
    u_c: Array  # displacement (c,) [m] of the contact dofs
    p_hat: Array  # trial tractions (rows,) [Pa]
    factor: float  # that multiplies gamma
    in_equilibrium: bool  # whether u_c is the displacement under p


def _starts(problem: SurfaceProblem, p: Array) -> Iterator[Start]:
    """Starts in order: tractions of the last step; zero tractions; all points closed and sticking; with another gamma.

    For a floating body tractions do not determine the displacement: they only give the active set to start from. If it
    has room to move, closing all points would pull more than the load presses: it also starts from tractions that
    balance the load on rigid bodies.

    Args:
        p: tractions (rows,) [Pa] of the last step.
    """
    normal = problem.surface.normal_rows
    nowhere = np.zeros(problem.surface.size)
    if problem.surface.floating and problem.p_ref == 0:  # no load and no motion: the answer is zero
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
