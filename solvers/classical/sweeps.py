"""The loop of Gauss-Seidel methods: sweep until the residual is small, or has stopped falling."""

from __future__ import annotations

from collections.abc import Callable

from stickslip.geometry.arrays import Array
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.newton.solution import OnStep, Solution, Stall, Status, Step, ending


def sweep_until_solved(
    problem: SurfaceProblem,
    tractions: Callable[[], Array],
    sweep: Callable[[], None],
    *,
    rtol: float,
    max_it: int,
    window: int,
    on_step: OnStep,
    looks: Callable[[int], bool] = lambda k: True,
) -> Solution:
    """Sweep over the contact points, and look at the natural residual.

    Args:
        problem: the contact problem of the step.
        tractions: those reached (rows,) [Pa], an array of its own each time.
        sweep: goes once over all points.
        rtol: natural residual that is enough [-].
        max_it: largest number of sweeps.
        window: sweeps in which the smallest residual must halve.
        on_step: called with each look.
        looks: whether to look after k sweeps; at the last one it always looks.
    """
    history: list[Step] = []
    status, stalled = None, Stall(window, 0.5)
    for k in range(max_it + 1):
        if looks(k) or k == max_it:
            p = tractions()
            u_c = problem.contact_displacement(p)
            w = problem.relative_displacement(u_c)
            residual = problem.natural_residual(p, w)
            history.append(Step(k, residual, problem.volume_solves))
            on_step(history[-1])
            if status := ending(residual, rtol, stalled(k, residual)):
                break
        if k < max_it:
            sweep()
    return Solution(p, w, u_c, status or Status.MAX_IT, residual, tuple(history))
