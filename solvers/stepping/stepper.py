"""Load steps: each starts from the slip of the one before; one that fails is tried again in smaller substeps."""

from __future__ import annotations

import logging
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from geometry.arrays import Array
from geometry.errors import SolverError
from solvers.contact.admissible_set import AdmissibleSet
from solvers.interface.flexibility import Load
from solvers.interface.limit_analysis import unbalanced_motion
from solvers.interface.prepare import prepare_surface, trial_stiffness
from solvers.interface.problem import SurfaceProblem
from solvers.newton.solution import OnStep, Solution, Status, Step
from solvers.stepping import failure
from solvers.stepping.attempts import Attempts
from solvers.stepping.failure import motion_in_words
from solvers.stepping.history import HistoryRow
from solvers.stepping.sliding import positions, stay, told_in
from solvers.stepping.state import HALVINGS, Before, Energy, State
from solvers.stepping.update import displacement, new_state, relative_displacement, split
from solvers.system.system import System

log = logging.getLogger(__name__)
SEARCHES = 6  # of a step whose points leave their facets
ROUNDING = 1e-12  # times that differ by less are the same
FAR = 100.0  # times the last step: farther ahead, what its iteration left would count as motion
EASY = 0.5  # of the iterations allowed: a step that takes more was not easy


@dataclass(frozen=True, kw_only=True)
class Accepted:
    """A requested time, reached."""

    stepper: Stepper  # whose rows the state is told in
    state: State
    before: State  # at the last requested time
    last: State  # before the last substep
    problem: SurfaceProblem  # of the last substep
    substeps: int
    iterations: int
    volume_solves: int
    residual: float
    slack: float  # of the friction bound, see `Solution`
    linear_error: float  # of the last substep, see `DelassusOperator`
    history: tuple[HistoryRow, ...]


class StepError(SolverError):
    """The smallest step failed; `reached` is the last good substep, if there is one."""

    def __init__(self, time: float, text: str, history: tuple[HistoryRow, ...], reached: Accepted | None) -> None:
        super().__init__(f"t = {time:g}: {text}")
        self.history, self.reached = history, reached


class NoEquilibriumError(StepError):
    """It failed, and at the time named there is no equilibrium: that is proved."""


