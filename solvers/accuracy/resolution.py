"""How finely the two sides of a contact resolve the part that touches, and what errors of its numbers say at least.

Where the part that touches is smaller than one element of a side, finer spaces on these cells, or on cells cut twice,
do not see it either: what they differ by says nothing. Measured on a roller against a larger one, order 1 and 2, either
side the coarse one, stated / true of the largest pressure was 0 to 1 below .5 elements (true errors of 7 to 530 %), of
areas .1 to 1.7; from .8 elements on .6 to 1.3 and .5 to 3, as elsewhere. So such numbers are stated to be as uncertain
as they are large.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stickslip.geometry.arrays import Bools
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.accuracy.iteration_errors import AREAS
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.results.step_result import OPEN, ContactState, ErrorParts, Errors, Quantity, StepResult

BLIND = 0.99  # elements across; one that a flat contact covers wholly is enough
LOCAL = (*AREAS, "max_pressure", "max_penetration", "max_slip")


def elements_touched(rows: ContactRows, state: ContactState) -> tuple[float, float]:
    """Elements across the part that touches: of the slave, and of the master; inf of a rigid obstacle.

    The part is as wide as its area tells; triangles count as halves of quadrilaterals.
    """
    closed = state.status != OPEN
    own = _across(rows.surface, closed, state.contact_area)
    return own, np.inf if rows.master is None else _across(rows.master, faced(rows, closed), state.contact_area)


def faced(rows: ContactRows, nodes: Bools) -> Bools:
    """Nodes (n_master,) of the master whose facets face these nodes (n,) of the slave."""
    found = np.zeros(rows.relative.shape[1], bool)
    found[rows.relative[np.flatnonzero(nodes)].indices] = True
    return found[len(nodes) :]


def _across(side: Surface, nodes: Bools, area: float) -> float:
    """Elements of which all nodes are among these (n,), or else some, across an area [m^(d-1)]; inf without nodes."""
    sizes, inside = side.quadrature(2 * side.degree)[0].sum(axis=1), nodes[side.facets]
    taken = sizes[inside.all(axis=1)] if inside.all(axis=1).any() else sizes[inside.any(axis=1)]
    alike = 2 if side.shape == "triangle" else 1
    return float(area / (alike * taken.mean())) ** (1 / (side.dim - 1)) if len(taken) else np.inf


def unresolved(rows: ContactRows, state: ContactState) -> bool:
    """Whether the part that touches, which a law bounds, lies within an element of one of the sides."""
    return rows.normal.sides == 1 and min(elements_touched(rows, state)) < BLIND


def with_unresolved(contacts: Sequence[ContactRows], step: StepResult, errors: Errors) -> Errors:
    """Errors of a step's numbers, where they are known; those of unresolved contacts are at least the numbers."""
    found = dict(errors)
    for rows in contacts:
        state = step.contacts[rows.name]
        parts_of = {key: found.get(key, ErrorParts()) for key in (Quantity("contacts", rows.name, x) for x in LOCAL)}
        stated = {key: of for key, of in parts_of.items() if of.mesh is not None or of.converges is False}
        if stated and unresolved(rows, state):
            for key, parts in stated.items():
                size = abs(float(getattr(state, key.quantity)))
                off = size if parts.mesh is None else max(float(parts.mesh), size)
                found[key] = replace(parts, mesh=off, geometry=parts.geometry or 0.0, converges=True)
    return found
