"""From what an iteration returned to the exact solution of the same discrete problem: the correction is its error.

Laws, mesh and step are the same; so is the history, followed by the exact solutions of all steps before. With the Schur
complement of the bodies, Newton's method on the surface goes on from where the method has stopped. Otherwise Uzawa's
iteration goes on in an approximate flexibility: one volume solve for each step of it, and what is left then is measured
in that flexibility.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stickslip.geometry.arrays import EXACT, LAST_DIGITS, Array
from stickslip.solvers.interface.prepare import condensed
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Correction, Solution
from stickslip.solvers.laws.wear import WORN
from stickslip.solvers.metrics import Secants
from stickslip.solvers.newton import condensed_system
from stickslip.solvers.newton.active_set import linearise
from stickslip.solvers.newton.semismooth import SemismoothNewton
from stickslip.solvers.newton.surface_model import Flexibility, nearest_in_cone

ENOUGH = 0.01  # part of the first residual, or of the correction, that may be left in what serves as the exact solution
MAX_IT = 300
SOLVES = 8  # largest number of volume solves in a step, where the flexibility is approximate; one or two are usual
ACCURACY = 0.1  # of those, relative to the displacement that is expected
CONTRACTION = 0.2  # the last correction relative to all before, at which no further solve is made
MARGIN = 1.5  # factor on a distance that is known up to a small part
UNSURE = 3.0  # factor on a distance in the approximate flexibility


def exact_problem(problem: SurfaceProblem, before: Correction) -> SurfaceProblem:
    """The problem of a step as it is if all steps before were solved exactly: slip is counted from elsewhere, wear too.

    Args:
        problem: that the method has solved.
        before: correction of the state that the step starts from.
    """
    n = problem.surface.normal_rows
    shift = np.concatenate([np.zeros(n), (before.w - problem.cone.softness * before.p)[n:]])
    for place in problem.cone.places:
        shift[place.normal] = before.memory.get(f"{place.rows.name}{WORN}", 0.0)
    return replace(problem, gap=problem.gap + shift) if shift.any() else problem


def by_schur_complement(problem: SurfaceProblem, found: Solution) -> tuple[Solution, float]:
    """The exact solution by semismooth Newton with the Schur complement; no volume solve.

    Args:
        problem: see `exact_problem`.
        found: what the method returned; its u_c is the displacement under its p.

    Returns:
        The solution, and an upper estimate of its distance from `found` in the energy norm [J^(1/2)]; nan: not found.
    """
    residual = problem.natural_residual(found.p, found.w)
    if residual <= LAST_DIGITS:  # natural residual that no correction makes smaller
        return found, 0.0
    goal = max(ENOUGH * residual, LAST_DIGITS)
    exact = _newton(problem, found, goal) or _from_all_starts(problem, found.p, goal)
    if exact is None:
        return found, np.nan
    p, u_c = exact
    nearer = replace(found, p=p, w=problem.relative_displacement(u_c), u_c=u_c)
    return nearer, MARGIN * elastic_norm(problem, u_c - found.u_c)


def _newton(problem: SurfaceProblem, found: Solution, goal: float) -> tuple[Array, Array] | None:
    """Tractions (rows,) [Pa] and contact displacement (c,) [m] by Newton's method from `found`; None if it fails.

    Newton's iterate is exact if its residual is small, or if it repeats itself: the residual alone may end in rounding.
    So do steps that do not get shorter while the active set stays, for there Newton's method is quadratic.
    """
    p, u_c, gamma = found.p, found.u_c, problem.gamma
    # rounding of a displacement, relative, in the energy norm; two exact solutions differ by less
    negligible = EXACT * elastic_norm(problem, u_c)
    last, sets = np.inf, np.zeros(0)
    # from the final iterate, whose active set is nearly right; then all starts are tried
    for _ in range(12):
        before, p_hat = u_c, p + gamma * (problem.relative_displacement(u_c) - problem.gap)
        laws = linearise(problem, p_hat, gamma)
        try:
            p, u_c = condensed_system.solve(laws, u_c)
        except np.linalg.LinAlgError:
            return None
        if problem.natural_residual(p, problem.relative_displacement(u_c)) <= goal:
            return p, u_c
        step = elastic_norm(problem, u_c - before)
        if step <= max(negligible, ENOUGH * elastic_norm(problem, u_c - found.u_c)):
            return p, u_c
        if step > last / 2 and np.array_equal(laws.sets, sets):
            return p, u_c
        last, sets = step, laws.sets
    return None


def _from_all_starts(problem: SurfaceProblem, p: Array, goal: float) -> tuple[Array, Array] | None:
    """The same by `SemismoothNewton` from tractions p (rows,) [Pa], whose volume solves are counted apart."""
    with problem.surface.counters.for_error():
        exact = SemismoothNewton(rtol=goal, max_it=MAX_IT, linear=condensed_system.solve)(problem, p)
    return (exact.p, exact.u_c) if exact.residual <= goal else None


def elastic_norm(problem: SurfaceProblem, u_c: Array) -> float:
    """Energy norm [J^(1/2)] of a displacement u_c (c,) [m] of the contact dofs that no other force causes."""
    return float(np.sqrt(max(float(u_c @ (condensed(problem.surface).S @ u_c)), 0.0)))


def by_flexibility(
    problem: SurfaceProblem, known: Flexibility, found: Solution, most: int = SOLVES
) -> tuple[Solution, float]:
    """The exact solution by Uzawa's iteration in an approximate flexibility; collective.

    Args:
        problem: see `exact_problem`.
        known: the approximate flexibility; what is learnt here is not added to it.
        found: what the method returned; its w is the relative displacement under its p, and its u_c is not used.
        most: largest number of volume solves; 0: only the approximate flexibility is used.

    Returns:
        As `by_schur_complement`; of the solution, p and w.
    """
    surface, p, w = problem.surface, found.p, found.w
    residual = problem.natural_residual(p, w)
    if residual <= LAST_DIGITS:
        return found, 0.0
    nothing = surface.R[:, :0]
    learning = Secants(known.F, nothing, nothing, known.metric.comm)
    at, w_at, motion, size = p, w, np.zeros(surface.size), 0.0
    for k in range(most + 1):
        flexibility = Flexibility(surface=surface, F=learning, metric=known.metric)
        nearer = surface.agreed(nearest_in_cone(problem, flexibility, at, w_at, residual))
        if nearer is None:
            size = np.nan
            break
        force = surface.forces(at - nearer.p)
        u = learning(force)
        guessed = float(np.sqrt(max(float(force @ u), 0.0)))
        moved = w_at - flexibility(nearer.p - at)
        if surface.agreed(k == most or (k > 0 and guessed <= CONTRACTION * size)):
            at, w_at, size = nearer.p, moved + surface.N @ (surface.R @ nearer.b), size + UNSURE * guessed
            break
        with surface.counters.for_error():
            u = surface.displacement(force, ACCURACY * float(np.abs(u).max(initial=0.0)))
        learning.learn(force, u)
        motion = motion + u
        forces = surface.forces(p - nearer.p)
        at, w_at = nearer.p, w_at + surface.N @ (u + surface.R @ nearer.b)
        size = MARGIN * float(np.sqrt(max(float(forces @ motion), 0.0)))
        residual = problem.natural_residual(at, w_at)
    return replace(found, p=at, w=w_at), size
