"""Friction that depends on slip: a substep is solved with the mu of each point, until mu is that of its own slip.

With mu fixed the substep is one of Coulomb's law. From the mu at its start, slip and mu are found by turns. Where
bodies unload by more than friction weakens, these turns approach the one solution. Where friction weakens faster, there
may be several: slip then grows from turn to turn, up to the first solution, which is the nearest to the state before.

Source: Rice & Ruina, J. Appl. Mech. 50 (1983), of the stiffness that slip weakening needs; Irons & Tuck, Int. J.
Numer. Meth. Engng 1 (1969), of the step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from stickslip.geometry.arrays import CLOSE, EXACT, Array
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.laws.law import touching
from stickslip.solvers.newton import several
from stickslip.solvers.newton.correction import ENOUGH
from stickslip.solvers.newton.solution import Solution, Status

TURNS = 200  # of slip and mu; near the edge of stability they are slow
CLEAR = 100.0  # times the tolerance; differences of less may be what the method has left
SHORTEST, LONGEST = 1e-3, 10.0  # steps, in units of the change of slip in a turn
Lengths = Mapping[str, Array]  # slip (m_t,) [m] of the points of each contact whose law depends on it, see `State.slid`


def no_slip(cone: AdmissibleSet) -> dict[str, Array]:
    """Lengths of slip at the start."""
    laws = ((c, c.friction) for c in cone.contacts)
    return {c.name: np.zeros(len(c.W_t)) for c, law in laws if law is not None and law.remembers}


def with_slip(cone: AdmissibleSet, slid: Lengths) -> AdmissibleSet:
    """The admissible set of points that have slipped so far."""
    if not slid:
        return cone
    contacts = [
        replace(c, friction=c.friction.at_slip(slid[c.name])) if c.name in slid and c.friction else c
        for c in cone.contacts
    ]
    return replace(cone, contacts=tuple(contacts))


def lengthened(slid: Lengths, problem: SurfaceProblem, p: Array, w: Array) -> dict[str, Array]:
    """Lengths of slip after a substep: points that touch at its end have slipped by |w - gap - t / k_T|.

    Args:
        slid: at the start of the substep.
        problem: of the substep.
        p: tractions (rows,) [Pa].
        w: relative displacement (rows,) [m].
    """
    cone, found = problem.cone, dict(slid)
    moved = w - problem.gap - cone.give(p)
    for place in cone.places:
        rows = place.rows
        if rows.name in slid:
            step = np.linalg.norm(moved[place.tangential].reshape(rows.free.shape) * rows.free, axis=1)
            touches = touching(p[place.normal], rows.average, rows.normal)
            found[rows.name] = slid[rows.name] + np.where(touches, step, 0.0)
    return found


def solve_by_turns(
    problem: SurfaceProblem,
    cone: AdmissibleSet,
    slid: Lengths,
    start: Array,
    solve: Callable[[SurfaceProblem, Array], Solution],
    tolerance: float,
) -> tuple[Solution, SurfaceProblem]:
    """The solution of a substep, and the problem with the mu that it was found with.

    Args:
        problem: of the substep, with the mu of its start.
        cone: with laws that depend on slip.
        slid: lengths of slip at the start of the substep.
        start: tractions (rows,) [Pa].
        solve: solves a problem from tractions.
        tolerance: largest difference of a friction bound from that of the slip found, relative to tractions [-].
    """
    solution = solve(problem, start)
    if not slid:
        return solution, problem
    known, gap, omega, off, worst = slid, None, 1.0, 0.0, 0.0
    for _ in range(TURNS):
        if solution.status is not Status.CONVERGED:
            return solution, problem
        found = lengthened(slid, problem, solution.p, solution.w)
        before, gap = gap, np.concatenate([found[name] - known[name] for name in slid])
        if before is not None and before.any():
            ratio = 1 - (1 - float(gap @ before) / float(before @ before)) / omega  # of two turns without the step
            if omega == 1.0 and off > CLEAR * tolerance:
                worst = max(worst, ratio)
            omega = min(max(1 / (1 - ratio), SHORTEST), LONGEST) if ratio < 1 else 1.0
        off = _apart(problem, with_slip(cone, found), solution.p)
        if off <= tolerance:
            return replace(solution, weakening=worst), problem
        known = {name: np.maximum(known[name] + omega * (found[name] - known[name]), slid[name]) for name in slid}
        problem = replace(problem, cone=with_slip(cone, known))
        solution = solve(problem, solution.p)
    return replace(solution, status=Status.MAX_IT), problem


def exact_by_turns(
    problem: SurfaceProblem,
    cone: AdmissibleSet,
    slid: Lengths,
    found: Solution,
    exact: Callable[[SurfaceProblem, Solution], tuple[Solution, float]],
) -> tuple[Solution, float, dict[str, Array]]:
    """The exact solution of a substep, with the mu of its own slip, from what a method found.

    Args:
        problem: of the substep, with the mu that the method ended with.
        cone: with laws that depend on slip.
        slid: lengths of slip at the start of the substep, after exact solutions of all before.
        found: what the method returned.
        exact: from a solution that is near, the exact one of a problem, and their distance [J^(1/2)]; nan: not found.

    Returns:
        The solution, an upper estimate of its distance from `found` in the energy norm [J^(1/2)], which is nan where it
        was not found, and its lengths of slip at the end of the substep.
    """
    at, size = exact(problem, found)
    if not slid or np.isnan(size):
        return at, size, lengthened(slid, problem, at.p, at.w)

    def solve(turned: SurfaceProblem, p: Array) -> Solution:
        nonlocal at, size
        if turned is not problem:
            at, farther = exact(turned, at)
            size += farther
        return at if np.isfinite(size) else replace(at, status=Status.BROKEN)

    off = _apart(problem, with_slip(cone, lengthened(slid, problem, at.p, at.w)), at.p)
    ended, turned = solve_by_turns(problem, cone, slid, at.p, solve, max(ENOUGH * off, EXACT))
    return at, size if ended.status is found.status else np.nan, lengthened(slid, turned, at.p, at.w)


def other_ends(problem: SurfaceProblem, cone: AdmissibleSet, slid: Lengths, p: Array) -> tuple[Array, ...]:
    """Tractions (rows,) [Pa] of other solutions of a substep, with the mu of the slip in each of them.

    Args:
        problem: of the substep, with the mu that p was found with.
        cone: with laws that depend on slip.
        slid: lengths of slip at the start of the substep.
        p: tractions (rows,) [Pa] that solve it.
    """

    def keeps(p: Array, w: Array) -> bool:
        return _apart(problem, with_slip(cone, lengthened(slid, problem, p, w)), p) <= CLOSE

    return tuple(several.others(problem, p, keeps) if slid else several.others(problem, p))


def _apart(problem: SurfaceProblem, other: AdmissibleSet, p: Array) -> float:
    """Largest difference of its friction bounds at tractions p (rows,) [Pa] from others, relative to tractions [-]."""
    own = problem.cone
    pairs = zip(own.with_friction(), other.with_friction(), strict=True)
    apart = (own.bound(a, p[a.normal]) - other.bound(b, p[b.normal]) for a, b in pairs)
    largest = max((float(np.abs(each[np.isfinite(each)]).max(initial=0.0)) for each in apart), default=0.0)
    return largest / (problem.scale(p) or 1.0)  # zero: nothing is loaded
