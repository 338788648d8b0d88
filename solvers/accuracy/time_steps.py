"""Error of the time steps: the same history in fewer steps, on the same mesh with the same factor.

Friction remembers its path, so every number depends on the steps, most of all the dissipation. Its error falls with the
first power of the step: each step of size h adds h² of it. So the difference of two histories, times the sum of h² of
the run over what the sum grows by, is the error of the run. Three histories are compared: the run (n steps between two
turns of the values in time), n/2 and n/4, and the larger of both estimates is stated, 1.25 times it where there are two
histories alone. Where a value turns after every step nothing can be left out: there the steps are halved. On the
condensed form of the bodies that costs little beside the factor; where each volume solve is iterative it is done only
if it takes no more steps than the run, otherwise the error is not known.

Smaller errors of the dissipation come from single nodes that slip a step earlier, and may be stated many times too
small. The largest values of two histories agree by chance where those around them do not; so at least the mean error of
the nodes near the peak is stated of them.

Where a body begins to slip within one step, friction bounds change while it does, and shorter histories, which begin to
slip in one step as well, end with the same dissipation. So at least `PATH` of the work by which changes of the bounds
within the steps can change it is stated, all of it where a point touches and slips in one step: without, 16 % of all
errors of dissipations are stated below half of what they are, with it 3 %. And as the dissipation of a step is that of
its last tractions, what these change by in the step, times its slips, bounds its error (at most 2.6 times that in 48
steps of four scenes): what stretches of three steps that are made one attribute to each of them is not more than
`TURNED` times that, or a tenth where earlier steps decide.
Where pairs slide, `SLIDING` times the differences: .88 instead of .73 within [.7, 3] (`sliding`).

What touches in the first step of a history has slid freely before, and slips or sticks from the beginning of the step
on, however short the step is: shorter histories agree, and all of them are wrong, until steps are shorter than what
lies before the touch. So where a contact with friction closes in the first step of a stretch, the shortest history is
solved with steps of 2^-CUTS, ..., a quarter, a half of that step before it, and SAFETY times the difference is added.

At times that a shorter history leaves out, what adds up over steps takes the difference interpolated between those that
it has (share .98; the next one's .81), all else that of the next time (areas .75; interpolated .54): the last
increment decides it. An odd number of steps is halved by making one of the first three: without the last step alone the
areas at the end would agree.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from stickslip.geometry.arrays import CLOSE, EXACT, ROUNDING, Array, Bools, Ints
from stickslip.solvers.results.observe import Observer
from stickslip.solvers.results.step_result import OPEN, SLIP, ErrorParts, Errors, Quantity, StepResult, quantities
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.record import Value
from stickslip.solvers.scene.timeline import Timeline
from stickslip.solvers.stepping.history import HistoryRow
from stickslip.solvers.stepping.stepper import StepError, Stepper

log = logging.getLogger(__name__)
PEAKS = {"max_pressure": "pressure", "max_slip": "slip"}  # largest values, and what of the nodes they are
SLIDING = 1.5  # times all differences where pairs slide: each search for new pairs makes numbers jump
PATH = 0.1  # of half the changes of friction bounds, times the slips: fitted to `stickslip verify accuracy`
TURNED = 3.0  # times the work of the tractions' changes in a step: the most that is stated of its dissipation
SAFETY = 1.25  # where two histories are compared alone; stated / true without it: .41 to 1.8, median 1.0
CUTS = 8  # of a step in which a contact closes
Stretches = tuple[tuple[float, ...], ...]  # the times of a history [s]; each stretch ends where some value turns


def stretches(times: Sequence[float], timeline: Timeline) -> Stretches:
    """Times of a history [s] from one turn of a value to the next; no time that ends a stretch is ever left out.

    >>> from stickslip.solvers.scene.timeline import Place
    >>> line = Timeline({Place("supports", "top", "displacement", "x"): ((1.0, 0.0), (2.0, 1.0))}, end=2.0, count=4)
    >>> stretches(line.times, line)
    ((0.5, 1.0), (1.5, 2.0))
    """
    turns, found, open_stretch = np.array([*timeline.turns, 0.0]), list[tuple[float, ...]](), list[float]()
    for time in times:
        open_stretch.append(time)
        if np.abs(turns - time).min() <= EXACT * timeline.end or time == times[-1]:
            found.append(tuple(open_stretch))
            open_stretch = []
    return tuple(found)


def halved(stretch: tuple[float, ...]) -> tuple[float, ...]:
    """Every second time of a stretch, the last one among them; of an odd number the first three steps become one.

    >>> halved((1.0, 2.0, 3.0, 4.0)), halved((1.0, 2.0, 3.0, 4.0, 5.0)), halved((1.0,))
    ((2.0, 4.0), (3.0, 5.0), (1.0,))
    """
    kept = stretch[::-1][::2][::-1]
    return kept[1:] if len(stretch) % 2 and len(stretch) > 1 else kept


def doubled(history: Stretches, single: Sequence[bool]) -> Stretches:
    """The history with its steps halved in stretches that are `single`; a step at t = 0 stays one.

    >>> doubled(((1.0,), (1.5, 2.0)), [True, False])
    ((0.5, 1.0), (1.5, 2.0))
    """
    starts = [0.0, *(stretch[-1] for stretch in history)]
    return tuple(
        (*((start + stretch[0]) / 2 for _ in range(alone and stretch[0] > start)), *stretch)
        for start, stretch, alone in zip(starts, history, single, strict=False)
    )


def cut_down(history: Stretches, run: Stretches, closes: Sequence[bool]) -> Stretches:
    """A history with, in stretches in which a contact `closes`, the first step of the run halved CUTS times before it.

    >>> cut_down(((512.0,), (768.0,)), ((256.0, 512.0), (640.0, 768.0)), [True, False])
    ((1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0), (768.0,))
    """
    starts = [0.0, *(stretch[-1] for stretch in history)]
    cuts = (
        [start + (own[0] - start) / 2**k for k in range(CUTS, -1, -1)] if cut else []
        for start, own, cut in zip(starts, run, closes, strict=False)
    )
    return tuple(
        (*(time for time in early if time < stretch[0]), *stretch) for early, stretch in zip(cuts, history, strict=True)
    )


class Solved(NamedTuple):
    """A history as far as it was solved in whole steps."""

    plan: Stretches
    times: Array  # (n,) those that are also times of the run [s]
    rows: Array  # (n, k) all numbers at these times, flat, see `_Columns`


class Difference(NamedTuple):
    """Of two histories, at the c times that both were solved at."""

    times: Array  # (c,) [s]
    rows: Array  # (c, k) the finer one minus the coarser one
    factor: Array  # (c,) error of the run over that, by the sums of h² up to there; 0 before the first that differs


class Compared(NamedTuple):
    """Numbers of the histories of a run; None: there is no such history, the run has too few steps."""

    half: Difference | None = None  # the run, and half of its steps
    quarter: Difference | None = None  # half, and a quarter
    single: Difference | None = None  # the steps that are alone between two turns halved, and whole
    touch: Difference | None = None  # the steps in which a contact closes cut down, and whole


@dataclass(frozen=True)
class _Columns:
    """All numbers of a step as one row (k,), see `_numbers`."""

    keys: tuple[Quantity, ...]
    sizes: tuple[int, ...]  # of each; 0: a number, not a vector

    @classmethod
    def of(cls, values: Mapping[Quantity, Value]) -> _Columns:
        """Those of a step's numbers."""
        return cls(tuple(values), tuple(np.size(value) * (np.ndim(value) > 0) for value in values.values()))

    @staticmethod
    def row(values: Mapping[Quantity, Value]) -> Array:
        """A step's numbers (k,)."""
        return np.concatenate([np.atleast_1d(value) for value in values.values()])

    def which(self, test: Callable[[Quantity], bool]) -> Ints:
        """Columns of the quantities that pass a test."""
        return np.flatnonzero(np.repeat([test(key) for key in self.keys], np.maximum(self.sizes, 1)))

    def energy(self, name: str) -> int:
        """The column of an energy."""
        return int(self.which(lambda key: key == Quantity("energy", "", name))[0])

    def errors(self, row: Array) -> Errors:
        """A row of errors by reported quantity; one with a NaN is not computed."""
        found, at = dict[Quantity, ErrorParts](), 0
        for key, size in zip(self.keys, self.sizes, strict=True):
            part = row[at : at + max(size, 1)]
            at += len(part)
            if key.quantity in PEAKS.values():
                continue
            value = None if np.isnan(part).any() else part if size else float(part[0])
            found[key] = ErrorParts(time_step=value)
        return found


