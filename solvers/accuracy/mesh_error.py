"""Error of the mesh of each number of a step, from the same step with bubbles, see `two_level`.

Stated are FACTOR times the differences. Areas of touching, sticking and slipping nodes are multiples of a node's area:
theirs is EDGE times the difference to an area whose edge lies between nodes, see `areas`. What curved sides add by
their bulges is the part of the geometry. A largest pressure that grows without end as the mesh is refined has no error,
see `peaks`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from solvers.accuracy.areas import beyond_nodes
from solvers.accuracy.peaks import grows
from solvers.accuracy.two_level import FACTOR, MeshCorrection
from solvers.contact.rows import ContactRows
from solvers.results.error_parts import ErrorParts, Quantity, Value
from solvers.results.numbers import quantities
from solvers.results.observe import Observer
from solvers.results.step_result import OPEN, SLIP, STICK, ContactState
from solvers.stepping.state import State
from solvers.stepping.stepper import Accepted

EDGE = 1.5
AREAS = ("contact_area", "stick_area", "slip_area")
Values = dict[Quantity, Value]


def mesh_errors(observe: Observer, accepted: Accepted, found: Values) -> tuple[Values, dict[Quantity, ErrorParts]]:
    """Numbers of a step with bubbles, and the errors of those `found` without; nothing if it was not followed.

    Collective.
    """
    refined = accepted.state.refined
    if refined is None:
        return {}, {}
    corrected = _numbers(observe, accepted, refined)
    straight = corrected if refined.unbent is None else _numbers(observe, accepted, refined.unbent)
    errors = {}
    for key, value in corrected.items():
        factor = EDGE if key.quantity in AREAS else FACTOR
        bent = factor * np.abs(value - straight[key])
        errors[key] = ErrorParts(mesh=factor * np.abs(straight[key] - found[key]), geometry=bent, converges=True)
    for c in accepted.stepper.system.contacts:
        key = Quantity("contacts", c.name, "max_pressure")
        if grows(c.surface, c.node_pressure(accepted.stepper.split(accepted.state.p)[0][_index(accepted, c)])):
            errors[key] = ErrorParts(converges=False)
    return corrected, errors


def _index(accepted: Accepted, c: ContactRows) -> int:
    return [other.name for other in accepted.stepper.system.contacts].index(c.name)


def _numbers(observe: Observer, accepted: Accepted, state: State) -> Values:
    """Numbers of another state at the end of the same step."""
    start, before = accepted.start, accepted.substep_start
    same = replace(accepted, state=state, start=start.refined or start, substep_start=before.refined or before)
    numbers = observe.numbers(same)
    values = quantities(numbers)
    companion = observe.stepper.companion
    if observe.probes and isinstance(companion, MeshCorrection):
        moved = companion.displacement_at(state, observe.probes)
        values |= {Quantity("probes", name, "displacement"): value for name, value in moved.items()}
    for c in accepted.stepper.system.contacts:
        values |= {Quantity("contacts", c.name, key): area for key, area in _areas(c, numbers.contacts[c.name]).items()}
    return values


def _areas(c: ContactRows, contact: ContactState) -> dict[str, float]:
    """Areas of a contact [m^(d-1)] whose edges lie between nodes."""
    opened, sticks, slips = (contact.status == k for k in (OPEN, STICK, SLIP))
    gap, slip = np.where(c.node_weights > 0, contact.gap, 0.0), np.linalg.norm(contact.slip_increment, axis=1)
    touching = contact.contact_area + beyond_nodes(c.surface, ~opened, gap)
    sticking = contact.stick_area + beyond_nodes(c.surface, sticks, slip, among=sticks | slips)
    sticking += beyond_nodes(c.surface, sticks, gap, among=sticks | opened)
    return {"contact_area": touching, "stick_area": sticking, "slip_area": touching - sticking}
