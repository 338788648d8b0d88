"""Observers of an accepted substep: the error of the iteration, and other solutions."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from stickslip.geometry.arrays import EXACT, SLIGHT, Array
from stickslip.geometry.errors import SolverError
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Correction, Solution, Status
from stickslip.solvers.newton.correction import SOLVES, by_flexibility, by_schur_complement, exact_problem
from stickslip.solvers.newton.uniqueness import proved
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.substep import Attempt, SubstepSolver
from stickslip.solvers.stepping.touch import Way

log = logging.getLogger(__name__)


def certified(attempt: Attempt) -> Attempt:
    """An accepted substep with the correction of its state, see `State.correction`; collective."""
    new = attempt.state
    assert new is not None
    try:
        with attempt.solver.system.counters.clock.part("certificate"):
            left = _correction(attempt, new)
    except (SolverError, np.linalg.LinAlgError) as error:  # the step is solved all the same
        log.warning("t = %g: the error of the iteration is unknown: %s", new.time, error)
        left = replace(attempt.begin.correction or Correction.none(len(new.w)), size=np.nan)
    return replace(attempt, state=replace(new, correction=left))


def with_others(attempt: Attempt) -> Attempt:
    """An accepted substep with other solutions of the same problem, if some are found, and the energy of its jump."""
    problem, solution, new = attempt.problem, attempt.solution, attempt.state
    assert problem is not None
    assert new is not None
    memory = attempt.solver.memory(attempt.begin, problem.cone.time)
    others, p = list(memory.others(problem, solution.p)), solution.p
    size = SLIGHT * problem.scales.of_tractions(p)  # of the largest traction: solutions that differ by less are one
    others += [one for one in solution.others if all(np.abs(one - known).max() > size for known in (p, *others))]
    freed = new.energy.time_remainder - attempt.begin.energy.time_remainder if solution.jumps else 0.0
    known = not others and not solution.jumps and proved(problem)
    return replace(attempt, solution=replace(solution, others=tuple(others), proved=known, jump=freed))


def _correction(attempt: Attempt, new: State) -> Correction:
    """From what the method found to the exact solution of the same substep and of all before; collective."""
    solver, problem, found, old = attempt.solver, attempt.problem, attempt.solution, attempt.begin
    assert problem is not None
    before = old.correction or Correction.none(len(new.w))
    if not len(new.w) or problem.p_ref == 0:
        return replace(Correction.none(len(new.w)), memory=before.memory)
    if found.correct is not None:  # an estimate of the method's own, with mu as it ended
        left = found.correct(before)
    else:
        if solver.chain.stage.surface != "condensed":
            found = replace(found, w=new.w)  # of the displacement that was recovered
        memory = solver.memory(old, new.time)
        start = {name: known + before.memory.get(name, 0.0) for name, known in old.memory.items()}
        nearer, size, exact = replace(memory, start=start).exact(
            exact_problem(problem, before), found, lambda problem, found: _exact(solver, problem, found)
        )
        nearer, size = _from_touch(attempt, before, nearer, size)
        ahead = {name: known - new.memory[name] for name, known in exact.items()}
        left = Correction(nearer.p - found.p, nearer.w - found.w, size, ahead)
    # of an error, what pairs that are searched elsewhere add to the next step; measured: .02 to .15
    return replace(left, size=left.size + 0.5 * before.size + attempt.unsettled) if new.searched else left


def _from_touch(attempt: Attempt, before: Correction, at: Solution, size: float) -> tuple[Solution, float]:
    """The exact solution with slip from where its own points touch, and the distance to it [J^(1/2)]; collective.

    Args:
        attempt: an accepted substep.
        before: correction of the state that it begins with.
        at: the exact solution with slip from where points touch in what the method found.
        size: the distance to that [J^(1/2)].
    """
    problem, way = attempt.problem, _way(attempt, before)
    assert problem is not None

    def solve(turned: SurfaceProblem, p: Array) -> tuple[Solution, SurfaceProblem]:
        nonlocal at, size
        at, farther = _exact(attempt.solver, turned, at)
        size += farther
        return replace(at, status=at.status if np.isfinite(farther) else Status.BROKEN), turned

    if way.any and np.isfinite(size):
        with attempt.solver.system.counters.for_error():
            way.from_touch((at, exact_problem(problem, before)), solve)
    return at, size


def _way(attempt: Attempt, before: Correction) -> Way:
    """The way of points in an accepted substep, from the state before with its correction."""
    problem, old, solver = attempt.problem, attempt.begin, attempt.solver
    assert problem is not None
    n, tolerance = solver.surface.normal_rows, solver.system.problem.solver.tolerance
    began = np.concatenate([problem.gap[:n], (old.w - problem.cone.give(old.p))[n:]])
    whole = exact_problem(replace(problem, gap=began), before)
    return Way(whole, old.p + before.p, old.w + before.w, EXACT if solver.surface.exact else tolerance)


def _exact(solver: SubstepSolver, problem: SurfaceProblem, found: Solution) -> tuple[Solution, float]:
    """The exact solution of a surface problem from one that is near, and their distance [J^(1/2)]; collective."""
    chain = solver.chain
    if chain.stage.surface == "condensed":
        return by_schur_complement(problem, found)
    # the uncondensed form solves floating bodies on springs: that is no response of theirs
    most = 0 if chain.stage.surface == "sparse" and solver.surface.floating else SOLVES
    return by_flexibility(problem, chain.flexibility(solver.system, solver.surface), found, most)
