"""An interior point: the way into contact along which no point is quite open, closed, stuck or slipping.

There a pressure p > 0 acts across what is left of a gap, y > 0, with p y = tau, and a traction |t| < s goes with the
slip v = 2 tau t / (s^2 - |t|^2). Every motion is resisted, however the bodies float in their gaps, and these travel as
tau falls: residuals, line searches and proximal terms hardly see that links of a chain have to move by their own
thickness. A step is one of Newton's method, as long as p and y stay positive; y need not be the gap at first.

Source: Mehrotra, SIAM J. Optim. 2 (1992), of steps and the fall of tau; Acary, Armand, Nguyen & Shpakovych, Optim.
Methods Softw. 39 (2024), of friction.
"""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from stickslip.geometry.arrays import CLOSE, HALF_DIGITS, ROUNDING, SLIGHT, TINY, Array, Bools
from stickslip.geometry.protocols import Sparse
from stickslip.solvers.contact.admissible_set import AdmissibleSet, ContactBlock
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import QUICK, Iterate, Stall
from stickslip.solvers.laws.law import Dragged, FrictionLaw, Trial
from stickslip.solvers.laws.normal import Unilateral
from stickslip.solvers.laws.wear import Worn
from stickslip.solvers.newton.active_set import linearise
from stickslip.solvers.newton.attempts import ATTEMPT, NEAR, Attempts, Bodies, LineSearch, Start, closed

SOFT = 0.03  # stiffness of contact at the first point, times the flexibility of a point [-]
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


def inner_starts(attempts: Attempts) -> Iterator[Start]:
    """Where the way leads floating bodies; of the solutions of held ones it may find another than the history does."""
    return way(attempts) if attempts.problem.surface.floating else iter(())


def way(attempts: Attempts) -> Iterator[Start]:
    """Where the way leads, if near; none where nothing is known of bodies, nothing pushes, or no point only presses."""
    problem, presses = attempts.problem, np.zeros(attempts.problem.surface.normal_rows, bool)
    for place in problem.cone.places:
        presses[place.normal] = place.rows.normal.sides == 1
    if problem.give is None or problem.p_ref == 0 or not presses.any():
        return
    attempts.problem = replace(problem, touch=copy(problem.touch))  # it remembers where it was asked
    found = attempts.run(inner(attempts, problem.give, presses))
    if not attempts.over and found.residual <= NEAR:
        start = Start.at(attempts.problem, found.p, found.u_c)
        yield replace(start, in_equilibrium=False, near=True)


def inner(attempts: Attempts, give: Array, presses: Bools) -> Iterator[Iterate]:
    """Iterates of the way, projected, up to a slight residual, or up to where p y stays as large as it is.

    Args:
        attempts: those so far, at a problem of the bodies.
        give: see `SurfaceProblem.give`.
        presses: (normal rows,) whether a point only presses.
    """
    n, stalls = attempts.problem.surface.normal_rows, Stall(QUICK // 2)
    number = attempts.history[-1].iteration if attempts.history else 0
    try:
        x, fall, lacks = first(attempts.problem, attempts.bodies, give, presses), 0.5, 1.0
        for k in range(number + 1, number + ATTEMPT):
            problem, gamma = attempts.problem, attempts.problem.gamma
            mean = float((x.p[:n] * x.y)[presses].mean())
            if stalls(k, mean):
                return
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
            yield replace(found, residual=residual, enough=False)  # strained bodies may lack more at first
            if share > 0.5 and residual <= SLIGHT:
                return
    except np.linalg.LinAlgError:
        return


def first(problem: SurfaceProblem, bodies: Bodies, give: Array, presses: Bools) -> Point:
    """The first point: the bodies where they stood, under about the tractions of soft contact everywhere.

    Raises:
        LinAlgError: soft contact does not hold the bodies.
    """
    n, zero, stiffness = problem.surface.normal_rows, np.zeros_like(give), SOFT / give
    before = problem.relative_displacement(problem.u_before)
    touching = replace(problem, gap=np.concatenate([np.minimum(problem.gap, before)[:n], problem.gap[n:]]))
    laws = linearise(touching, closed(problem), stiffness).proximal(zero, 1.0, stiffness, HALF_DIGITS)
    p, u = bodies.solve(laws, zero, problem.u_before)
    enters = float(np.maximum(bodies.relative(p, u) - problem.gap, 0.0)[:n][presses].max(initial=0.0))
    p[n:] = 0.0
    least = p[:n][presses].min(initial=0.0)  # soft contact may pull
    p[:n] = np.where(presses, p[:n] - 1.5 * least + CLOSE * np.abs(p[:n]).max(initial=0.0), p[:n])
    return Point(p=p, w=before, u=problem.u_before, y=np.maximum((problem.gap - before)[:n], enters or problem.u_ref))


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
