"""Error of the mesh of each number of a step, from the same step with bubbles, see `two_level`.

Stated are FACTOR times the differences. Areas of touching, sticking and slipping nodes are multiples of a node's area:
theirs is EDGE times the difference to an area whose edge lies between nodes, see `areas`. The largest slip of the nodes
that touch is compared with that up to the same edge. Part of the difference is that of the geometry: the share of what
curved sides add by their bulges, beside what the finite element space adds; where they have opposite signs, both parts
are of what is left. A largest pressure that grows without end as the mesh is refined has no error, see `peaks`, nor has
the penetration that it causes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geometry.arrays import Array
from solvers.accuracy.areas import areas_between_nodes, crossings
from solvers.accuracy.peaks import grows
from solvers.accuracy.two_level import FACTOR, MeshCorrection
from solvers.contact.rows import ContactRows
from solvers.results.error_parts import ErrorParts, Quantity, Value
from solvers.results.numbers import quantities
from solvers.results.observe import Observer
from solvers.results.step_result import OPEN, ContactState
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
        whole = (EDGE if key.quantity in AREAS else FACTOR) * np.abs(value - found[key])
        bent, flat = np.abs(value - straight[key]), np.abs(straight[key] - found[key])
        share = bent / np.maximum(bent + flat, np.finfo(float).tiny)
        errors[key] = ErrorParts(mesh=whole * (1 - share), geometry=whole * share, converges=True)
    for c in accepted.stepper.system.contacts:
        if grows(c.surface, c.node_pressure(accepted.stepper.split(accepted.state.p)[0][_index(accepted, c)])):
            for quantity in ("max_pressure", "max_penetration") if c.normal.at_quadrature else ("max_pressure",):
                errors[Quantity("contacts", c.name, quantity)] = ErrorParts(converges=False)
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
        contact = numbers.contacts[c.name]
        areas = areas_between_nodes(c.surface, contact, c.node_weights)
        values |= {Quantity("contacts", c.name, key): area for key, area in areas.items()}
        values[Quantity("contacts", c.name, "max_slip")] = _largest_slip(c, contact)
    return values


def _largest_slip(c: ContactRows, contact: ContactState) -> float:
    """Largest slip up to the edge of contact between nodes [m]."""
    closed = contact.status != OPEN
    found = crossings(c.surface, closed, np.where(c.node_weights > 0, contact.gap, 0.0))
    inner = closed.copy()
    inner[[crossing.inside for crossing in found if crossing.at < 0]] = False
    at_edge = [contact.slip[a] + at * (contact.slip[b] - contact.slip[a]) for a, b, at in found]
    return float(max(np.linalg.norm(slip) for slip in [np.zeros(1), *contact.slip[inner], *at_edge]))
