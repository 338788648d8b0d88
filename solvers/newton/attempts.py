"""Attempts of semismooth Newton at one problem on the surface, plain or damped, and the starts that they have."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy import sparse

from stickslip.geometry.arrays import CLOSE, HALF_DIGITS, SLIGHT, Array
from stickslip.solvers.interface.limit_analysis import Mechanism, balancing_tractions
from stickslip.solvers.interface.prepare import condensed
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import QUICK, Driver, Iterate, OnStep, Solution, Stall, Status, ignore
from stickslip.solvers.newton.active_set import ActiveSet, linearise

HALVINGS = 12  # of a step


@dataclass
class LineSearch:
    """Shortens steps of tractions and displacement; w is affine in them, so that no volume solve is needed.

    The merit is the 2-norm of the complementarity residual / sqrt(gamma): an energy, and no rows have to be scaled.

    Source: Armijo, Pacific J. Math. 16 (1966).
    """

    problem: SurfaceProblem
    gamma: Array  # (rows,) [Pa/m]

    def __call__(self, p: Array, w: Array, p_new: Array, w_new: Array) -> float:
        """Share of the step from (p, w) to (p_new, w_new) to take; the one of least merit if none is small enough."""
        allowed = self._merit(p, w)
        tried: list[tuple[float, float]] = []
        for t in 0.5 ** np.arange(HALVINGS):
            merit = self._merit(p + t * (p_new - p), w + t * (w_new - w))
            if merit <= (1 - SLIGHT * t) * allowed:
                return float(t)
            tried.append((merit, float(t)))
        return min(tried)[1]

    def _merit(self, p: Array, w: Array) -> float:
        residual = self.problem.cone.natural_residual(p, w - self.problem.gap, self.gamma)
        return float(np.linalg.norm(residual / np.sqrt(self.gamma)))


@dataclass(frozen=True, kw_only=True)
class Start:
    """Starting point of an attempt."""

    p: Array  # tractions (rows,) [Pa]
    u_c: Array  # displacement (c,) [m] of the contact dofs
    p_hat: Array  # trial tractions (rows,) [Pa]
    factor: float | Array = 1.0  # that multiplies gamma
    in_equilibrium: bool = True  # whether u_c is the displacement under p
    near: bool = False  # to a solution: where its residual rises a plain attempt ends, a damped one begins to be damped
    brief: bool = False  # whether an attempt ends where its residual does not fall tenfold in a few iterations

    @staticmethod
    def at(problem: SurfaceProblem, p: Array, u_c: Array, factor: float | Array = 1.0) -> Start:
        """Start from tractions p (rows,) [Pa] and their displacement u_c (c,) [m]."""
        r = problem.relative_displacement(u_c) - problem.gap
        return Start(p=p, u_c=u_c, p_hat=p + factor * problem.gamma * r, factor=factor)

    @staticmethod
    def as_if(problem: SurfaceProblem, p: Array, answer: Array) -> Start:
        """Start from p (rows,) [Pa] with the active set of which `answer` (rows,) [Pa] would be the solution.

        What is at its friction bound slips: rounding would decide.
        """
        p_hat = answer + problem.gamma * problem.cone.give(answer)
        # relative distance from the friction bound at which a point of an answer slips
        p_hat[problem.surface.normal_rows :] *= 1 + CLOSE
        return Start(p=p, u_c=problem.u_before, p_hat=p_hat, in_equilibrium=False)

    @staticmethod
    def placed(problem: SurfaceProblem, p: Array) -> Start:
        """Start from p (rows,) [Pa], the bodies placed such that their active set holds as well as it can.

        Tractions do not determine where floating bodies are: what is closed, sticks or slips under them does. If they
        are far from a solution, they tell the active set alone.
        """
        surface, start = problem.surface, Start.as_if(problem, p, p).stuck(problem)
        if problem.give is None:
            return start
        u_c = condensed(surface).flexibility @ (problem.load.f_c - surface.forces(p))
        u_c = u_c + surface.R @ (surface.R.T @ (problem.u_before - u_c))
        laws = linearise(problem, start.p_hat, problem.gamma)
        scale = sparse.diags(1 / np.where(laws.k > 0, laws.k, problem.gamma))
        moves = scale @ laws.A_w @ (surface.N @ surface.R)
        left = scale @ (laws.rhs - laws.A_p @ p - laws.A_w @ problem.relative_displacement(u_c))
        u_c = u_c + surface.R @ np.linalg.lstsq(moves, left, rcond=HALF_DIGITS)[0]
        if problem.natural_residual(p, problem.relative_displacement(u_c)) > NEAR:
            return start
        return replace(Start.at(problem, p, u_c), in_equilibrium=False).stuck(problem)

    @staticmethod
    def where_it_stood(problem: SurfaceProblem, p: Array) -> Start:
        """Start from p (rows,) [Pa] with the bodies where they were at the end of the last step.

        What only just touches is open: rounding would decide.
        """
        r = problem.relative_displacement(problem.u_before) - problem.gap
        p_hat = p + problem.gamma * r
        p_hat[np.abs(p_hat) <= problem.scales.no_traction] = 0.0
        return Start(p=p, u_c=problem.u_before, p_hat=p_hat, in_equilibrium=False)

    def stuck(self, problem: SurfaceProblem) -> Start:
        """The same where a load or motion turns, but for what is at its friction bound: it sticks from there on."""
        tractions = np.where(np.arange(len(self.p)) < problem.surface.normal_rows, 0.0, self.p)
        if problem.turned is None or not np.array_equal(self.p, problem.turned) or not tractions.any():
            return self
        return replace(self, p_hat=self.p_hat - SLIGHT * tractions, in_equilibrium=False)


def first_starts(problem: SurfaceProblem, p: Array) -> Iterator[Start]:
    """The starts that need no excuse: the tractions of the last step.

    Where they are far from a solution, they tell the active set alone.
    Floating bodies without any start from all points closed, if the load would close them; if nothing pushes them, from
    where they stood, behind what still squeezes them.

    Args:
        problem: the contact problem of the step.
        p: tractions (rows,) [Pa] of the last step.
    """
    surface = problem.surface
    if not surface.floating:
        start = Start.at(problem, p, problem.contact_displacement(p))
        lacking = problem.natural_residual(p, problem.relative_displacement(start.u_c))
        yield (Start.as_if(problem, p, p) if p.any() and lacking > NEAR else start).stuck(problem)
        return
    if problem.p_ref == 0:  # no load and no motion: the answer is zero
        yield Start.at(problem, np.zeros_like(p), np.zeros(surface.size))
        return
    if problem.guess is not None:
        yield Start.at(problem, p, problem.guess)
    known = np.abs(p).max(initial=0.0) > problem.scales.no_traction  # what is smaller does not tell what touches
    if known:
        yield Start.placed(problem, p)
    if problem.idle:
        yield Start.where_it_stood(problem, p)
    room = problem.gap - problem.relative_displacement(problem.u_before)
    if not known and np.all(room[: surface.normal_rows] <= problem.u_ref):
        yield Start.as_if(problem, p, closed(problem))


def other_starts(problem: SurfaceProblem, p: Array) -> Iterator[Start]:
    """Further starts: zero tractions; all points closed and sticking; what balances the load on rigid bodies.

    Args:
        problem: the contact problem of the step.
        p: tractions (rows,) [Pa] of the last step.
    """
    if not problem.surface.floating and p.any():
        yield Start.at(problem, np.zeros_like(p), problem.load.free)
    yield Start.as_if(problem, p, closed(problem))
    rigid = balancing_tractions(problem) if problem.surface.floating else None
    if rigid is not None:
        yield Start.as_if(problem, rigid, rigid)


def closed(problem: SurfaceProblem) -> Array:
    """Tractions (rows,) [Pa] under which all points are closed and stick."""
    normal = problem.surface.normal_rows
    return np.concatenate([np.full(normal, problem.p_ref), np.zeros(len(problem.gap) - normal)])


def again(problem: SurfaceProblem, best: Solution) -> Start:
    """Start from the best iterate so far."""
    gap = problem.gap if best.gap is None else best.gap
    return Start(p=best.p, u_c=best.u_c, p_hat=best.p + problem.gamma * (best.w - gap))


FIRM = (1e-3, 1e-5)  # weights of the proximal term of damped attempts [-]
NEAR = 0.1  # residual of tractions that are near to a solution
RETREATS = 6  # how often trial tractions that leave the bodies without hold are halved towards earlier ones
ATTEMPT = 60  # iterations of an attempt


class Bodies(Protocol):
    """Response of the bodies: exact, or by a model. `u` is their displacement, in unknowns of their own."""

    def solve(self, laws: ActiveSet, p: Array, u: Array) -> tuple[Array, Array]:
        """Tractions (rows,) [Pa] and displacement that satisfy the linearised laws, from an iterate (p, u).

        Raises:
            LinAlgError: the active set leaves a rigid mode free.
        """
        ...

    def relative(self, p: Array, u: Array) -> Array:
        """Relative displacement w (rows,) [m]; affine in p (rows,) [Pa] and u together."""
        ...


class Attempts(Driver):
    """The attempts so far, and the best iterate of all of them; its u_c is `u` of the bodies.

    Where all laws are piecewise linear the next iterate of plain Newton depends on the active set alone: it arrives, or
    comes back to where it was and cycles from there on. Where a plain attempt was near to a solution, and then lacks
    more than all tractions, it ends. A damped attempt looks for the length of its steps by a line search, and adds a
    proximal term to the laws, see `ActiveSet.proximal`: it fades out with the residual, and tenfold with each full
    step; short ones bring it back. From near a solution it begins as plain Newton, up to the first larger residual;
    where that is as large as all tractions it goes back to the iterate before.

    Source: Levenberg, Quart. Appl. Math. 2 (1944), and Marquardt, SIAM J. 11 (1963), of the term.
    """

    def __init__(
        self, problem: SurfaceProblem, bodies: Bodies, rtol: float, max_it: int, on_step: OnStep = ignore
    ) -> None:
        super().__init__(problem.surface.counters, rtol, max_it, on_step)
        self.problem, self.bodies = problem, bodies
        self.follows = False  # whether `SurfaceProblem.touch` is asked after each solve
        self.collapse: Mechanism | None = None  # that is met on the way

    def follow(self, chain: Iterator[tuple[Start, float | None]]) -> Solution:
        """Make attempts until one is enough; the best iterate, with the history of all.

        Args:
            chain: arguments of each attempt.
        """
        for start, proximal in chain:
            self(start, proximal)
            if self.over:
                break
        if self.collapse is not None and (self.best is None or self.best.status is not Status.CONVERGED):
            motion, lacking = self.collapse
            nothing, history = np.zeros_like(self.problem.gap), tuple(self.history)
            return Solution(nothing, nothing, motion, Status.GIVES_WAY, np.inf, history, lacking=lacking)
        assert self.best is not None
        return replace(self.best, history=tuple(self.history))

    def __call__(self, start: Start, proximal: float | None = None) -> None:
        """Iterate until it converges, cycles or stalls.

        Args:
            start: where to begin.
            proximal: weight of the proximal term of a damped attempt [-]; None: plain Newton.
        """
        number = self.last + start.in_equilibrium if self.history else 0  # of the start
        window = Stall(QUICK // 3, number, 0.1) if start.brief else Stall(QUICK if proximal else QUICK // 2, number)

        def stalls(k: int, residual: float) -> bool:
            lost = proximal is None and window.least < NEAR and residual > 1  # it was near, and is nowhere
            return window(k, residual) or lost

        found = self.run(self.iterates(start, proximal or 0.0, number), stalls, cycles=proximal is None)
        if found.status is Status.NO_HOLD and (self.best is None or np.isnan(self.best.residual)):
            w = self.bodies.relative(start.p, start.u_c)
            self.best = Solution(start.p, w, start.u_c, Status.NO_HOLD, np.inf, ())

    def judged(self, number: int, p: Array, w: Array, u: Array) -> Iterate:
        """Iterate of that number at a state; while it `follows`, slip counts from where points touch in the best."""
        problem = self.problem
        residual = max(problem.natural_residual(p, w), problem.imbalance(p))
        if self.follows and problem.touch and not (self.best is not None and residual > self.best.residual):
            gap = problem.touch(p, w, problem.gap)
            if gap is not problem.gap:
                problem = self.problem = replace(problem, gap=gap)
                residual = max(problem.natural_residual(p, w), problem.imbalance(p))
        return Iterate(number, residual, p, w, u, problem.gap if problem.touch else None)

    def iterates(self, start: Start, proximal: float, number: int) -> Iterator[Iterate]:
        """Iterates of one attempt, see `Attempts`.

        Args:
            start: where to begin.
            proximal: weight of the proximal term [-]; 0: plain Newton.
            number: of the start.
        """
        problem, gamma = self.problem, start.factor * self.problem.gamma
        p, u, p_hat, known = start.p, start.u_c, start.p_hat, start.in_equilibrium
        w, held = self.bodies.relative(p, u), p_hat
        search, rises, least, firm, best = LineSearch(problem, gamma), not start.near, np.inf, proximal, (p, u, w)
        for k in range(number, number + ATTEMPT):
            weight = 0.0
            if known:
                x = self.judged(k, p, w, u)
                # what other pairs leave the tolerance may hide, and it would be passed on from search to search; of a
                # start that is near a loose one may hide what the next active set shows
                hidden = start.near and k == number + (not start.in_equilibrium) and x.residual > HALF_DIGITS
                yield replace(x, enough=False) if hidden or (problem.guess is not None and k == 0) else x
                if self.problem is not problem:
                    problem, least = self.problem, np.inf
                    search = LineSearch(problem, gamma)
                if start.near and not proximal and x.residual > least:
                    return
                if not rises and proximal and x.residual > 1 > least:
                    rises, (p, u, w) = True, best
                else:
                    rises, least, best = rises or x.residual > least, x.residual, (p, u, w)
                p_hat = p + gamma * (w - problem.gap)
                weight = min(1.0, least) * firm * rises
            solved = self._solve(p_hat, held, gamma, (p, u), weight)
            if solved is None and start.near and proximal and not weight:  # it holds what the active set leaves free
                solved = self._solve(p_hat, held, gamma, (p, u), weight := min(1.0, least) * firm)
            if solved is None:
                return
            p_new, u_new, held = solved
            w_new = self.bodies.relative(p_new, u_new)
            t = search(p, w, p_new, w_new) if weight else 1.0
            if weight:
                firm = firm / 10 if t == 1.0 else min(firm * 10, proximal) if t < 0.1 else firm
            if t < 1.0:
                p_new, u_new, w_new = p + t * (p_new - p), u + t * (u_new - u), w + t * (w_new - w)
            p, u, w, known = p_new, u_new, w_new, True

    def solved(self, laws: ActiveSet, p: Array, u: Array, weight: float) -> tuple[Array, Array]:
        """Tractions (rows,) [Pa] and displacement by linearised laws; weight [-] of a proximal term to p and u."""
        return self.bodies.solve(laws.proximal(p, weight, self.problem.gamma, weight) if weight else laws, p, u)

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
                return *self.solved(laws, *at, weight), p_hat
            except np.linalg.LinAlgError:
                p_hat = (p_hat + held) / 2
        return None
