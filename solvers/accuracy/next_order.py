"""Error of the mesh of the smooth numbers of each step, order 2 in 3D: the same step with bubbles of order 3.

Two steps of Jacobi's iteration, which neither bodies nor contact answer to, find the bubbles; then contact is solved
again with them, see `two_level`. Stated is
FACTOR times the difference, no less than `by_chance` says of the nodes. `AT_THE_EDGE`, what an edge of contact decides,
does not change by bubbles; see `lower_order`. Nor do bubbles tell how supports that meet share what they hold, or where
on periodic sides it is held. The part of curved sides is in it, that of the geometry is zero.
"""

from __future__ import annotations

import numpy as np

from stickslip.geometry.arrays import LAST_DIGITS
from stickslip.solvers.accuracy.by_chance import by_chance
from stickslip.solvers.accuracy.mesh_error import DISSIPATED, Values, at_points, observed, without_limit
from stickslip.solvers.accuracy.two_level import MeshCorrection
from stickslip.solvers.results.observe import Observer
from stickslip.solvers.results.step_result import ErrorParts, Quantity, StepResult, quantities
from stickslip.solvers.scene.record import Value
from stickslip.solvers.stepping.stepper import Accepted

FACTOR = 2.0
AT_THE_EDGE = ("contact_area", "stick_area", "slip_area", "max_pressure", "max_penetration")


def smooth_errors(
    observe: Observer, accepted: Accepted, result: StepResult
) -> tuple[Values, dict[Quantity, ErrorParts]]:
    """Numbers of a step with bubbles, and the errors of its result's, but for those that an edge decides; collective.

    Nothing if the step was not followed, nor of numbers that have no limit.
    """
    refined, companion = accepted.state.refined, observe.stepper.companion
    if refined is None or not isinstance(companion, MeshCorrection):
        return {}, {}
    numbers = observed(observe, accepted, refined)
    better, least = quantities(numbers), dict[Quantity, Value]()
    moved = companion.displacement_at(refined, observe.probes)
    better |= {Quantity("probes", name, "displacement"): value for name, value in moved.items()}
    for c in accepted.stepper.system.contacts:
        local = by_chance(c, result.contacts[c.name], numbers.contacts[c.name])
        least |= {Quantity("contacts", c.name, name): chance for name, chance in local.items()}
        least[DISSIPATED] = np.hypot(least.get(DISSIPATED, 0.0), local["dissipation"])
    corrected, errors = dict[Quantity, Value](), dict[Quantity, ErrorParts]()
    system = accepted.stepper.system
    found = quantities(result)
    endless = at_points(system.problem, found)
    for c in system.contacts:
        endless |= without_limit(c, result.contacts[c.name], LAST_DIGITS * system.extent)
    mesh, constraints = system.mesh, system.constraints
    unknown = () if mesh.comm.allreduce(constraints.apart, min) else ("supports",)
    for key, value in found.items():
        known = key in better and key not in endless and key.kind not in unknown
        if known and key.quantity not in (*AT_THE_EDGE, "stress"):
            corrected[key] = better[key]
            off = np.maximum(FACTOR * np.abs(better[key] - value), least.get(key, 0.0))
            errors[key] = ErrorParts(mesh=off, geometry=0.0 * off, converges=True)
    return corrected, errors