class TimeStepErrors:
    """Estimates the error of the time steps of a run that is solved; collective.

    The shorter histories are solved when they are asked for, from rest, with the prepared bodies: their steps change
    nothing that a later step of the run would see, but for what methods learn of the bodies. A history ends where a
    step needs to be cut: what lies behind is not comparable, and its errors are None. So are those from the first step
    of the run on that was cut.
    """

    def __init__(
        self, stepper: Stepper, observer: Observer, on_iteration: Callable[[HistoryRow], None] = lambda row: None
    ) -> None:
        """
        Args:
            stepper: of the run.
            observer: of the run.
            on_iteration: called after each iteration, on every rank.
        """
        self._stepper, self._on_iteration = stepper, on_iteration
        self._observe = observer.without_errors()
        self._problem = stepper.system.problem

    def __call__(self, steps: Sequence[StepResult]) -> tuple[Errors, ...]:
        """The errors of each step of a run from rest, in `ErrorParts.time_step`; collective.

        Args:
            steps: results at the requested times, without a gap.
        """
        if not steps:
            return ()
        values = [_numbers(step) for step in steps]
        columns, times = _Columns.of(values[0]), np.array([step.time for step in steps])
        plan = stretches(times.tolist(), self._problem.timeline)
        run = Solved(plan, times, np.array([columns.row(each) for each in values]))
        with self._stepper.chain.repeating(self._stepper.system):
            path_matters = remembers(self._problem)
            compared = self._compare(run, self._closes(plan, steps)) if path_matters else Compared()
            jump = self._jump(steps)
        slides = any(pair.contact.sliding for pair in self._problem.pairs.values())
        found = estimates(run, compared, columns, jump, slides)
        if path_matters:
            for key, (most, least) in _along_the_path(steps, self._apart()).items():
                place = columns.which(key.__eq__)
                if key.quantity == "dissipation":
                    found[:, place] = np.minimum(found[:, place], np.maximum(most[:, None], found[:, place] / 10))
                found[:, place] = np.maximum(found[:, place], least[:, None])
        if compared.touch is not None:
            touch = np.abs(_signed(compared.touch, times, columns))
            touch[:, columns.which(lambda key: key.quantity in ("contact", "external"))] = 0.0  # these have it
            found += touch
        cut = next((k for k, step in enumerate(steps) if step.substeps > 1), len(steps))
        found[cut:] = np.nan
        return tuple(columns.errors(row) for row in found)

    def _closes(self, plan: Stretches, steps: Sequence[StepResult]) -> list[bool]:
        """Whether a contact with friction closes in the first step of each stretch."""
        system, found, first, gaps = self._stepper.system, list[bool](), 0, self._apart()
        apart = {c.name: bool(gaps[c.name].all()) for c in system.contacts if c.friction is not None}
        for stretch in plan:
            closed = {name: (steps[first].contacts[name].status != OPEN).any() for name in apart}
            found.append(any(apart[name] and closed[name] for name in apart))
            first += len(stretch)
            apart = {name: bool((steps[first - 1].contacts[name].status == OPEN).all()) for name in apart}
        return found

    def _apart(self) -> dict[str, Bools]:
        """By contact, which nodes (n,) do not touch at the start."""
        gap = ROUNDING * self._stepper.system.extent  # relative to the bodies; a smaller initial gap is rounding
        return {c.name: c.node_gap > gap for c in self._stepper.system.contacts}

    def _compare(self, run: Solved, closes: Sequence[bool]) -> Compared:
        """Solve the shorter histories, and the one with single steps halved, the others as in the shortest.

        Args:
            closes: see `cut_down`.
        """
        found, coarsest = dict[str, Difference](), run
        for name in ("half", "quarter"):
            plan = tuple(halved(stretch) for stretch in coarsest.plan)
            if plan != coarsest.plan:
                shorter = self._solve(plan, run)
                found[name] = difference(run, coarsest, shorter)
                coarsest = shorter
        plan = doubled(coarsest.plan, [len(stretch) == 1 for stretch in run.plan])
        if plan != coarsest.plan:
            found["single"] = difference(run, self._solve_if_worth(plan, run), coarsest)
        plan = cut_down(coarsest.plan, run.plan, closes)
        if plan != coarsest.plan:
            off = difference(run, self._solve_if_worth(plan, run, 2), coarsest)
            found["touch"] = off._replace(factor=np.full(len(off.times), SAFETY))
        return Compared(**found)

    def _solve_if_worth(self, plan: Stretches, run: Solved, most: int = 1) -> Solved:
        """`_solve`, if it takes little beside the run, or `most` times its steps; else nothing."""
        worth = self._stepper.chain.stage.surface == "condensed" or _count(plan) <= most * _count(run.plan)
        return self._solve(plan, run) if worth else Solved(plan, run.times[:0], run.rows[:0])

    def _solve(self, plan: Stretches, run: Solved) -> Solved:
        """Solve a history from rest; keep the numbers at times of the run."""
        log.info("the same history in %d steps, for the error of the time steps", _count(plan))
        state, times, rows = self._stepper.start(), list[float](), list[Array]()
        for time in (time for stretch in plan for time in stretch):
            try:
                accepted = self._stepper.reach(state, time, self._on_iteration)
            except StepError as error:
                log.info("no error of the time steps from there on: %s", error)
                break
            state = accepted.state
            if time in run.times:
                times.append(time)
                rows.append(_Columns.row(_numbers(self._observe(accepted))))
        return Solved(plan, np.array(times), np.reshape(rows, (len(rows), run.rows.shape[1])))

    def _jump(self, steps: Sequence[StepResult]) -> float:
        """Time remainder [J] of an infinitely short first step: it closes interferences; NaN: not solved."""
        if steps[0].time == 0:
            return steps[0].energy.time_remainder
        overlap = ROUNDING * self._stepper.system.extent
        if not any((c.node_gap < -overlap).any() for c in self._stepper.system.contacts):
            return 0.0
        try:
            # of the first step: loads and motions of an infinitely short one do not count beside an interference
            first = self._stepper.reach(self._stepper.start(), CLOSE * steps[0].time, self._on_iteration)
        except StepError:
            return float("nan")
        return first.state.energy.time_remainder