class Stepper:
    """The bodies prepared once, and the march through the requested times."""

    def __init__(
        self, system: System, attempts: Attempts | None = None, searched: Mapping[str, Array] = MappingProxyType({})
    ) -> None:
        """Prepare the bodies, unless `attempts` brings them; collective.

        Args:
            searched: where the pairs of sliding contacts were found, (n_all, d) [m] by contact; see `positions`.
        """
        self.searched = searched
        self.system = system
        self.attempts = attempts or Attempts(system)
        self.cone = AdmissibleSet(system.contacts, 0.0, system.problem.timeline.end)
        self.gap = np.concatenate([np.zeros(0), *(c.gap for c in system.contacts)])
        self.gamma = trial_stiffness(system)
        self.reported: Accepted | None = None  # the last one that was
        self._meet_bodies()

    def _meet_bodies(self) -> None:
        """The surface as the method in turn sees it."""
        self.stage = self.attempts.stage
        self.surface = prepare_surface(self.system, self.attempts.volume)
        self.method_after = self.attempts.method(self.system, self.surface)

    def start(self) -> State:
        """Nothing has happened yet."""
        zero, vector = np.zeros(self.cone.size), self.system.vector
        energy = Energy(0.0, 0.0, 0.0, 0.0, np.zeros(len(self.system.contacts)))
        driven = np.zeros(len(self.system.obstacles.driven))
        motion = {c.name: np.zeros_like(c.points) for c in self.system.contacts}
        slip = {c.name: np.zeros_like(c.surface.points) for c in self.system.contacts}
        forces, rows = {name: np.zeros_like(m) for name, m in motion.items()}, self.system.contacts
        nothing = np.zeros(len(self.system.initial.strains))
        return State(
            time=0.0,
            u=vector(),
            u_s=vector(),
            load=vector(),
            initial=nothing,
            initial_work=nothing,
            residual=vector(),
            p=zero,
            w=zero,
            motion=motion,
            driven=driven,
            slip=slip,
            forces=forces,
            rows=rows,
            energy=energy,
        )

    def reach(self, start: State, target: float, on_iteration: Callable[[HistoryRow], None]) -> Accepted:
        """Solve up to `target`, by substeps where that fails; each retry starts from the last accepted state.

        Raises:
            StepError: the smallest step failed; it carries what was reached.
        """
        state, substeps, pace = start, 0, start.pace
        history: list[HistoryRow] = []
        unbalanced: tuple[float, str] | None = None  # the earliest time known to have no equilibrium
        solves = self.system.counters.volume_solves
        step = target - start.time
        smallest = step / 2**HALVINGS
        reached: Accepted | None = None
        while reached is None or state.time < target:
            left = target - state.time
            tried = pace.part(left, smallest)
            end = target if tried == left else state.time + tried
            stepper, solution, problem, new = self._follow(state, end, history, on_iteration)
            if solution.status is Status.NO_EQUILIBRIUM:
                unbalanced = end, f"{solution.status.value}: {motion_in_words(stepper.system, solution.u_c)}"
            if new is None:
                if tried <= smallest * (1 + 1e-9):
                    if unbalanced is not None:
                        raise NoEquilibriumError(*unbalanced, tuple(history), reached)
                    text = failure.in_words(problem, solution, self.system.problem.solver.tolerance, tried)
                    raise StepError(end, text, tuple(history), reached)
                pace = pace.failed(tried, smallest)
                log.warning("t = %g: %s; the step is cut to %.3g s", end, solution.status.value, pace.size)
                continue
            assert problem is not None
            pace = pace.succeeded(tried, step, solution.iterations <= EASY * self.system.problem.solver.max_iterations)
            before_substep, state, substeps = state, replace(new, pace=pace), substeps + 1
            if stepper is not self:
                unbalanced = None  # it was known for the pairs of another place
            reached = Accepted(
                stepper=stepper,
                state=state,
                before=start,
                last=before_substep,
                problem=problem,
                substeps=substeps,
                iterations=_iterations(history),
                volume_solves=self.system.counters.volume_solves - solves,
                residual=solution.residual,
                slack=solution.slack,
                linear_error=stepper.surface.linear_error,
                history=tuple(history),
            )
        return reached

    def _follow(
        self, state: State, end: float, history: list[HistoryRow], on_iteration: Callable[[HistoryRow], None]
    ) -> tuple[Stepper, Solution, SurfaceProblem | None, State | None]:
        """One attempt at a step; the pairs of sliding contacts are those of where it starts, or of where it ends."""
        names = [c.name for c in self.system.contacts if self.system.problem.pairs[c.name].contact.sliding]
        if not names:
            return self, *self._solve(state, end, history, on_iteration)
        if self.stage is not self.attempts.stage:
            self._meet_bodies()  # what other pairs share
        where = positions(self.system, state, names)
        for _ in range(SEARCHES):
            stepper = self._searched(where)
            told = told_in(state, stepper.system)
            solution, problem, new = stepper._solve(told, end, history, on_iteration)
            if new is None:
                break
            reached = positions(stepper.system, new, names)
            if stay(stepper.system, where, reached):
                break
            where = reached
        else:
            log.warning("t = %g: pairs still change after %d searches; the last ones stand", end, SEARCHES)
        return stepper, solution, problem, new

    def _searched(self, where: Mapping[str, Array]) -> Stepper:
        """The same bodies with other pairs."""
        other = Stepper(self.system.searched(where), self.attempts, where)
        if other.stage.surface == self.stage.surface:
            other.surface.adopt(self.surface)
        return other

    def _solve(
        self, state: State, end: float, history: list[HistoryRow], on_iteration: Callable[[HistoryRow], None]
    ) -> tuple[Solution, SurfaceProblem | None, State | None]:
        """One attempt at the step from `state` to `end`, and the new state if it succeeds."""
        began = clock.perf_counter()

        def record(step: Step) -> None:
            row = HistoryRow(end, step, clock.perf_counter() - began, self.stage.method)
            history.append(row)
            log.info("t = %g  iteration %d  residual %.2e", row.time, step.iteration, step.residual)
            on_iteration(row)

        while True:
            if self.stage is not self.attempts.stage:
                self._meet_bodies()
            attempt = self._attempt(state, end, record)
            solution, _, new = attempt
            if new is not None or solution.status is Status.NO_EQUILIBRIUM:
                return attempt
            if not self.attempts.advance(self.system, end, solution):
                return attempt

    def _attempt(
        self, state: State, end: float, record: OnStep
    ) -> tuple[Solution, SurfaceProblem | None, State | None]:
        """The step by the method in turn; where a linear solve fails, so does the attempt."""
        system = self.system
        load, u_s = system.load(end), system.prescribed(end)
        driving = system.obstacles.driving_force(end)
        force = load.norm(0) + float(np.abs(driving).sum())
        rows: list[Step] = []

        def tell(step: Step) -> None:
            rows.append(step)
            record(step)

        problem = None
        try:
            problem = self._problem(state, end, u_s, self.surface.load(system.pull(end, load, u_s), driving), force)
            start = self._start(state, end) if problem.p_ref > 0 else np.zeros_like(state.p)  # no load: no traction
            motion = unbalanced_motion(problem) if self.surface.floating else None
            if motion is not None:
                return Solution(start, state.w, motion, Status.NO_EQUILIBRIUM, np.inf, ()), problem, None
            solution = self.method_after(state)(problem, start, tell)
            if solution.status is not Status.CONVERGED:
                return solution, problem, None
            q = problem.surface.recover(problem.load, solution.p, solution.u_c)
            u, strained = displacement(system, end, q, u_s)
        except (SolverError, np.linalg.LinAlgError) as error:
            log.warning("t = %g: %s", end, error)
            residual = rows[-1].residual if rows else np.inf
            none = np.zeros(self.surface.size)
            return Solution(state.p, state.w, none, Status.BROKEN, residual, tuple(rows)), problem, None
        driven = solution.u_c[len(solution.u_c) - len(driving) :]
        new = new_state(system, state, problem, u, strained, u_s, load, solution.p, driven)
        if not np.isfinite([new.energy.external, new.energy.stored, new.energy.contact]).all():
            return replace(solution, status=Status.NOT_FINITE), problem, None
        before = Before(state.time, state.p) if end > state.time else None
        peak = max(state.peak, new.energy.stored)
        return (
            solution,
            problem,
            replace(new, before=before, law_error=state.law_error + solution.law_error, peak=peak),
        )

    def _start(self, state: State, end: float) -> Array:
        """Tractions to begin with: they go on as in the last step, unless the loads and motions take a turn.

        Measured, with exact bodies that saves a third to two thirds of Newton's iterations and an eighth to a quarter
        of Uzawa's; where volume solves are iterative it costs a fifth more.
        """
        before, turns = state.before, self.system.course.timeline.turns
        if before is None or not self.surface.exact:
            return state.p
        far = (end - state.time) / (state.time - before.time)
        if far > FAR or any(abs(turn - state.time) <= ROUNDING * state.time for turn in turns):
            return state.p
        return state.p + far * (state.p - before.p)

    def split(self, p: Array) -> tuple[list[Array], list[Array]]:
        """Flat tractions to normal (m_n,) and tangential (m_t, d-1) ones of each contact."""
        return split(self.cone, p)

    def _problem(self, state: State, time: float, u_s: Any, load: Load, force: float) -> SurfaceProblem:
        system, n = self.system, self.surface.normal_rows
        return SurfaceProblem(
            surface=self.surface,
            cone=self.cone.at(time),
            load=load,
            offset=relative_displacement(system, u_s, time, np.zeros(self.surface.driven)),
            gap=np.concatenate([self.gap, (state.w - self.cone.give(state.p))[n:]]),
            gamma=self.gamma,
            force=force,
            stiffness=system.problem.softest / system.extent,
        )


def _iterations(history: list[HistoryRow]) -> int:
    """Of all attempts together; the first row of each, and of each level of smoothing, tells where it starts."""
    told = [(row.time, row.method, row.step.iteration) for row in history]
    return sum(row[2] > 0 and row != before for before, row in zip([None, *told], told, strict=False))
