"""Where Newton's iteration on the surface problem starts, and starts again if it fails."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import CLOSE, Array
from stickslip.solvers.interface.limit_analysis import balancing_tractions
from stickslip.solvers.interface.problem import LEAST, SurfaceProblem
from stickslip.solvers.newton.solution import Solution


@dataclass(frozen=True, kw_only=True)
class Start:
    """Starting point of an attempt."""

    p: Array  # tractions (rows,) [Pa]
    u_c: Array  # displacement (c,) [m] of the contact dofs
    p_hat: Array  # trial tractions (rows,) [Pa]
    factor: float = 1.0  # that multiplies gamma
    in_equilibrium: bool = True  # whether u_c is the displacement under p

    @staticmethod
    def at(problem: SurfaceProblem, p: Array, u_c: Array, factor: float = 1.0) -> Start:
        """Start from tractions p (rows,) [Pa] and their displacement u_c (c,) [m]."""
        r = problem.relative_displacement(u_c) - problem.gap
        return Start(p=p, u_c=u_c, p_hat=p + factor * problem.gamma * r, factor=factor)

    @staticmethod
    def as_if(problem: SurfaceProblem, p: Array, answer: Array, factor: float = 1.0) -> Start:
        """Start from p (rows,) [Pa] with the active set of which `answer` (rows,) [Pa] would be the solution.

        What is at its friction bound slips: rounding would decide.
        """
        p_hat = answer + factor * problem.gamma * problem.cone.give(answer)
        # relative distance from the friction bound at which a point of an answer slips
        p_hat[problem.surface.normal_rows :] *= 1 + CLOSE
        return Start(p=p, u_c=problem.u_before, p_hat=p_hat, factor=factor, in_equilibrium=False)

    @staticmethod
    def where_it_stood(problem: SurfaceProblem, p: Array) -> Start:
        """Start from p (rows,) [Pa] with the bodies where they were at the end of the last step.

        What only just touches is open: rounding would decide.
        """
        r = problem.relative_displacement(problem.u_before) - problem.gap
        p_hat = p + problem.gamma * r
        p_hat[np.abs(p_hat) <= LEAST * problem.p_ref] = 0.0
        return Start(p=p, u_c=problem.u_before, p_hat=p_hat, in_equilibrium=False)


def first_starts(problem: SurfaceProblem, p: Array) -> Iterator[Start]:
    """The starts that need no excuse: the tractions of the last step.

    For a floating body tractions do not determine the displacement: they only give the active set to start from. If it
    has room to move, closing all points would pull more than the load presses: it also starts from tractions that
    balance the load on rigid bodies; if nothing pushes it, from where it stood, behind what still squeezes it.

    Args:
        problem: the contact problem of the step.
        p: tractions (rows,) [Pa] of the last step.
    """
    if not problem.surface.floating:
        yield Start.at(problem, p, problem.contact_displacement(p))
    elif problem.p_ref == 0:  # no load and no motion: the answer is zero
        zero = np.zeros_like(p)
        yield Start.at(problem, zero, np.zeros(problem.surface.size))
    else:
        if np.abs(p).max(initial=0.0) > LEAST * problem.p_ref:  # what is smaller does not tell what touches
            yield Start.as_if(problem, p, p)
        if problem.idle:
            yield Start.where_it_stood(problem, p)
        yield Start.as_if(problem, p, closed(problem))
        yield from _balanced(problem)


def other_starts(problem: SurfaceProblem, p: Array) -> Iterator[Start]:
    """Further starts: zero tractions; all points closed and sticking; all of them with another gamma.

    Args:
        problem: the contact problem of the step.
        p: tractions (rows,) [Pa] of the last step.
    """
    floating, zero = problem.surface.floating, np.zeros_like(p)
    for factor in (1.0, 0.1, 10.0):
        if floating and factor == 1.0:
            continue  # they were the first
        for tractions in [] if floating else [zero] if factor == 1.0 else [p, zero]:
            if tractions is p or p.any():
                yield Start.at(problem, tractions, problem.contact_displacement(tractions), factor)
        yield Start.as_if(problem, p, closed(problem), factor)
        if floating:
            yield from _balanced(problem, factor)


def again(problem: SurfaceProblem, best: Solution) -> Start:
    """Start from the best iterate so far."""
    return Start(p=best.p, u_c=best.u_c, p_hat=best.p + problem.gamma * (best.w - problem.gap))


def closed(problem: SurfaceProblem) -> Array:
    """Tractions (rows,) [Pa] under which all points are closed and stick."""
    normal = problem.surface.normal_rows
    return np.concatenate([np.full(normal, problem.p_ref), np.zeros(len(problem.gap) - normal)])


def _balanced(problem: SurfaceProblem, factor: float = 1.0) -> Iterator[Start]:
    """Start from tractions that balance the load on rigid bodies, if there are any."""
    rigid = balancing_tractions(problem)
    if rigid is not None:
        yield Start.as_if(problem, rigid, rigid, factor)