def _along_the_path(steps: Sequence[StepResult], gaps: Mapping[str, Bools]) -> dict[Quantity, Array]:
    """By dissipation, two rows (2, n) [J] of what changes within steps do to it: the most, of tractions; the least, of
    friction bounds.

    Args:
        gaps: by contact, which nodes (n,) do not touch at the start.
    """
    found, dissipated = dict[Quantity, Array](), Quantity("energy", "", "dissipated")
    for name in steps[0].contacts:
        states = [step.contacts[name] for step in steps]
        bounds = np.array([np.where(np.isfinite(state.bound), state.bound, 0.0) for state in states])
        changes = np.abs(np.diff(bounds, axis=0, prepend=0.0))
        slips = np.array([state.weight[:, None] * state.slip_increment for state in states])
        turned = np.abs((np.diff([state.traction for state in states], axis=0, prepend=0.0) * slips).sum(axis=2))
        lengths = np.linalg.norm(slips, axis=2)
        apart = np.array([gaps[name], *(state.status == OPEN for state in states[:-1])])
        touches = apart & np.array([state.status == SLIP for state in states])  # from no traction on
        part = np.where(touches, 1.0, PATH)
        work = np.array([TURNED * turned.sum(axis=1), (part * changes * lengths).sum(axis=1) / 2])
        found[Quantity("contacts", name, "dissipation")] = work
        found[Quantity("contacts", name, "dissipation_total")] = np.cumsum(work, axis=1)
        found[dissipated] = found.get(dissipated, 0.0) + np.cumsum(work, axis=1)
    for name, key in product(steps[0].sums, ("dissipation", "dissipation_total")):
        each = [found[Quantity("contacts", pair, key)] for pair in steps[0].parts(name)]
        found[Quantity("contacts", name, key)] = np.sum(each, axis=0)
    return found


