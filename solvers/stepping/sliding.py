"""Contacts that slide: where their surfaces are, what a state is in other rows, and whether its pairs still hold."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from geometry.arrays import Array
from solvers.contact.admissible_set import AdmissibleSet
from solvers.stepping.state import State
from solvers.stepping.update import stack
from solvers.system.system import System

LEFT = 0.5  # of the smallest facet: points that slide farther are paired again


def positions(system: System, state: State, names: Iterable[str]) -> dict[str, Array]:
    """Displacement (n_all, d) [m] of contacts' nodes, relative to a rigid obstacle."""
    pairs = zip(system.contacts, system.interface.displacement(state.u), strict=True)
    return {c.name: v - state.motion[c.name] for c, v in pairs if c.name in names}


def told_in(state: State, system: System) -> State:
    """The state in the rows of `system`: tractions are carried by the slave's nodes and turned with their frames."""
    places = AdmissibleSet(state.rows, state.time, 1.0).places

    def told(p: Array) -> Array:
        normal, tangential = [np.zeros(0)], []
        for old, place, c in zip(state.rows, places, system.contacts, strict=True):
            p_n, t = p[place.normal], p[place.tangential].reshape(-1, place.components)
            normal.append(c.normal_of_nodes(old.node_pressure(p_n)))
            tangential.append(c.tangential_of_nodes(old.node_traction(t)).ravel())
        return np.concatenate([*normal, *tangential])

    moved = positions(system, state, [c.name for c in system.contacts])
    w = stack(system.contacts, [moved[c.name] for c in system.contacts])
    before = state.before and replace(state.before, p=told(state.before.p))
    return replace(state, p=told(state.p), w=w, before=before, rows=system.contacts)


def stay(system: System, before: Mapping[str, Array], after: Mapping[str, Array]) -> bool:
    """Whether no point has slid off its facet since the pairs were found."""
    for c in system.contacts:
        if c.name in before:
            slid = np.linalg.norm(c.node_motion(after[c.name] - before[c.name])[1][c.node_weights > 0], axis=1)
            corners = c.surface.points[c.surface.facets]
            smallest = float(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).min())
            if slid.max(initial=0.0) > LEFT * smallest:
                return False
    return True
