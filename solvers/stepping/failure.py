"""A step that could not be solved, in words: which contact is farthest from its laws, by how much, what to try."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geometry.arrays import Array
from solvers.contact.admissible_set import ContactBlock
from solvers.fem.constraints import AXES
from solvers.interface.limit_analysis import decide
from solvers.interface.problem import SurfaceProblem
from solvers.newton.solution import Solution, Status
from solvers.system.system import System


def motion_in_words(system: System, motion: Array) -> str:
    """A rigid motion of the contact dofs and driven obstacles (c,)."""
    return max(_motions(system, motion), key=lambda found: found[0])[1]


def _motions(system: System, motion: Array) -> Iterator[tuple[float, str]]:
    """How far each body moves, and how."""
    own, driven = np.split(motion, [len(motion) - len(system.obstacles.driven)])
    for (name, axis), size in zip(system.obstacles.driven, driven, strict=True):
        yield abs(float(size)), f"obstacles.{name} moves along {_sign(size)}{'xyz'[axis]}"
    for c in system.contacts:
        moved = (system.interface.trace(c) @ own).reshape(c.points.shape)
        sides = np.split(moved, [len(c.surface.points)])
        for body, u in zip(system.problem.pairs[c.name].bodies, sides, strict=False):
            yield float(np.linalg.norm(u, axis=1).max()), f"bodies.{body} {_how(u)}"


def _how(u: Array) -> str:
    """Displacement (m, d) of a side, which moves as a rigid body does."""
    mean = u.mean(axis=0)
    if np.linalg.norm(u - mean, axis=1).max() > np.linalg.norm(mean):
        return "turns"
    axis = max(AXES, key=lambda name: abs(mean[AXES[name]]) if AXES[name] < len(mean) else -1.0)
    return f"moves along {_sign(mean[AXES[axis]])}{axis}"


def _sign(size: float) -> str:
    return "-" if size < 0 else ""


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


def _point(place: ContactBlock, part: str, row: int) -> np.ndarray:  # type: ignore[type-arg]
    """The slave's node that counts most in that row."""
    rows = place.rows
    share = rows.psi[:, row] if part == "normal" else rows.share_t[row // place.components].T
    return np.asarray(rows.surface.points[int(np.argmax(np.abs(share.toarray().ravel())))])