def _numbers(step: StepResult) -> dict[Quantity, Value]:
    """Every number of a step, and those at nodes whose largest values are among them."""
    found = quantities(step)
    for name, contact in step.contacts.items():
        found[Quantity("contacts", name, "pressure")] = contact.pressure
        found[Quantity("contacts", name, "slip")] = np.linalg.norm(contact.slip, axis=1)
    for name, key in product(step.sums, ("pressure", "slip")):
        found[Quantity("contacts", name, key)] = np.concatenate(
            [found[Quantity("contacts", pair, key)] for pair in step.parts(name)]
        )
    return found


def remembers(problem: Problem) -> bool:
    """Whether a state depends on the path to it: there is friction, or pairs are searched again."""
    contacts = [pair.contact for pair in problem.pairs.values()]
    return any(c.sliding or (c.friction is not None and c.friction.resists()) for c in contacts)


def _count(plan: Stretches) -> int:
    """Number of steps."""
    return sum(map(len, plan))


def difference(run: Solved, finer: Solved, coarser: Solved) -> Difference:
    """Compare two histories, each step of the coarser one being one or several of the finer one.

    Args:
        run: whose error is asked for.
    """
    times = coarser.times[np.isin(coarser.times, finer.times)]
    differ = [a != b for a, b in zip(finer.plan, coarser.plan, strict=True)]
    own, fine, coarse = (_squares(each.plan, differ, times) for each in (run, finer, coarser))
    factor = np.divide(own, coarse - fine, out=np.zeros(len(times)), where=own > 0)
    rows = finer.rows[np.isin(finer.times, times)] - coarser.rows[: len(times)]
    return Difference(times, rows, factor)


