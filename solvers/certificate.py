"""How accurate an accepted step is: the errors of iteration and laws in the energy norm."""

from __future__ import annotations

import numpy as np

from solvers.stepping import Accepted

ROUGH = 0.1  # error of the displacement beside its size, as a share of the defect's


def iteration_error(accepted: Accepted) -> float:
    """Energy norm of the displacement that the tractions' defect would cause, relative to the largest one so far.

    The defect is p - P_C(p + gamma r), gamma = p_ref / u_ref: what the contact laws would still change.
    """
    problem, state = accepted.problem, accepted.state
    if problem.p_ref == 0 or state.peak <= 0:
        return 0.0
    defect = problem.cone.natural_residual(state.p, state.w - problem.gap, problem.p_ref / problem.u_ref)
    force = problem.surface.forces(defect)
    small = ROUGH * float(np.abs(defect).max(initial=0.0)) / problem.p_ref * problem.u_ref
    energy = float(force @ problem.surface.displacement(force, small))
    return float(np.sqrt(max(energy, 0.0) / (2 * state.peak)))


def law_error(accepted: Accepted) -> float:
    """What the method's approximation of the laws leaves, relative to the largest energy norm so far.

    Steps add up: each starts from the slip of the one before, and a slip that is off changes the answer by no more
    than that (Tresca's law: the steps are a non-expansive map in the energy norm).
    """
    state = accepted.state
    return state.law_error / float(np.sqrt(2 * state.peak)) if state.law_error else 0.0
