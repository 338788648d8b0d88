"""An interior point: the way into contact along which no point is quite open, closed, stuck or slipping.

There a pressure p > 0 acts across what is left of a gap, y > 0, with p y = tau, and a traction |t| < s goes with the
slip v = 2 tau t / (s^2 - |t|^2). Every motion is resisted, however the bodies float in their gaps, and these travel as
tau falls: residuals, line searches and proximal terms hardly see that links of a chain have to move by their own
thickness. A step is one of Newton's method, as long as p and y stay positive; y need not be the gap at first. The way
begins near to where rigid bodies would rest, as far along as their pressures tell.

Source: Mehrotra, SIAM J. Optim. 2 (1992), of steps and the fall of tau; Acary, Armand, Nguyen & Shpakovych, Optim.
Methods Softw. 39 (2024), of friction.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from stickslip.geometry.arrays import HALF_DIGITS, ROUNDING, SLIGHT, TINY, Array, Bools
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.contact.admissible_set import AdmissibleSet, ContactBlock
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import QUICK, Iterate, Stall
from stickslip.solvers.laws.law import Dragged, FrictionLaw, Trial
from stickslip.solvers.laws.normal import Unilateral
from stickslip.solvers.laws.wear import Worn
from stickslip.solvers.newton.active_set import linearise
from stickslip.solvers.newton.attempts import ATTEMPT, NEAR, Attempts, LineSearch, Start

BORDER = 0.1  # pressure between open and closed at the first point, of the largest one [-]
NEARLY = 0.95  # of the way to where a pressure or a gap is zero
FALL = 0.05  # of tau in a step, at most [-]


@dataclass(frozen=True, kw_only=True)
class Rounded(FrictionLaw):
    """Friction whose points slip a little before they reach the bound: by 2 tau |t| / (s^2 - |t|^2)."""

    drags: ClassVar[bool] = True
    cone: AdmissibleSet
    place: ContactBlock  # whose bound it is
    tau: float  # [Pa m]

    def dragged(self, p: Array, average: Sparse, trial: Trial) -> Dragged:
        s, _, slope = self.cone.dragged(self.place, p, trial)
        s = np.minimum(s, (trial.size.max(initial=0.0) or 1.0) / ROUNDING)  # that of points that never slip is infinite
        e = 2 * self.tau * trial.gamma
        whole, low, high = 1 + trial.gamma * self.softness, np.zeros_like(s), np.minimum(trial.size, s)
        for _ in range(60):  # halvings leave the last digit
            t = (low + high) / 2
            far = (whole * t - trial.size) * (s**2 - t**2) + e * t > 0
            low, high = np.where(far, low, t), np.where(far, t, high)
        left = s**2 - low**2
        slopes = np.maximum(whole * left**2 + e * (s**2 + low**2), TINY)
        return Dragged(low, left**2 / slopes, slope.multiply((2 * e * low * s / slopes)[:, None]).tocsr())


@dataclass(frozen=True)
class Point:
    """A point of the way."""

    p: Array  # tractions (rows,) [Pa]
    w: Array  # relative displacement (rows,) [m]
    u: Array  # displacement (c,) [m] of the contact dofs
    y: Array  # (normal rows,) what is left of gaps [m], where points only press

    def towards(self, p: Array, w: Array, u: Array, y: Array, share: float) -> Point:
        """The point at a share of the way to another one."""
        at, to = (self.p, self.w, self.u, self.y), (p, w, u, y)
        return Point(*(a + share * (b - a) for a, b in zip(at, to, strict=True)))


def way(attempts: Attempts, rest: Start) -> Iterator[Start | None]:
    """Where the way leads from `rest`, if near; none where no point only presses there.

    Before that None, where it is long: something else may be tried before it goes on.

    Args:
        attempts: those so far, at a problem of bodies that are known.
        rest: a solution for rigid bodies.
    """
    problem, presses = attempts.problem, np.zeros(attempts.problem.surface.normal_rows, bool)
    for place in problem.cone.places:
        presses[place.normal] = place.rows.normal.sides == 1
    if not rest.p[: len(presses)][presses].any():
        return
    points, stalls = inner(attempts, first(problem, rest, presses), presses), Stall(QUICK // 2)
    own, falls = replace(problem, touch=copy(problem.touch)), True  # it remembers where it was asked

    def until(last: int) -> Iterator[Iterate]:
        nonlocal falls
        for x, mean in points:
            yield x
            falls = not stalls(x.number, mean)
            if not falls or x.number >= last:
                return

    for most in (ATTEMPT // 4, ATTEMPT):
        attempts.problem, last = own, attempts.last + most
        found = attempts.run(until(last))
        own = attempts.problem
        if attempts.over:
            return
        if most == ATTEMPT or not falls or attempts.last < last:
            break
        yield None
    if found.residual <= NEAR:
        start = Start.at(attempts.problem, found.p, found.u_c)
        yield replace(start, in_equilibrium=False, near=True)


def inner(attempts: Attempts, x: Point, presses: Bools) -> Iterator[tuple[Iterate, float]]:
    """Iterates of the way, projected, up to a slight residual, and the mean of p y [Pa m] before each.

    Args:
        attempts: those so far, at a problem of the bodies.
        x: the first point.
        presses: (normal rows,) whether a point only presses.
    """
    n, fall, lacks = attempts.problem.surface.normal_rows, 0.5, 1.0
    try:
        for _ in range(ATTEMPT):
            k, problem, gamma = attempts.last + 1, attempts.problem, attempts.problem.gamma
            mean = float((x.p[:n] * x.y)[presses].mean())
            tau = fall * mean
            posed, trial = on_the_way(problem, x, tau)
            p, u = attempts.bodies.solve(linearise(posed, trial, gamma), x.p, x.u)
            w = attempts.bodies.relative(p, u)
            old = np.where(presses, x.p[:n], np.inf)
            y = tau / old + x.y * (1 - p[:n] / old)  # it stays where points do not only press
            share = NEARLY / max(NEARLY, (1 - p[:n] / old)[presses].max(), (1 - y / x.y).max())
            to = x.towards(p, w, u, y, share)
            share *= LineSearch(posed, gamma)(x.p, x.w, to.p, to.w)
            x = x.towards(p, w, u, y, share)
            fall, lacks = max(FALL, fall / 2, (1 - share) ** 2), lacks * (1 - share)
            hat = x.p + gamma * (x.w - problem.gap)
            hat[:n] = np.where(presses, x.p[:n] + gamma[:n] * (problem.cone.give(x.p)[:n] - x.y), hat[:n])
            found = attempts.judged(k, problem.project(hat, gamma), x.w, x.u)
            off = np.abs(found.p - x.p).max() / problem.scales.of_tractions(x.p)  # from those that w belongs to
            residual = max(found.residual, off, lacks)
            yield replace(found, residual=residual, enough=False), mean  # strained bodies may lack more at first
            if share > 0.5 and residual <= SLIGHT:
                return
    except np.linalg.LinAlgError:
        return


def first(problem: SurfaceProblem, rest: Start, presses: Bools) -> Point:
    """The first point: near to a solution for rigid bodies, with p - y / give as it is there, the more alike the less.

    Args:
        problem: of bodies whose `give` is known.
        rest: the solution; points press there.
        presses: (normal rows,) whether a point only presses.
    """
    assert problem.give is not None
    n, give, w = len(presses), problem.give[: len(presses)], problem.relative_displacement(rest.u_c)
    border = BORDER * np.abs(rest.p[:n][presses]).max()
    apart = np.where(rest.p[:n] > 0, rest.p[:n], np.minimum((w - problem.gap)[:n], 0.0) / give)
    root = np.sqrt(apart**2 + 4 * border**2)
    between = np.where(apart > 0, (apart + root) / 2, 2 * border**2 / (root - apart))  # no difference of like numbers
    p = np.concatenate([np.where(presses, between, rest.p[:n]), rest.p[n:]])
    return Point(p=p, w=w, u=rest.u_c, y=border**2 * give / between)


def on_the_way(problem: SurfaceProblem, x: Point, tau: float) -> tuple[SurfaceProblem, Array]:
    """The problem of a step from a point of the way, and trial tractions (rows,) [Pa] to linearise its laws at."""
    cone, gap, trial = problem.cone, problem.gap.copy(), x.p + problem.gamma * (x.w - problem.gap)
    enters, contacts = cone.give(x.p), list[ContactRows]()
    for place in cone.places:
        rows, n, t = place.rows, place.normal, place.tangential
        law, friction, p, y = rows.normal, rows.friction, x.p[n], x.y[n]
        if law.sides == 1:
            k = law.stiffness(p, p)
            softness: Array = np.where(np.isinf(k), law.give, 1 / k)
            gap[n] += enters[n] - softness * p - tau / p - y
            softness = softness + y / p
            trial[n] = p * (1 + problem.gamma[n] * softness)
            rows = replace(rows, normal=Worn(of=Unilateral(), softness=softness))
        if friction is not None:
            trial[t] += HALF_DIGITS * problem.p_ref  # rest has no direction
            rows = replace(rows, friction=Rounded(cone=cone, place=place, tau=tau, k_T=friction.k_T))
        contacts.append(rows)
    return replace(problem, gap=gap, cone=AdmissibleSet(tuple(contacts), cone.time, cone.end)), trial