def _squares(plan: Stretches, counted: Sequence[bool], times: Array) -> Array:
    """Sum of h² (c,) [s²] over the steps up to each of the times, in stretches that are counted."""
    ends = np.array([time for stretch in plan for time in stretch])
    counts = np.repeat(counted, [len(stretch) for stretch in plan])
    sums = np.cumsum(counts * np.diff(ends, prepend=0.0) ** 2)
    return np.asarray(sums[np.searchsorted(ends, times)])


def estimates(run: Solved, compared: Compared, columns: _Columns, jump: float, slides: bool = False) -> Array:
    """Errors (n, k) of the numbers of the run at its times, >= 0; NaN: not known.

    Args:
        compared: the other histories; none where the path does not matter: then only works have an error.
        jump: time remainder [J] of an infinitely short first step.
        slides: whether pairs are searched again.
    """
    n, k = run.rows.shape
    half, quarter, single, touch = (
        np.zeros((n, k)) if each is None else _signed(each, run.times, columns) for each in compared
    )
    third = np.zeros((n, 1), bool) if compared.quarter is None else (_factor(compared.quarter, run.times) > 0)[:, None]
    found: Array = np.where(third, np.fmax(np.abs(half), np.abs(quarter)), SAFETY * np.abs(half)) + SAFETY * np.abs(
        single
    )
    for key in columns.keys:
        if key.quantity in PEAKS:
            peak, nodes = (columns.which(each.__eq__) for each in (key, key._replace(quantity=PEAKS[key.quantity])))
            near = of_peak(run.rows[:, nodes])
            mean = (np.where(near, found[:, nodes], 0.0).sum(axis=1) / near.sum(axis=1))[:, None]
            found[:, peak] = np.maximum(found[:, peak], mean)
    found *= SLIDING if slides else 1.0
    for name, error in _works(run, half + single + touch, columns, jump).items():
        found[:, columns.energy(name)] = np.abs(error)
    return found


