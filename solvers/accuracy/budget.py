"""What is done to estimate the errors of a run: as much as its budget of seconds pays for.

Each estimate has a price in times the run that counts alone tell, by the cost model of `auto`: by the unknowns, steps
and iterations of what it solves, beside those of the run. So what is left out is said with a price that holds on every
machine. A budget in seconds pays for as many of them as these prices, times the seconds that the run has taken, allow:
seconds of the processor, which are not more where others use the machine, too. Rank 0 chooses for all.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from stickslip.geometry.arrays import TINY
from stickslip.geometry.errors import StickslipError
from stickslip.geometry.mesh.mesh import Mesh
from stickslip.solvers.accuracy.errors import MeshErrors, joined
from stickslip.solvers.accuracy.histories import FINER, OnIteration, OtherHistory, has_coarser
from stickslip.solvers.accuracy.kept_pairs import KeptPairs
from stickslip.solvers.accuracy.mesh_error import Values
from stickslip.solvers.accuracy.time_steps import TimeStepErrors
from stickslip.solvers.accuracy.two_level import STEPS
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.parallel.counters import Clock
from stickslip.solvers.results.step_result import ErrorParts, Errors, StepResult
from stickslip.solvers.scene.settings import Output
from stickslip.solvers.stepping.choice import Size, Stage
from stickslip.solvers.stepping.history import HistoryRow
from stickslip.solvers.stepping.stepper import Stepper
from stickslip.solvers.system.system import System

log = logging.getLogger(__name__)
# Solutions that bubbles add to a step, by the form of the bodies: they answer twice to each of Jacobi's steps, or once,
# and then these steps' stiffness of the next order takes as long as two more
BUBBLES = {"condensed": 2 * STEPS, "sparse": 2 * STEPS, "matrix-free": 3}
LEAST = 10.0  # s that estimates may take, however short the run
FIXED = 2.0  # s of a run that do not grow with it: libraries, compiled forms
USUAL = 10  # iterations of a step, as the cost model has them
MARGIN = 4  # by which the cost model may be off
COARSER, TIME, BETTER, PAIRS = "coarser mesh", "time steps", "better mesh", "pairs"  # in the order of their worth
TELLS = {COARSER: "mesh", TIME: "time_step", BETTER: "mesh", PAIRS: "geometry"}  # part of the error


def budget_of(output: Output, seconds: float) -> float | None:
    """Seconds that estimates may take beside a run that takes so many; None: as many as they need."""
    if output.error in ("full", "rough") or output.error_budget == "inf":
        return None
    return max(seconds, LEAST) if output.error_budget is None else float(output.error_budget)


def size_of(system: System, steps: Sequence[StepResult]) -> Size:
    """The size of a run that is solved, with as many steps as its iterations make; collective."""
    size = Size.of(system.problem, system.mesh, system.constraints, system.contacts)
    return replace(size, steps=max(len(steps), sum(step.iterations for step in steps) // USUAL))


def predicted(size: Size, stage: Stage | None = None) -> float:
    """Seconds that a run of a size takes by the cost model of `auto`, and 10 ms for each problem of contact.

    Args:
        stage: of the run; None: the cheaper one.
    """
    condensed, method = size.condensed_seconds, "surface-uzawa" if stage is None else stage.method
    free = size.matrix_free_seconds(method)
    whole = min(condensed, free) if stage is None else condensed if stage.surface == "condensed" else free
    return whole + size.steps / 100


def growing(clock: Clock, size: Size, stage: Stage) -> float:
    """Seconds of solving a run that grow with its unknowns and steps: small ones are measured by their counts.

    Args:
        clock: of the run.
        size: see `size_of`.
        stage: of the run.
    """
    worked, reads = clock.worked, ("output", "results")  # as other histories are read
    least = predicted(replace(size, steps=0), stage)
    of_steps = predicted(size, stage) - least
    solving = float(np.clip(worked("assemble") + worked("prepare") - FIXED, least, MARGIN * least))
    return solving + float(np.clip(worked("iterate") + worked(*reads), of_steps / MARGIN, MARGIN * of_steps))


def better_unknowns(mesh: Mesh) -> float | None:
    """Unknowns of better cells for each of a run: of order 2, or cut where contact changes, or in 3D all smaller.

    None: a file has no smaller ones; collective.
    """
    if mesh.degree == 1 or mesh.dim == 2:
        return 2.0 ** (mesh.dim + 1 - mesh.degree)
    return FINER**mesh.dim if has_coarser(mesh) else None


def meshed_again(mesh: Mesh) -> bool:
    """Whether better cells are not those of a mesh itself, as straight ones of order 2 are."""
    return bool(mesh.degree > 1 or mesh.bulging)


def bubbles_follow(output: Output, size: Size, stage: Stage, mesh: Mesh, meshing: float) -> bool:
    """Whether bubbles follow the steps of a run: they fit its budget; better cells cost more, and surely do not fit.

    Args:
        meshing: seconds of that.
    """
    whole, better = predicted(size, stage), better_unknowns(mesh)
    budget = budget_of(output, meshing + whole)
    if output.error == "rough" or budget is None:
        return output.error != "rough" and better is None
    cost = BUBBLES[stage.surface] * (whole - predicted(replace(size, steps=0), stage))
    if better is None:
        return cost <= budget
    dear = meshed_again(mesh) * meshing + predicted(size.times(better))
    return cost <= min(budget, dear) and MARGIN * dear > budget


@dataclass(frozen=True)
class Choice:
    """What is done of the estimates at the end of a run; whoever goes on with the run does the same."""

    asked: Sequence[bool | str | float | None]  # `output.error` and `error_budget` that it was chosen for
    factor: float = 2.0  # times the run's mesh sizes, of the coarser mesh
    prices: Mapping[str, float] = field(default_factory=dict)  # of each estimate, times the run
    done: Sequence[str] = ()  # those that are paid for
    room: float | None = None  # times the run, that a better mesh may cost if it is cut; None: whatever it takes


class Coarser(NamedTuple):
    """The run's steps on longer cells."""

    steps: Sequence[StepResult]
    contacts: Mapping[str, ContactRows]
    factor: float  # how many times as long


