"""A step that could not be solved, in words: which contact is farthest from its laws, by how much, what to try."""

from __future__ import annotations

import numpy as np

from solvers.cone import Place
from solvers.equilibrium import decide
from solvers.methods.solution import Solution, Status
from solvers.surface_problem import SurfaceProblem


def in_words(problem: SurfaceProblem | None, solution: Solution, tolerance: float, tried: float) -> str:
    """Why the smallest step, `tried` [s] long, was given up."""
    known = ""
    if problem is not None and problem.surface.floating:
        known = f" ({decide(problem).value})"
    residual = "no residual"
    if np.isfinite(solution.residual):
        broken = solution.status is Status.BROKEN  # it carries the tractions of the step before
        where = "" if broken or problem is None else worst(problem, solution)
        residual = f"{where}residual {solution.residual:.1e}, not {tolerance:g},"
    return (
        f"{residual} in a step of {tried:.3g} s after {solution.iterations} iterations; {solution.status.value}{known}"
    )


def worst(problem: SurfaceProblem, solution: Solution) -> str:
    """Contact, point and part of the law that the residual is largest at; empty where it is not known of any."""
    if not len(solution.p) or problem.p_ref == 0:
        return ""
    residual = problem.cone.natural_residual(solution.p, solution.w - problem.gap, problem.p_ref / problem.u_ref)
    row = int(np.argmax(np.abs(residual)))
    for place in problem.cone.places:
        for part, span in (("normal", place.normal), ("tangential", place.tangential)):
            if span.start <= row < span.stop:
                point = ", ".join(f"{x:.4g}" for x in _point(place, part, row - span.start))
                return f"contacts.{place.rows.name} at ({point}): {part} "
    raise AssertionError("a row of no contact")


def _point(place: Place, part: str, row: int) -> np.ndarray:  # type: ignore[type-arg]
    """The slave's node that counts most in that row."""
    rows = place.rows
    share = rows.psi[:, row] if part == "normal" else rows.share_t[row // place.components].T
    return np.asarray(rows.surface.points[int(np.argmax(np.abs(share.toarray().ravel())))])
