"""Semismooth Newton on the surface problem: contact laws are linearised, the bodies are solved exactly."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import ClassVar

import numpy as np

from stickslip.geometry.arrays import SLIGHT, Array
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.limit_analysis import Mechanism
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import OnStep, Solution, Status, ignore
from stickslip.solvers.laws.law import NormalLaw
from stickslip.solvers.newton import condensed_system, path
from stickslip.solvers.newton.active_set import ActiveSet
from stickslip.solvers.newton.attempts import (
    ATTEMPT,
    FIRM,
    Attempts,
    Start,
    again,
    closed,
    first_starts,
    other_starts,
)
from stickslip.solvers.newton.collapse import on_softer_springs
from stickslip.solvers.newton.interior_point import way
from stickslip.solvers.newton.rigid_bodies import at_rest
from stickslip.solvers.newton.settling import settled
from stickslip.solvers.newton.soft_start import soft_starts

Linear = Callable[[ActiveSet, Array], tuple[Array, Array]]  # linearised laws, u_c of the iterate: p [Pa] and u_c [m]


@dataclass(frozen=True, kw_only=True)
class SemismoothNewton:
    """Solves p = P_C(p + gamma (w - gap)) for tractions and contact displacement together.

    The active set (stick, slip, open) follows from the trial tractions p_hat = p + gamma (w - gap), gamma = E / depth.
    Plain Newton comes first, but where bodies have room to move; from a start that it hops about it is damped from the
    best iterate on, see `Attempts`. Then come places where rigid bodies would rest, see `rigid_bodies`: of floating
    bodies by an interior point that begins there, see `interior_point`, and they settle from there, see `settling`;
    other trial tractions; and the ends of paths, see `path`, before the step counts as failed. None of this costs a
    volume solve but starts whose displacement is not known.

    Source: Alart & Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991); Hüeber, Stadler & Wohlmuth,
    SIAM J. Sci. Comput. 30 (2008). Proximal term: Rockafellar, SIAM J. Control Optim. 14 (1976).
    """

    rtol: float
    max_it: int
    linear: Linear  # solves the bodies with the linearised laws; LinAlgError: the active set leaves a rigid mode free

    def __call__(self, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
        attempt = Attempts(problem, _Exact(problem, self.linear), self.rtol, self.max_it, on_step)
        attempt.follows = True
        return attempt.follow(self._chain(problem, p, attempt))

    def _on_springs(self, problem: SurfaceProblem, start: Start) -> Solution:
        attempts = Attempts(problem, _Exact(problem, self.linear), self.rtol, min(self.max_it, 4 * ATTEMPT))
        return attempts.follow(chain([(start, None)], self._chain(problem, start.p, attempts)))

    def _chain(self, problem: SurfaceProblem, p: Array, attempts: Attempts) -> Iterator[tuple[Start, float | None]]:
        """Starts, and the weight of the proximal term of a damped attempt; None: plain Newton.

        Args:
            problem: the contact problem of the step.
            p: tractions (rows,) [Pa] of the last step.
            attempts: those so far.
        """
        for start in chain(resting_start(problem, p, self), first_starts(problem, p)):
            yield start, None
            if attempts.stalled and attempts.best is not None:
                yield again(problem, attempts.best), FIRM[0]
        yield from into_contact(attempts)
        if attempts.over:
            return
        attempts.problem, attempts.follows = problem, False
        for found in on_softer_springs(problem, p, self._on_springs):
            if not isinstance(found, Mechanism):
                yield found, None
                continue
            attempts.collapse = found
            if p.any():  # the load from which it is so is looked for; bodies at rest may be held in other ways
                return
        for start in other_starts(problem, p):
            yield start, None
        assert attempts.best is not None
        for start in path.ends(problem, p, attempts.best):
            yield start, None


def into_contact(attempts: Attempts) -> Iterator[tuple[Start, float | None]]:
    """Where an interior point leads floating bodies from where rigid ones would rest, and where they settle from there.

    Where the interior point is slow a damped attempt from the rest itself comes first. Bodies that are held, or whose
    rest is not found, begin from soft contact: of the solutions of held ones an interior point may find another than
    the history does.

    Args:
        attempts: those so far.
    """
    before, rest = (attempts.best, attempts.problem), at_rest(attempts)
    for start in way(attempts, rest) if rest else ():
        if start is None and rest:
            attempts.best, attempts.problem = before
            yield replace(rest, brief=True), FIRM[0]
            if attempts.over:
                return
            attempts.best, attempts.problem = before
        elif start:
            yield start, None
            if not attempts.over and attempts.best and attempts.best.residual < SLIGHT:
                yield replace(again(attempts.problem, attempts.best), near=True, brief=True), FIRM[0]
    if attempts.over:
        return
    attempts.best, attempts.problem = before  # residuals are small on the way, however far it is where it fails
    for start in [rest] if rest else soft_starts(attempts):
        for place in settled(attempts, start):
            yield place, None
        yield start, FIRM[0]


@dataclass(frozen=True)
class _Exact:
    """The bodies, solved exactly: u is the displacement of the contact dofs."""

    problem: SurfaceProblem
    linear: Linear

    def solve(self, laws: ActiveSet, p: Array, u: Array) -> tuple[Array, Array]:
        return self.linear(laws, u)

    def relative(self, p: Array, u: Array) -> Array:
        return self.problem.relative_displacement(u)


def branches(problem: SurfaceProblem, p: Array, w: Array, rtol: float, max_it: int) -> list[Solution]:
    """Where plain Newton leads from the active set of the state before, from all open, and from all closed.

    Args:
        problem: the contact problem of the step, of bodies that supports hold.
        p: tractions (rows,) [Pa] of the state before.
        w: its relative displacement (rows,) [m].
        rtol, max_it: as of `SemismoothNewton`.
    """
    zero, bodies = np.zeros_like(p), _Exact(problem, condensed_system.solve)
    of_state = p + problem.gamma * path.standing(problem, p, w)
    starts = (
        Start(p=p, u_c=problem.u_before, p_hat=of_state, in_equilibrium=False),
        Start.at(problem, zero, problem.load.free),
        Start.as_if(problem, zero, closed(problem)),
    )
    return [Attempts(problem, bodies, rtol, max_it).follow(iter([(start, None)])) for start in starts]


Solve = Callable[[SurfaceProblem, Array], Solution]


@dataclass(frozen=True, kw_only=True)
class Tangent(NormalLaw):
    """p = k (u_n - g)_+, each point with a stiffness of its own."""

    at_quadrature: ClassVar[bool] = True
    power: ClassVar[float] = 1.0
    k: Array  # (m,) [Pa/m]

    def resolvent(self, p_hat: Array, gamma: Array) -> Array:
        return np.asarray(np.maximum(p_hat, 0.0) * (self.k / (self.k + gamma)))

    def stiffness(self, p: Array, p_hat: Array) -> Array:
        return np.where(p_hat > 0, self.k, 0.0)

    def penetration(self, p: Array) -> Array:
        return np.asarray(np.maximum(p, 0.0) / self.k)


def resting_start(problem: SurfaceProblem, p: Array, solve: Solve) -> Iterator[Start]:
    """Find where bodies that nothing pushes rest: if nothing presses there, linear laws lead to the same place.

    With a power of the penetration Newton's method would halve it without end. If they are squeezed all the same, by
    obstacles or loads that balance each other, it is a start like any other.

    Args:
        problem: the contact problem of the step.
        p: tractions (rows,) [Pa] of the last step.
        solve: solves a problem with simpler laws, from tractions (rows,) [Pa].
    """
    curved = [place.rows.normal.at_quadrature and place.rows.normal.power != 1 for place in problem.cone.places]
    if not (problem.idle and any(curved)):
        return
    contacts = [
        replace(place.rows, normal=Tangent(k=problem.gamma[place.normal])) if law else place.rows
        for place, law in zip(problem.cone.places, curved, strict=True)
    ]
    cone = AdmissibleSet(tuple(contacts), problem.cone.time, problem.cone.end)
    found = solve(replace(problem, cone=cone), p)
    if found.status is Status.CONVERGED:
        yield Start.at(problem, found.p, found.u_c)
