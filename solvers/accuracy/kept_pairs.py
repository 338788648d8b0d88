"""Error of the pairs and normals of the start, which contacts keep that do not slide: the same history with `sliding`.

To first order a force changes by the turn of its normal, and a gap by the slope of the side, times the slip. What
bodies make of both is solved: what numbers differ by is stated, in the part of the geometry.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from stickslip.geometry.arrays import SLIGHT, Array
from stickslip.geometry.errors import StickslipError
from stickslip.solvers.accuracy.mesh_error import Values
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.interface.factorised import FactorisedVolume
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.results.observe import Observer
from stickslip.solvers.results.step_result import OPEN, ContactState, StepResult, quantities
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.stepping.history import HistoryRow
from stickslip.solvers.stepping.method_chain import MethodChain
from stickslip.solvers.stepping.stepper import Stepper

log = logging.getLogger(__name__)


def facet_length(rows: ContactRows) -> float:
    """Median length [m] of the first edge of the master's facets."""
    assert rows.master is not None
    points, facets = rows.master.points, rows.master.facets
    return float(np.median(np.linalg.norm(points[facets[:, 1]] - points[facets[:, 0]], axis=1)))


def moved_on_obstacle(rows: ContactRows, state: ContactState) -> Array:
    """Motion (n, d) [m] of the slave's nodes relative to an obstacle."""
    normal = rows.frames[:, 0]
    return np.asarray(state.slip + (rows.node_gap - state.gap)[:, None] * normal)  # u_T + u_n n


def leaves(rows: ContactRows, problem: Problem, state: ContactState) -> bool:
    """Whether points have left a facet of the master; or on an obstacle its normals, by which forces turn.

    A plane is alike everywhere, and nothing moves the body along a surface that turns in itself.
    """
    pair, touching = problem.pairs[rows.name], state.status != OPEN
    kept = not (pair.contact.sliding or rows.normal.ties) and pair.contact.gap is None
    if not kept or not touching.any():
        return False
    if pair.obstacle is None:
        return state.max_slip > facet_length(rows)
    obstacle = problem.obstacles[pair.obstacle]
    if obstacle.rotation is not None:
        return False
    points = rows.surface.points[touching]
    turn = obstacle.normals(points + moved_on_obstacle(rows, state)[touching]) - obstacle.normals(points)
    push = (state.weight * state.pressure)[touching]
    return float(np.linalg.norm(push @ turn)) > SLIGHT * state.normal_force


class KeptPairs:
    """Solves the history of a run again, with the contacts whose points leave their pairs sliding; collective."""

    def __init__(self, stepper: Stepper, on_iteration: Callable[[HistoryRow], None] = lambda row: None) -> None:
        """
        Args:
            stepper: of the run.
            on_iteration: called after each iteration, on every rank.
        """
        self._stepper, self._on_iteration = stepper, on_iteration

    def leaving(self, steps: Sequence[StepResult]) -> set[str]:
        """Names of the contacts whose points leave their pairs."""
        system = self._stepper.system
        states = [(c, step.contacts[c.name]) for step in steps for c in system.contacts if c.name in step.contacts]
        return {c.name for c, state in states if leaves(c, system.problem, state)}

    def __call__(self, steps: Sequence[StepResult]) -> tuple[Values | None, ...]:
        """What each number of the steps of a run changes by, >= 0; None where that cannot be solved.

        Nothing is solved, and nothing returned, if all points keep their pairs.
        """
        system, names = self._stepper.system, self.leaving(steps)
        if not names:
            return ()
        log.info("the same history with contacts.%s sliding, for the error of the pairs", ", contacts.".join(names))
        counters, found = Counters(), list[Values]()
        try:
            for step, slid in zip(steps, self._each(names, [step.time for step in steps], counters), strict=True):
                found.append({key: np.abs(slid[key] - value) for key, value in quantities(step).items()})
        except StickslipError as error:
            log.info("no error of the pairs from there on: %s", error)
        system.counters.error_solves += counters.volume_solves + counters.error_solves
        return (*found, *[None] * (len(steps) - len(found)))

    def _each(self, names: set[str], times: Sequence[float], counters: Counters) -> Iterator[Values]:
        """Numbers at each time [s], contacts of these names sliding.

        Raises:
            StickslipError: a step cannot be solved.
        """
        system, chain = self._stepper.system, self._stepper.chain
        pairs = {
            name: replace(pair, contact=replace(pair.contact, sliding=pair.contact.sliding or name in names))
            for name, pair in system.problem.pairs.items()
        }
        other = replace(system, problem=replace(system.problem, pairs=pairs), counters=counters)
        factor = chain.volume if isinstance(chain.volume, FactorisedVolume) else None
        stepper = Stepper(other, MethodChain(other, chain.reached, factor))
        state, observe = stepper.start(), Observer.of(stepper)
        for time in times:
            accepted = stepper.reach(state, time, self._on_iteration)
            yield quantities(observe(accepted))
            state = accepted.state
