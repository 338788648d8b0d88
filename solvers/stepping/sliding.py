"""Sliding contacts: a state is carried over to other contact rows, and a test tells whether the pairs still hold."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.stepping.slip_dependence import Lengths
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.update import flat_rows
from stickslip.solvers.system.system import System

SLID = 0.05  # part of the smallest facet; if a point slides farther, the pairs are searched again


def relative_positions(system: System, state: State, names: Iterable[str]) -> dict[str, Array]:
    """Where the surfaces of some contacts are: what the search for pairs starts from; collective.

    Returns:
        By contact, displacement (n_all, d) [m] of the nodes of both sides, minus that of a rigid obstacle.
    """
    pairs = zip(system.contacts, system.interface.displacement(state.u), strict=True)
    return {c.name: v - state.motion[c.name] for c, v in pairs if c.name in names}


def carried_over(state: State, system: System) -> State:
    """The same state, its tractions and relative displacement by the contact rows of `system`; collective.

    Tractions are averaged to the slave nodes and turned with the local frames there.
    """
    places = AdmissibleSet(state.rows, state.time, 1.0).places

    def by_new_rows(p: Array) -> Array:
        normal, tangential = [np.zeros(0)], []
        for old, place, c in zip(state.rows, places, system.contacts, strict=True):
            p_n, t = p[place.normal], p[place.tangential].reshape(-1, place.components)
            normal.append(c.normal_of_nodes(old.node_pressure(p_n)))
            tangential.append(c.tangential_of_nodes(old.node_traction(t)).ravel())
        return np.concatenate([*normal, *tangential])

    positions = relative_positions(system, state, [c.name for c in system.contacts])
    w = flat_rows(system.contacts, [positions[c.name] for c in system.contacts])
    previous = state.previous and replace(state.previous, p=by_new_rows(state.previous.p))

    def slid_by_new_rows(slid: Lengths) -> dict[str, Array]:
        pairs = zip(state.rows, system.contacts, strict=True)
        return {c.name: c.tangential_mean(old.share_t.T @ slid[c.name]) for old, c in pairs if c.name in slid}

    left = state.correction and replace(
        state.correction,
        p=by_new_rows(state.correction.p),
        w=by_new_rows(state.correction.w),
        slid=slid_by_new_rows(state.correction.slid),
    )
    return replace(
        state,
        p=by_new_rows(state.p),
        w=w,
        previous=previous,
        rows=system.contacts,
        correction=left,
        slid=slid_by_new_rows(state.slid),
    )


def pairs_hold(system: System, searched: Mapping[str, Array], now: Mapping[str, Array]) -> bool:
    """Whether no point has slid far since the pairs were searched.

    Args:
        system: its contact rows are those of the pairs.
        searched: by sliding contact, `relative_positions` (n_all, d) [m] that the pairs were searched at.
        now: the present ones.
    """
    for c in system.contacts:
        if c.name in searched:
            slid = np.linalg.norm(c.node_motion(now[c.name] - searched[c.name])[1][c.node_weights > 0], axis=1)
            corners = c.surface.points[c.surface.facets]
            smallest = float(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).min())
            if slid.max(initial=0.0) > SLID * smallest:
                return False
    return True