class Estimates:
    """Finds the errors of a run at its end, as far as they are paid for; what is there is known at any time."""

    def __init__(
        self,
        stepper: Stepper,
        steps: Sequence[StepResult],
        output: Output,
        on_iteration: OnIteration = lambda row: None,
        tell: Callable[[str], None] = lambda line: None,
    ) -> None:
        """
        Args:
            stepper: of the run.
            steps: its results at the requested times, from rest on, without a gap.
            output: as the scene asks for it.
            on_iteration: called after each iteration, on every rank; what it raises ends the estimates.
            tell: told how it goes on.
        """
        self._stepper, self._steps, self._output = stepper, steps, output
        self._on_iteration, self._tell, self._clock = on_iteration, tell, stepper.system.counters.clock
        self._pairs = KeptPairs(stepper, self._noticed)
        self._times = [step.time for step in steps]
        cycles = sorted({batch.cycles for step in steps for batch in step.batches})
        stepper.system.course.batches = np.diff([0.0, *cycles]).tolist()
        self._now, self._until, self._ended = "", 0.0, set[str]()  # what is being found; seconds of errors at its end
        self._history: OtherHistory | None = None  # on the coarser mesh
        self._coarse, self._of_time = list[StepResult](), list[Errors]()
        self._of_mesh: Sequence[Errors] = ()
        self._of_pairs: Sequence[Values | None] = ()
        self._seconds = 0.0, 0.0  # of the run: meshing, and all that grows with its unknowns and steps
        self._size = size_of(stepper.system, steps)
        self.choice = Choice([output.error, output.error_budget])

    def choose(self) -> Choice:
        """What is done; collective."""
        system, stage = self._stepper.system, self._stepper.chain.stage
        worked = self._clock.worked
        meshing = worked("mesh")
        budget = budget_of(self._output, meshing + sum(map(worked, ("assemble", "prepare", "iterate"))))
        spent = worked("error") - worked("error", "model")  # which judges the run
        left = None if budget is None else max(budget - spent, 0.0)
        left, self._seconds = system.mesh.comm.bcast((left, (meshing, growing(self._clock, self._size, stage))))
        for factor in (2.0, 4.0):
            prices, done, paid = self._prices(factor), list[str](), 0.0
            for name, cost in prices.items():
                needs = name != TIME or COARSER in done or COARSER not in prices
                cost = self._expected(name, cost, factor)
                if needs and (left is None or paid + cost <= left):
                    paid += cost
                    done.append(name)
            if TIME in done or TIME not in prices:
                break
        done = [COARSER] if self._output.error == "rough" else done
        room = None
        if left is not None and BETTER in done:
            spare = left - paid - (system.mesh.degree == 1) * self._seconds[0]  # cells that are cut are meshed again
            room = prices[BETTER] + spare / max(self._seconds[1], TINY) if spare >= 0 else 0.0
        return replace(self.choice, factor=factor, prices=prices, done=done, room=room)

    def _expected(self, name: str, cost: float, factor: float) -> float:
        """Seconds that an estimate takes: meshing by the number of cells, all else by its price."""
        mesh = self._stepper.system.mesh
        cells = {COARSER: factor**-mesh.dim, BETTER: float(meshed_again(mesh))}.get(name, 0.0)
        return cells * self._seconds[0] + cost * self._seconds[1]

    def _prices(self, factor: float) -> dict[str, float]:
        """Prices of all estimates of the run, see `Choice`."""
        mesh, n, found = self._stepper.system.mesh, len(self._steps), dict[str, float]()
        own, fresh = predicted(self._size, self._stepper.chain.stage), has_coarser(mesh)

        def price(unknowns: float, solved: int, prepares: bool = True) -> float:
            size = self._size.times(unknowns)
            whole = predicted(replace(size, steps=round(size.steps * solved / n)))
            return (whole - (0.0 if prepares else predicted(replace(size, steps=0)))) / own

        if fresh:
            found[COARSER] = price(factor**-mesh.dim, n)
        if solved := TimeStepErrors(self._stepper).solves(self._times, fresh):
            found[TIME] = price(factor**-mesh.dim if fresh else 1.0, solved, prepares=False)
        better = better_unknowns(mesh)
        if self._stepper.companion is None and better is not None:
            found[BETTER] = price(better, n)
        if self._pairs.leaving(self._steps):
            found[PAIRS] = price(1.0, n, prepares=False)
        return found

    def solve(self, choice: Choice) -> None:
        """Find what is chosen; collective.

        Raises:
            KeyboardInterrupt: `on_iteration` raises it; what is there is kept.
        """
        self.choice = choice
        acts = {COARSER: self._coarser, TIME: self._time, BETTER: self._better, PAIRS: self._by_pairs}
        for name, act in acts.items():
            if name in choice.done or name not in choice.prices:  # these cost nothing
                paid = name in choice.prices
                self._clock.expected = self._expected(name, choice.prices[name], choice.factor) if paid else 0.0
                self._now, self._until = name, self._clock.seconds("error") + self._clock.expected
                with self._clock.phase("error", name):
                    act()
                self._ended.add(name)

    def price(self) -> None:
        """Find what costs nothing, and what all else would cost; collective."""
        self.solve(replace(self.choice, prices=self._prices(self.choice.factor)))

    def only(self, name: str) -> tuple[Errors, ...]:
        """Errors that one of the estimates tells, whatever it costs; collective."""
        done = [COARSER, name] if name in self._prices(2.0) else [name]
        self.solve(replace(self.choice, prices=dict.fromkeys(TELLS, 0.0), done=done))
        return tuple(self._of_time if name == TIME else self._of_mesh)

    def _noticed(self, row: HistoryRow) -> None:
        left = self._until - self._clock.seconds("error")
        about = f", about {left:.0f} s left" if left >= 1 else ""
        self._tell(f"estimating the error, {self._now}: t = {row.time:g} of {self._times[-1]:g}{about}")
        self._on_iteration(row)

    def _coarser(self) -> None:
        try:
            self._history = OtherHistory.coarser(self._stepper.system, self.choice.factor, self._noticed)
            log.info("the same history on a coarser mesh, for the errors")
            self._coarse.extend(step.without_fields() for step in self._history.results(self._times))
        except StickslipError as error:
            log.info("coarser mesh: %s", error)

    def _time(self) -> None:
        self._of_time.extend(TimeStepErrors(self._stepper, self._noticed)(self._steps, self._history, self._coarse))

    def _better(self, solves: bool = True) -> None:
        found = MeshErrors(self._stepper, self._fits, self._noticed)
        self._of_mesh = found(self._steps, self._coarse, self.choice.factor, solves)

    def _fits(self, size: Size) -> bool:
        """Whether the better cells of a history of a size fit into what is left for them."""
        own, steps = predicted(self._size, self._stepper.chain.stage), self._size.steps
        return self.choice.room is None or predicted(replace(size, steps=steps)) <= self.choice.room * own

    def _by_pairs(self) -> None:
        self._of_pairs = self._pairs(self._steps)

    @property
    def coarser(self) -> Coarser | None:
        """The same steps on longer cells; None: not all of them are solved."""
        if self._history is None or len(self._coarse) < len(self._steps):
            return None
        rows = {c.name: c for c in self._history.stepper.system.contacts}
        return Coarser(tuple(self._coarse), rows, self.choice.factor)

    @property
    def errors(self) -> tuple[Errors, ...]:
        """Errors of every number of each step by their parts, as far as they are found; with what is lacking."""
        if BETTER not in self._ended:
            self._better(solves=False)
        prices = {TELLS[name]: cost for name, cost in self.choice.prices.items() if name not in self._ended}
        pairs = [None] * len(self._steps) if PAIRS in self.choice.prices and not self._of_pairs else self._of_pairs
        found = joined(self._steps, self._of_time, self._of_mesh, of_pairs=pairs)
        times: list[Errors] = [*self._of_time, *[{}] * (len(found) - len(self._of_time))]
        return tuple(
            {key: _with_prices(parts, prices, its.get(key, ErrorParts()).by) for key, parts in errors.items()}
            for errors, its in zip(found, times, strict=True)
        )


def _with_prices(parts: ErrorParts, prices: Mapping[str, float], of_time: str | None) -> ErrorParts:
    """An error with what the parts that it lacks would cost; a number without limit lacks none of the mesh.

    Args:
        of_time: what tells the part of the time steps, if that is to be said.
    """
    parts = replace(parts, by=", ".join(dict.fromkeys(filter(None, (parts.by, of_time)))) or None)
    unknown = ("time_step",) if parts.converges is False else ("mesh", "geometry", "time_step")
    dear = {part: prices[part] for part in unknown if part in prices and getattr(parts, part) is None}
    return replace(parts, dear={**dear, **(parts.dear or {})}) if dear else parts
