"""Sliding contacts: a substep begins with the pairs of where it starts, and ends with those of where it ends.

These are searched until points no longer move between two searches: a fixed point, which does not depend on the start.
A state is carried over to the contact rows of other pairs.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stickslip.geometry.arrays import ROUNDING, SLIGHT, Array
from stickslip.geometry.errors import GeometryError, SceneError
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.contact.pairing import margin
from stickslip.solvers.contact.skins import NEAR, motion_between, nodes_near
from stickslip.solvers.iteration import Status
from stickslip.solvers.stepping.law_memory import Memory
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.substep import Attempt, Substep, SubstepSolver, unsolved
from stickslip.solvers.stepping.update import flat_rows
from stickslip.solvers.system.system import System

SEARCHES = 12  # of the pairs, in one substep
log = logging.getLogger(__name__)


class PairSearch:
    """Solves a substep with the pairs of where it starts, and again with those of where it ends until they stay.

    `present` solves with the pairs that are tried; where no contact slides, with those that are known.
    """

    def __init__(self, solver: SubstepSolver) -> None:
        """`solver` solves with the pairs of the bodies at rest."""
        self._solver, self.present = solver, solver
        pairs = solver.system.problem.pairs
        self._names = [name for name, pair in pairs.items() if pair.contact.sliding]
        self._found = [name for name, pair in pairs.items() if pair.skins]

    def active(self) -> bool:
        """Whether a contact slides, or bodies may come near."""
        return bool(self._names or self._found)

    def around(self, inner: Substep) -> Substep:
        def searching(state: State, end: float) -> Attempt:
            first = self._solver
            searched = {name: state.searched[name] for name in self._found if name in state.searched}
            searched |= relative_positions(first.system, state, self._names)
            searched |= {key: near for key, near in state.searched.items() if key.endswith(NEAR)}
            begin, last, far = relative_positions(first.system, state, self._found), None, np.inf
            tried: list[Searched] = []
            for _ in range(SEARCHES):
                try:
                    self.present = self.found(searched) if searched else first
                except (SceneError, GeometryError) as error:
                    log.warning("t = %g: %s", end, error)
                    apart = unsolved(state, first.surface.size, Status.APART, [])
                    return Attempt(solver=first, begin=state, solution=apart)
                system = self.present.system
                searched |= _lists(system) if searched else {}
                start = replace(carried_over(state, system), searched=searched) if searched else state
                if last is not None:  # behind a jump the path from the state before leads to pairs that take turns
                    jumped = bool(tried) and tried[-1].attempt.solution.jumps
                    start = replace(start, guess=carried_over(last, system), jumped=jumped)
                attempt = inner(start, end)
                if attempt.state is None or (attempt.solution.jumps and first.chain.cut_first):
                    return attempt  # a shorter substep follows
                known, last = last, attempt.state
                now = relative_positions(system, attempt.state, [*self._names, *self._found])
                nearer = self._nearer(system, searched, begin, now)
                if nearer:
                    searched = searched | begin | nearer
                    continue
                slid = {name: now[name] for name in self._names}
                before, far = far, slid_since(system, {name: searched[name] for name in slid}, slid)
                if known is not None:  # as much smaller is what a further search would change
                    attempt = replace(attempt, unsettled=min(far / before, 1.0) * _apart(system, known, last))
                # what an iteration leaves in the places keeps them from settling
                if far <= ROUNDING or before <= far <= system.problem.solver.tolerance:
                    return attempt
                change = {name: now[name] - searched[name] for name in slid}
                tried.append(Searched(far=far, places=slid, change=change, attempt=attempt))
                if far > SLIGHT and any(slid_since(system, x.places, slid) <= SLIGHT * far for x in tried[:-1]):
                    break  # to and fro, for ever
                searched = searched | (accelerated([x for x in tried if x.far <= SLIGHT]) if far <= SLIGHT else slid)
            if far <= SLIGHT:
                return attempt
            log.warning("t = %g: pairs still change after %d searches; the nearest ones are kept", end, len(tried))
            first.chain.unsettled.append(end)
            unsettled = max(each.attempt.unsettled for each in tried)
            return replace(min(tried, key=lambda each: each.far).attempt, unsettled=unsettled)

        return searching

    def _nearer(
        self, system: System, searched: Mapping[str, Array], begin: Mapping[str, Array], now: Mapping[str, Array]
    ) -> dict[str, Array]:
        """Nodes that may come to touch in a substep and that no list has, by the pairs' names.

        Args:
            system: its pairs have the lists.
            searched: where these were made; what is absent: at the start.
            begin, now: `relative_positions` at both ends of the substep.
        """
        nearer = dict[str, Array]()
        for c in system.contacts if self._found else ():
            if c.near is None or c.master is None:
                continue
            sides, n = (c.surface, c.master), len(c.surface.nodes)
            since, within = (now[c.name] - at for at in (searched.get(c.name, 0.0), begin[c.name]))
            far = margin(system.problem, c.name)
            # half of the margin is kept back, so that a list is not made again at once
            if motion_between(since[:n], since[n:]) <= far / 2:
                continue
            reach = far + motion_between(within[:n], within[n:])
            one, other = (
                replace(s, points=s.points + v) for s, v in zip(sides, np.split(begin[c.name], [n]), strict=True)
            )
            if (nodes_near(one, other, reach - far / 2) & ~c.near).any():
                nearer[f"{c.name}{NEAR}"] = nodes_near(one, other, reach).astype(float)
        return nearer

    def found(self, searched: Mapping[str, Array]) -> SubstepSolver:
        """A solver for the same bodies, with the pairs that are found at these `relative_positions`; collective."""
        self._solver.follow_bodies()  # whose form may be another; the solvers of other pairs share what it stores
        places, latest = self._solver.latest or ({}, self._solver)
        same = places.keys() == searched.keys() and latest.volume is self._solver.volume and not self._names
        if same and all(np.array_equal(x, places[name]) for name, x in searched.items()):
            return latest
        system = self._solver.system.searched(searched)
        self._solver.widen(system)
        other = SubstepSolver(system, self._solver.chain)
        other.surface.adopt(self._solver.surface)
        other.bolts = self._solver.bolts
        self._solver.latest = {**searched, **_lists(system)}, other
        return other


def _apart(system: System, one: State, other: State) -> float:
    """Energy norm [J^(1/2)] of the difference of two displacements; collective."""
    off = one.u - other.u
    return float(np.sqrt(max((system.K * off).dot(off), 0.0)))


@dataclass(frozen=True, kw_only=True)
class Searched:
    """A search for the pairs of sliding contacts, and the substep that was solved with them."""

    far: float  # that points have slid since, see `slid_since`
    places: dict[str, Array]  # `relative_positions` at its end [m]
    change: Mapping[str, Array]  # these less the ones that it began with [m]
    attempt: Attempt


def accelerated(tried: Sequence[Searched]) -> dict[str, Array]:
    """Where pairs are searched next: where the last of some searches leads, extrapolated to where nothing changes.

    Source: Anderson, J. ACM 12 (1965).
    """
    places, changes = (
        np.array([np.concatenate([x.ravel() for x in at.values()]) for at in each])
        for each in ([x.places for x in tried], [x.change for x in tried])
    )
    turns = np.linalg.lstsq(np.diff(changes, axis=0).T, changes[-1], rcond=None)[0]
    last = tried[-1].places
    back = np.split(turns @ np.diff(places, axis=0), np.cumsum([x.size for x in last.values()])[:-1])
    return {name: x - y.reshape(x.shape) for (name, x), y in zip(last.items(), back, strict=True)}


def _lists(system: System) -> dict[str, Array]:
    """Which nodes are near, by the names that `State.searched` has for that."""
    return {f"{c.name}{NEAR}": c.near.astype(float) for c in system.contacts if c.near is not None}


def relative_positions(system: System, state: State, names: Iterable[str]) -> dict[str, Array]:
    """Places of the surfaces of some contacts, from which the search for pairs starts; collective.

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

    def memory_by_new_rows(memory: Memory) -> dict[str, Array]:
        pairs = zip(state.rows, system.contacts, strict=True)
        return {c.name: c.tangential_mean(old.share_t.T @ memory[c.name]) for old, c in pairs if c.name in memory}

    left = state.correction and replace(
        state.correction,
        p=by_new_rows(state.correction.p),
        w=by_new_rows(state.correction.w),
        memory=memory_by_new_rows(state.correction.memory),
    )
    return replace(
        state,
        p=by_new_rows(state.p),
        w=w,
        previous=previous,
        rows=system.contacts,
        correction=left,
        memory=memory_by_new_rows(state.memory),
    )


def slid_since(system: System, searched: Mapping[str, Array], now: Mapping[str, Array]) -> float:
    """How far points have slid since the pairs were searched, relative to the smallest facet [-].

    Args:
        system: its contact rows are those of the pairs.
        searched: by sliding contact, `relative_positions` (n_all, d) [m] that the pairs were searched at.
        now: the present ones.
    """
    far = 0.0
    for c in system.contacts:
        if c.name in searched:
            slid = np.linalg.norm(c.node_motion(now[c.name] - searched[c.name])[1][c.node_weights > 0], axis=1)
            corners = c.surface.points[c.surface.facets]
            smallest = float(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).min())
            far = max(far, float(slid.max(initial=0.0)) / smallest)
    return far
