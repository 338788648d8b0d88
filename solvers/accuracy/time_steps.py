"""Error of the time steps: the same history with its steps and with half of them, on a coarser mesh.

Friction remembers its path, so every number depends on the steps, most of all the dissipation. Its error falls with the
first power of the step: each step of size h adds h² of it. So twice the difference of both histories is the error of
the steps, at each of them; of external and contact work, sums by the trapezoidal rule, it is up to half as much again.
A coarser mesh shows it nearly as well as the run's own, at a fraction of the price.

The mesh of a file has no coarser one. There the run is compared with the history in half of its steps on its own mesh,
by which times that are left out have no error; every turn of a value in time is kept. Where all steps are alone between
two turns, with the history in steps half as long. A clock is compared with one that allows larger errors; batches of
load cycles, and steps of their cycles, with those half as long.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from stickslip.geometry.arrays import EXACT, ROUNDING
from stickslip.geometry.errors import StickslipError
from stickslip.solvers.accuracy.histories import OnIteration, OtherHistory
from stickslip.solvers.accuracy.mesh_error import Values, corrected, difference
from stickslip.solvers.results.observe import Observer
from stickslip.solvers.results.step_result import ErrorParts, Errors, Quantity, StepResult, quantities
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.settings import Clock
from stickslip.solvers.scene.timeline import Timeline
from stickslip.solvers.stepping.stepper import Stepper

log = logging.getLogger(__name__)
OWN_MESH = "time on its own mesh"
Histories = tuple[Values, Values]  # numbers of a step of two of them
NOTHING_YET: Histories = {}, {}
LOOSER = 4.0  # times the errors of a clock: what steps leave grows in proportion


def remembers(problem: Problem) -> bool:
    """Whether a state depends on the path to it: there is friction or wear, or pairs are searched again."""
    contacts = [pair.contact for pair in problem.pairs.values()]
    return any(c.sliding or c.wear is not None or (c.friction is not None and c.friction.resists()) for c in contacts)


def halves(times: Sequence[float]) -> tuple[float, ...]:
    """The times of a history [s], and between each two the middle; a step at t = 0 stays one.

    >>> halves((0.0, 1.0, 3.0)), halves((1.0,))
    ((0.0, 0.5, 1.0, 2.0, 3.0), (0.5, 1.0))
    """
    starts = (0.0, *times)
    return tuple(t for a, b in zip(starts, times, strict=False) for t in (*[(a + b) / 2] * (a < b), b))


def halved(times: Sequence[float], timeline: Timeline) -> tuple[float, ...]:
    """Every second time of a history [s] between two turns of a value, those of turns and the last one among them.

    Of an odd number between two turns the first three steps become one.

    >>> from stickslip.solvers.scene.timeline import Place
    >>> line = Timeline({Place("supports", "top", "displacement", "x"): ((3.0, 0.0), (6.0, 1.0))}, end=6.0, count=6)
    >>> line.times, halved(line.times, line)
    ((1.0, 2.0, 3.0, 4.0, 5.0, 6.0), (3.0, 6.0))
    """
    turns, kept, stretch = np.array([*timeline.turns, 0.0]), list[float](), list[float]()
    for time in times:
        stretch.append(time)
        if np.abs(turns - time).min() <= EXACT * timeline.end or time == times[-1]:
            odd = len(stretch) % 2 and len(stretch) > 1
            kept += stretch[::-1][::2][::-1][1 if odd else 0 :]
            stretch = []
    return tuple(kept)


class TimeStepErrors:
    """Finds the error of the time steps of a run that is solved, in `ErrorParts.time_step`; collective."""

    def __init__(self, stepper: Stepper, on_iteration: OnIteration = lambda row: None) -> None:
        """
        Args:
            stepper: of the run.
            on_iteration: called after each iteration, on every rank.
        """
        self._stepper, self._on_iteration = stepper, on_iteration
        system = stepper.system
        overlap = ROUNDING * system.extent
        jumps = any((c.node_gap < -overlap).any() for c in system.contacts)
        self._path_matters = remembers(system.problem) or jumps

    def solves(self, times: Sequence[float], coarser: bool) -> int:
        """Number of steps that are solved beside a history of steps to these times [s].

        Args:
            coarser: whether there is a coarser mesh.
        """
        if not self._path_matters:
            return 0
        if self._stepper.clock is not None:
            return len(times)
        timeline = self._stepper.system.problem.timeline
        if timeline.cycle is not None:
            return 2 * len(halves(times))  # in twice the batches
        half = () if coarser else halved(times, timeline)
        return len(half if 0 < len(half) < len(times) else halves(times))

    def __call__(
        self, steps: Sequence[StepResult], history: OtherHistory | None, coarse: Sequence[StepResult]
    ) -> Iterator[Errors]:
        """Yield the errors of each step of a run from rest, up to one that cannot be solved; collective.

        Args:
            steps: results at the requested times, without a gap.
            history: on a coarser mesh; None: there is none.
            coarse: the first of the steps there.
        """
        if not self._path_matters:
            yield from map(_of_works, steps)
            return
        try:
            if self._stepper.clock is not None:
                yield from self._by_clock(steps, self._stepper.clock)
                return
            if history is None:
                yield from self._on_own_mesh(steps)
                return
            log.info("the same history in steps half as long, for the error of the time steps")
            times, before = [step.time for step in coarse], NOTHING_YET
            with history.stepper.system.course.in_halves():
                for whole, half in zip(coarse, history.results(halves(times), times), strict=True):
                    both = quantities(half), quantities(whole)
                    yield _errors(both, before, True, (corrected(half), corrected(whole)))
                    before = both
        except StickslipError as error:
            log.info("no error of the time steps from there on: %s", error)

    def _by_clock(self, steps: Sequence[StepResult], clock: Clock) -> Iterator[Errors]:
        """Yield the difference from the same history by a clock with `LOOSER` errors, three times the run's own.

        Raises:
            StepError: a step cannot be solved.
        """
        self._stepper.clock = replace(clock, error=min(LOOSER * clock.error, 0.5))
        try:
            before = NOTHING_YET
            for step, (_, rough) in zip(steps, self._results([step.time for step in steps]), strict=False):
                both = rough, quantities(step)
                yield _errors(both, before, False, by=OWN_MESH)
                before = both
        finally:
            self._stepper.clock = clock

    def _on_own_mesh(self, steps: Sequence[StepResult]) -> Iterator[Errors]:
        """Yield the same, by the run's own mesh.

        Raises:
            StepError: a step cannot be solved.
        """
        times, timeline = [step.time for step in steps], self._stepper.system.problem.timeline
        half = halved(times, timeline) if timeline.cycle is None else tuple(times)
        finer = len(half) == len(times)
        other = self._results(halves(times) if finer else half)
        unknown = ErrorParts(dear={"time_step": 2.0}, by=OWN_MESH)  # times the run: twice its steps
        before = NOTHING_YET
        for step in steps:
            if step.time in half:
                both = next(values for time, values in other if time == step.time), quantities(step)
                yield _errors(both, before, finer, by=OWN_MESH)
                before = both
            else:
                yield dict.fromkeys(quantities(step), unknown)

    def _results(self, times: Sequence[float]) -> Iterator[tuple[float, Values]]:
        """Yield each time of a history from rest, and the numbers there.

        Raises:
            StepError: a step cannot be solved.
        """
        observe, state = Observer.of(self._stepper), self._stepper.start()
        system = self._stepper.system
        with self._stepper.chain.repeating(system), system.course.in_halves():
            for time in system.counters.clock.counted(times):
                accepted = self._stepper.reach(state, time, self._on_iteration)
                yield time, quantities(observe(accepted))
                state = accepted.state


def _errors(
    both: Histories, before: Histories, finer: bool, sharper: Histories = NOTHING_YET, by: str | None = None
) -> Errors:
    """Errors of the numbers of a step that another history, in steps half or twice as long, has too.

    Args:
        both: numbers of the other one, and of the run.
        before: those at the time before that both have, since which dissipation counts.
        finer: whether the other one has half of the steps.
        sharper: better numbers that both have of it, as areas with edges between nodes.
    """
    other, values = (_since(old, now) for old, now in zip(before, both, strict=True))
    times, found = 2.0 if finer else 1.0, dict[Quantity, ErrorParts]()
    for key, value in values.items():
        own = np.abs(other[key] - value)
        both_sharper = key in sharper[0] and key in sharper[1]
        off = difference(0.0 * own, [own, sharper[0][key] - sharper[1][key]] if both_sharper else [own])
        found[key] = ErrorParts(time_step=times * off, by=by)
    return found


def _since(before: Values, values: Values) -> Values:
    """Numbers of a step whose dissipation is that of all steps since another one."""
    totals = {key: key._replace(quantity="dissipation_total") for key in values if key.quantity == "dissipation"}
    return {**values, **{key: values[total] - before.get(total, 0.0) for key, total in totals.items()}}


def _of_works(step: StepResult) -> Errors:
    """Errors of a step that does not depend on the path: of the works, what time leaves of them in all steps.

    external = stored + contact and contact = compliance + dissipated + remainder hold at any step size, and the
    remainder vanishes with it.
    """
    left = {Quantity("energy", "", key): abs(step.energy.time_remainder) for key in ("external", "contact")}
    return {key: ErrorParts(time_step=left.get(key, 0.0 * np.abs(value))) for key, value in quantities(step).items()}
