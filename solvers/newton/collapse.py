"""Limit load of deformable bodies: springs that hold floating bodies become ever softer, and what they carry remains.

Springs kappa R R^T to where the last step ended hold each rigid motion R of bodies that contact alone holds: with them
there is an equilibrium. As kappa falls, either the motion settles, and the bodies are in equilibrium without springs,
or it grows like 1/kappa: the springs then go on to carry a part r of the load that contact and friction lack, along the
motion of collapse. That is a suspicion, for other states of contact may hold the load: it is shown at the last
equilibrium before, see `spent`. Contact is solved on the elastic bodies: pressures are those that a bolt or a press fit
makes. Where all that slides slides on at the same tractions, a load whose work is smaller by |r|² / (r . f) is the
limit load.

Source: Christiansen, Limit analysis of collapse states, Handbook of Numerical Analysis IV (1996); elastic bodies
without an equilibrium: Klarbring, Ingenieur-Archiv 60 (1990).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.interface.limit_analysis import Mechanism, closes
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.iteration import Solution, Status
from stickslip.solvers.newton.attempts import Start


def on_softer_springs(
    problem: SurfaceProblem, p: Array, solve: Callable[[SurfaceProblem, Start], Solution]
) -> Iterator[Start | Mechanism]:
    """A start from the softest springs; or the mechanism of a motion that grows without end.

    A motion counts as one without end if it grows in proportion to the softness of the springs and nothing is left
    that could stop it: it closes no gap, or is already larger than all that it closes.

    Args:
        problem: of floating bodies; nothing is found but on the condensed form of them.
        p: tractions (rows,) [Pa] of the last step.
        solve: solves a problem from a start.
    """
    surface, u_c, before, known = problem.surface, problem.u_before, 0.0, np.zeros(problem.surface.R.shape[1])
    if not isinstance(surface, CondensedSurface) or not surface.floating:
        return
    for level in np.logspace(-2, -8, 7):  # of the stiffness of a contact dof
        stiffness = level * surface.rho
        held = _on_springs(problem, surface, stiffness)
        found = solve(held, replace(Start.at(held, p, u_c), in_equilibrium=False))
        if found.status is not Status.CONVERGED:
            return
        p, u_c, motion = found.p, found.u_c, surface.R.T @ (found.u_c - problem.u_before)
        far, further, known = float(np.abs(surface.R @ motion).max()), motion - known, motion
        work, room = float(further @ problem.load.resultant), closes(problem, found.w, surface.R @ further)
        if before > room and far > 9 * before and work > 0:  # ten times would be in proportion
            along = surface.R @ further
            yield Mechanism(along / np.abs(along).max(), stiffness * float(motion @ further) / work)
            return
        before = far
    yield replace(Start.at(problem, p, u_c), in_equilibrium=False)  # but for what the last springs hold


def _on_springs(problem: SurfaceProblem, surface: CondensedSurface, stiffness: float) -> SurfaceProblem:
    """The problem with springs [N/m] that hold the rigid modes where the last step ended."""
    resting = surface.R @ (surface.R.T @ problem.u_before)
    load = replace(problem.load, f_c=problem.load.f_c + stiffness * resting, resultant=np.zeros(0))
    return replace(problem, surface=surface.on_springs(stiffness), load=load)
