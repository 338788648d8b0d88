"""Points that close within a substep: their slip counts from where they touch, not from where the substep begins.

A point that is open at the beginning moves freely until its gap g is closed, and sticks or slips from there on. Without
the tractions of all points that close it would have gone on to where it is D closer: it touches at the part g / (g + D)
of that way. The way is that of a first solution, for the tractions that hold a point back are then all left out; D
follows from them and the flexibility. Of bodies that nothing held before the way has the direction of the contact's
force. So bodies that fall on each other, and loads in
proportion, have the slip of infinitely short steps; elsewhere the error is of second order in the step, as long as ways
are straight.

Source: Jäger, Arch. Appl. Mech. 65 (1995), and Ciavarella, Int. J. Solids Struct. 35 (1998): under loads in proportion
what stops a point along a side and what stops it across are alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from stickslip.geometry.arrays import ROUNDING, Array, Bools
from stickslip.solvers.contact.admissible_set import ContactBlock
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Solution, Status
from stickslip.solvers.laws.law import touching

Solve = Callable[[SurfaceProblem, Array], tuple[Solution, SurfaceProblem]]  # from tractions (rows,) [Pa]


def from_touch(
    problem: SurfaceProblem,
    p: Array,
    w: Array,
    found: tuple[Solution, SurfaceProblem],
    solve: Solve,
    tolerance: float,
) -> tuple[Solution, SurfaceProblem]:
    """The solution of a substep with the slip of points that close in it counted from their touch; collective.

    Args:
        problem: of the substep, slip counted from its beginning.
        p: tractions (rows,) [Pa] there.
        w: relative displacement (rows,) [m] there.
        found: its solution, and the problem with the laws as they are then.
        solve: solves such a problem.
        tolerance: of a motion, relative to the largest of the substep [-].
    """
    solution, n = found[0], problem.surface.normal_rows
    if solution.status is not Status.CONVERGED:
        return found
    room = np.where(p[:n] == 0, problem.gap[:n] - w[:n], 0.0)
    room = np.where(room > problem.scales.no_motion(w)[:n], room, 0.0)
    closing = [(place, _closes(place, p, solution.p, room)) for place in problem.cone.with_friction()]
    closing = [(place, closes) for place, closes in closing if closes.any()]
    if not closing:
        return found
    freed = _freed(problem, p, solution.p, closing, tolerance * problem.u_ref)
    gap, slid = problem.gap.copy(), solution.w - problem.gap - problem.cone.softness * solution.p
    across = problem.surface.N[:n] @ problem.surface.R
    adrift = not p.any() and bool(np.any(np.abs(across) > ROUNDING))  # nothing says where points would have gone
    for place, closes in closing:
        span, t, shape = place.normal, place.tangential, (-1, place.components)
        ahead, beyond = place.average @ room[span], place.average @ (solution.w - problem.gap + freed)[span]
        part = np.where(closes & (beyond > 0), ahead / np.where(beyond > 0, ahead + beyond, 1.0), 0.0)
        way = (slid + freed)[t].reshape(shape)
        if adrift:
            W = problem.surface.W
            along = (W * solution.p)[t].reshape(shape).sum(axis=0) / float((W * solution.p)[span].sum())
            way = (ahead + beyond)[:, None] * along
        gap[t] += (part[:, None] * way).ravel()
    if np.all(np.abs(gap - problem.gap) <= problem.scales.no_motion(w)):
        return found
    solution, last = solve(replace(problem, gap=gap), solution.p)
    for place, _ in closing:
        t = place.tangential
        touches = touching(solution.p[place.normal], place.average, place.rows.normal)
        gap[t] = np.where(np.repeat(touches, place.components), gap[t], problem.gap[t])
    return solution, replace(last, gap=gap)


def _closes(place: ContactBlock, before: Array, after: Array, room: Array) -> Bools:
    """Which points (m_t,) of a contact with room (normal rows,) [m] close between tractions (rows,) [Pa]."""
    law, average, n = place.rows.normal, place.average, place.normal
    return np.asarray(touching(after[n], average, law) & ~touching(before[n], average, law) & (average @ room[n] > 0))


def _freed(
    problem: SurfaceProblem, before: Array, p: Array, closing: list[tuple[ContactBlock, Bools]], error: float
) -> Array:
    """Relative displacement (rows,) [m] that the tractions of points that close have taken; collective.

    Floating bodies stay where points were closed before, or are as soft as the points are.

    Args:
        problem: of the substep.
        before: tractions (rows,) [Pa] at its beginning.
        p: tractions (rows,) [Pa] at its end.
        closing: by contact, points that close.
        error: allowed in the displacement [m].
    """
    surface, acting = problem.surface, np.zeros_like(p)
    for place, closes in closing:
        n, t = place.normal, place.tangential
        acting[n] = np.where((place.average.T @ closes.astype(float) > 0) & (before[n] == 0), p[n], 0.0)
        acting[t] = np.where(np.repeat(closes, place.components), p[t], 0.0)
    force = surface.forces(acting)
    u, R = surface.displacement(force, error), surface.R
    if surface.floating:
        closed = surface.N[before != 0]
        u = u - R @ (R.T @ u)
        b = R.T @ force / float(np.mean(problem.gamma * surface.W))
        if closed.shape[0]:
            b = np.linalg.lstsq(np.asarray(closed @ R), -(closed @ u), rcond=None)[0]
        u = u + R @ b
    return np.asarray(surface.N @ u)
