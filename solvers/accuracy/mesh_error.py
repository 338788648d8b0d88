"""Error of the mesh of each number of a step, from the same step with bubbles, see `two_level`.

Stated is FACTOR times the difference. Part of it is that of the geometry: the share of what curved sides add by their
bulges, beside what the finite element space adds; where these have opposite signs, OPPOSED of their sum is the least
that is stated. Areas of touching, sticking and slipping nodes are multiples of a node's area: theirs is BETWEEN times
the difference to areas whose edges lie between nodes, and EDGE times the facets that these cross, see `areas`. The
largest slip of the nodes that touch is compared with that up to the same edge. A largest pressure that grows without
end as the mesh is refined has no error, see `peaks`, nor have the penetration that it causes and the slip beside it.

The four factors are fitted to 25 problems on three meshes each, by `stickslip verify accuracy`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from solvers.accuracy.areas import areas_between_nodes, crossings, scatter
from solvers.accuracy.peaks import grows
from solvers.accuracy.two_level import MeshCorrection
from solvers.contact.rows import ContactRows
from solvers.results.error_parts import ErrorParts, Quantity, Value
from solvers.results.numbers import quantities
from solvers.results.observe import Observer
from solvers.results.step_result import OPEN, ContactState, StepResult
from solvers.stepping.state import State
from solvers.stepping.stepper import Accepted

FACTOR, OPPOSED = 1.6, 0.5
BETWEEN, EDGE = 0.75, 0.2
Values = dict[Quantity, Value]


def mesh_errors(observe: Observer, accepted: Accepted, result: StepResult) -> tuple[Values, dict[Quantity, ErrorParts]]:
    """Numbers of a step with bubbles, and the errors of its result's; nothing if it was not followed; collective."""
    refined, found = accepted.state.refined, quantities(result)
    if refined is None:
        return {}, {}
    corrected = _numbers(observe, accepted, refined)
    straight = corrected if refined.unbent is None else _numbers(observe, accepted, refined.unbent)
    errors, chances = dict[Quantity, ErrorParts](), dict[Quantity, float]()
    for c in accepted.stepper.system.contacts:
        own = scatter(c.surface, result.contacts[c.name], c.node_weights)
        chances |= {Quantity("contacts", c.name, name): chance for name, chance in own.items()}
    for key, value in corrected.items():
        bent, flat = np.abs(value - straight[key]), np.abs(straight[key] - found[key])
        whole = FACTOR * np.maximum(np.abs(value - found[key]), OPPOSED * (bent + flat))
        if key in chances:
            whole = BETWEEN * np.abs(value - found[key]) + EDGE * chances[key]
        share = bent / np.maximum(bent + flat, np.finfo(float).tiny)
        errors[key] = ErrorParts(mesh=whole * (1 - share), geometry=whole * share, converges=True)
    for c in accepted.stepper.system.contacts:
        errors |= _without_limit(c, result.contacts[c.name])
    return corrected, errors


def _without_limit(c: ContactRows, contact: ContactState) -> dict[Quantity, ErrorParts]:
    """What is said in place of an error where the largest pressure of a contact grows without end.

    With compliance it has a limit, which no mesh of that size comes near. The slip close by converges slowly as well.
    """
    if not grows(c.surface, contact.pressure):
        return {}
    soft, peak = c.normal.at_quadrature, np.arange(len(contact.pressure)) == np.argmax(contact.pressure)
    said = {"max_pressure": ErrorParts(converges=None if soft else False)}
    if soft:
        said["max_penetration"] = ErrorParts()
    near = peak | (c.surface.neighbours() @ peak.astype(float) > 0)
    if near[np.argmax(np.linalg.norm(contact.slip, axis=1))]:
        said["max_slip"] = ErrorParts()
    return {Quantity("contacts", c.name, name): parts for name, parts in said.items()}


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
        if not c.normal.at_quadrature:  # only compliance penetrates, else that is what an iteration left
            values[Quantity("contacts", c.name, "max_penetration")] = 0.0
    return values


def _largest_slip(c: ContactRows, contact: ContactState) -> float:
    """Largest slip up to the edge of contact between nodes [m]."""
    closed = contact.status != OPEN
    found = crossings(c.surface, closed, np.where(c.node_weights > 0, contact.gap, 0.0))
    inner = closed.copy()
    inner[[crossing.inside for crossing in found if crossing.at < 0]] = False
    at_edge = [contact.slip[a] + at * (contact.slip[b] - contact.slip[a]) for a, b, at in found]
    return float(max(np.linalg.norm(slip) for slip in [np.zeros(1), *contact.slip[inner], *at_edge]))
