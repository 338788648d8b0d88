"""The message of a step that could not be solved: largest contact residual, how the iteration ended, what to try."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stickslip.geometry.arrays import Array, Ints
from stickslip.solvers.contact.admissible_set import ContactBlock
from stickslip.solvers.fem.constraints import AXES
from stickslip.solvers.interface.limit_analysis import decide
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Solution, Status
from stickslip.solvers.system.system import System


def describe_motion(system: System, motion: Array, dofs: Ints) -> str:
    """A rigid motion in words, by the body or driven obstacle that moves farthest: "bodies.block moves along x".

    Args:
        system: whose bodies and obstacles move.
        motion: displacement (c,) [m] of the contact dofs that the surface problem has, then of the driven obstacles.
        dofs: numbers of these contact dofs: without friction those of normal motions alone.
    """
    return max(_motions(system, motion, dofs), key=lambda found: found[0])[1]


def _motions(system: System, motion: Array, dofs: Ints) -> Iterator[tuple[float, str]]:
    """Distance [m] that each body and driven obstacle moves, and the sentence about it."""
    own, driven = np.split(motion, [len(dofs)])
    known = np.isin(system.interface.dofs, dofs)
    for (name, axis), size in zip(system.obstacles.driven, driven, strict=True):
        yield abs(float(size)), f"obstacles.{name} moves along {_sign(size)}{'xyz'[axis]}"
    for c in system.contacts:
        moved = (system.interface.trace(c)[:, known] @ own).reshape(c.points.shape)
        sides = np.split(moved, [len(c.surface.points)])
        for body, u in zip(system.problem.pairs[c.name].bodies, sides, strict=False):
            yield float(np.linalg.norm(u, axis=1).max()), f"bodies.{body} {_verb(u)}"


def _verb(u: Array) -> str:
    """What a rigid body does: "turns", or "moves along -x"; u: displacement (m, d) of one of its sides [m]."""
    mean = u.mean(axis=0)
    if np.linalg.norm(u - mean, axis=1).max() > np.linalg.norm(mean):
        return "turns"
    axis = max(AXES, key=lambda name: abs(mean[AXES[name]]) if AXES[name] < len(mean) else -1.0)
    return f"moves along {_sign(mean[AXES[axis]])}{axis}"


def _sign(size: float) -> str:
    return "-" if size < 0 else ""


def explain(problem: SurfaceProblem | None, solution: Solution, tolerance: float, size: float) -> str:
    """Why the smallest substep failed, in one line.

    Args:
        problem: what was to be solved; None: it could not be set up.
        solution: how the iteration ended.
        tolerance: `solver.tolerance`, that the residual does not meet [-].
        size: size of the substep [s].
    """
    rigid_bodies = ""
    if problem is not None and problem.surface.floating:
        rigid_bodies = f" ({decide(problem).value})"
    residual = "no residual"
    if np.isfinite(solution.residual):
        broken = solution.status is Status.BROKEN  # its tractions are those of the substep before
        where = "" if broken or problem is None else largest_residual(problem, solution)
        residual = f"{where}residual {solution.residual:.1e}, not {tolerance:g},"
    ending = f"after {solution.iterations} iterations; {solution.status.value}{rigid_bodies}"
    return f"{residual} in a step of {size:.3g} s {ending}{_jumps(problem)}"


def _jumps(problem: SurfaceProblem | None) -> str:
    """What to know of friction bounds that jump where the surfaces part."""
    for place in problem.cone.with_friction() if problem is not None else ():
        friction = place.rows.friction
        if place.rows.normal.sides == 1 and friction is not None and friction.continuous:
            return (
                f"; the friction bound of contacts.{place.rows.name} jumps where the surfaces part: there may be no "
                f"solution; {friction.continuous} has one"
            )
    return ""


def largest_residual(problem: SurfaceProblem, solution: Solution) -> str:
    """Where the residual is largest: "contacts.base at (1, 0): normal "; empty if the problem has no tractions."""
    if not len(solution.p) or problem.p_ref == 0:
        return ""
    row = int(np.argmax(np.abs(problem.defect(solution.p, solution.w))))
    for place in problem.cone.places:
        for part, span in (("normal", place.normal), ("tangential", place.tangential)):
            if span.start <= row < span.stop:
                point = ", ".join(f"{x:.4g}" for x in _point(place, part, row - span.start))
                return f"contacts.{place.rows.name} at ({point}): {part} "
    raise AssertionError("a row of no contact")


def _point(place: ContactBlock, part: str, row: int) -> Array:
    """The slave node (d,) [m] that has the largest weight in a row of the block."""
    rows = place.rows
    share = rows.psi[:, row] if part == "normal" else rows.share_t[row // place.components].T
    return np.asarray(rows.surface.points[int(np.argmax(np.abs(share.toarray().ravel())))])