def of_peak(values: Array) -> Array:
    """Which (n, m) of the values (n, m) of nodes belong to the peak of their row, to half of it; they may be negative.

    >>> of_peak(np.array([[4.0, 2.0, 1.0], [-2.0, -3.0, -4.0]])).tolist()
    [[True, True, False], [True, True, False]]
    """
    top = values.max(axis=1, keepdims=True)
    return np.asarray(values >= top - 0.5 * np.abs(top))


def _factor(one: Difference, times: Array) -> Array:
    """Factor of a difference (n,) at times of the run; NaN behind its last time."""
    return np.asarray(np.append(one.factor, np.nan)[np.searchsorted(one.times, times)])


def _signed(one: Difference, times: Array, columns: _Columns) -> Array:
    """Error of the run (n, k) at its times by one comparison, positive where a number is too large; NaN behind it."""
    after = np.searchsorted(one.times, times)
    rows = np.vstack([np.zeros((1, one.rows.shape[1])), one.rows, np.full((1, one.rows.shape[1]), np.nan)])
    ends = np.concatenate([[0.0], one.times, [np.inf]])
    found, adding = rows[after + 1], columns.which(_adds_up)
    length = ends[after + 1] - ends[after]
    share = np.divide(times - ends[after], length, out=np.ones_like(times), where=length > 0)[:, None]
    found[:, adding] = rows[after][:, adding] * (1 - share) + found[:, adding] * share
    in_step = columns.which(lambda key: key.quantity == "dissipation")
    since_rest = columns.which(lambda key: key.quantity == "dissipation_total")
    found[:, in_step] = np.diff(found[:, since_rest], axis=0, prepend=0.0)
    return np.asarray(-found * _factor(one, times)[:, None])


def _adds_up(key: Quantity) -> bool:
    """Whether a number is a sum over all steps; the stored energy is not, it is that of the state."""
    return key.quantity in ("dissipated", "dissipation_total")


def _works(run: Solved, errors: Array, columns: _Columns, jump: float) -> dict[str, Array]:
    """Errors (n,) of the works: with infinitely short steps, they are what is stored and dissipated.

    external = stored + contact and contact = compliance + dissipated + remainder hold at any step size, and the
    remainder vanishes with it, but for that of a jump at t = 0. So the works' error is the remainder, and the errors
    of the other terms.

    Args:
        errors: signed, of all numbers (n, k).
        jump: time remainder [J] of an infinitely short first step.
    """
    terms = [key.quantity for key in columns.keys if key.kind == "energy"]
    values = {name: run.rows[:, columns.energy(name)] for name in terms}
    off = {name: errors[:, columns.energy(name)] for name in terms}
    remainder = values["contact"] - values["compliance"] - values["dissipated"]
    contact = remainder - jump + off["compliance"] + off["dissipated"]
    return {"contact": contact, "external": contact + off["stored"]}
