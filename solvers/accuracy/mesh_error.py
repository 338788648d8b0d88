"""Error of the mesh of each number of a step, from the same step with bubbles, see `two_level`.

Stated are FACTOR times the differences. Areas of touching, sticking and slipping nodes are multiples of a node's area:
theirs is EDGE times the difference to an area whose edge lies between nodes, see `areas`. A largest pressure that grows
without end as the mesh is refined has no error, see `peaks`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from solvers.accuracy.areas import beyond_nodes
from solvers.accuracy.peaks import grows
from solvers.accuracy.two_level import FACTOR
from solvers.contact.rows import ContactRows
from solvers.results.error_parts import ErrorParts
from solvers.results.numbers import quantities
from solvers.results.observe import Observer
from solvers.results.step_result import OPEN, SLIP, STICK, ContactState, StepResult
from solvers.stepping.stepper import Accepted

EDGE = 1.5
AREAS = ("contact_area", "stick_area", "slip_area")


def with_mesh_errors(observe: Observer, accepted: Accepted, result: StepResult) -> StepResult:
    """The result of a step with the errors of its mesh, if its history with bubbles was followed; collective."""
    refined = accepted.state.refined
    if refined is None:
        return result
    start, before = accepted.start, accepted.substep_start
    same = replace(
        accepted, state=refined, start=start.refined or start, substep_start=before.refined or before, others=()
    )
    numbers = observe.numbers(same)
    values = quantities(numbers)
    for c in accepted.stepper.system.contacts:
        values |= {f"contacts.{c.name}.{key}": area for key, area in _areas(c, numbers.contacts[c.name]).items()}
    found = {key: value for key, value in quantities(result).items() if key in values}
    errors = {key: ErrorParts(mesh=_factor(key) * np.abs(values[key] - found[key]), converges=True) for key in found}
    for c in accepted.stepper.system.contacts:
        if grows(c.surface, result.contacts[c.name].pressure):
            errors[f"contacts.{c.name}.max_pressure"] = ErrorParts(converges=False)
    return replace(result, corrected=values, errors=errors)


def _factor(key: str) -> float:
    return EDGE if key.endswith(AREAS) else FACTOR


def _areas(c: ContactRows, contact: ContactState) -> dict[str, float]:
    """Areas of a contact [m^(d-1)] whose edges lie between nodes."""
    opened, sticks, slips = (contact.status == k for k in (OPEN, STICK, SLIP))
    gap, slip = np.where(c.node_weights > 0, contact.gap, 0.0), np.linalg.norm(contact.slip_increment, axis=1)
    touching = contact.contact_area + beyond_nodes(c.surface, ~opened, gap)
    sticking = contact.stick_area + beyond_nodes(c.surface, sticks, slip, among=sticks | slips)
    sticking += beyond_nodes(c.surface, sticks, gap, among=sticks | opened)
    return {"contact_area": touching, "stick_area": sticking, "slip_area": touching - sticking}
