"""Load steps: each starts from the slip of the one before; one that fails is tried again in smaller substeps."""

from __future__ import annotations

import logging
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import count
from typing import Protocol

import numpy as np

from stickslip.geometry.arrays import ROUNDING, Array
from stickslip.geometry.errors import GeometryError, SceneError, SolverError
from stickslip.geometry.mesh.nodes import Nodes
from stickslip.geometry.protocols import Vec
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.limit_analysis import unbalanced_motion
from stickslip.solvers.interface.prepare import elastic_stiffness, prepare_surface
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.methods.condensed_newton import CondensedNewton
from stickslip.solvers.newton.correction import SOLVES, by_flexibility, by_schur_complement, exact_problem
from stickslip.solvers.newton.solution import Convergence, Correction, OnStep, Solution, Status, Step
from stickslip.solvers.parallel.released import destroy_released
from stickslip.solvers.parallel.replicated import sum_of_sizes
from stickslip.solvers.stepping import failure
from stickslip.solvers.stepping.choice import Stage
from stickslip.solvers.stepping.failure import describe_motion
from stickslip.solvers.stepping.given_tension import StepsWithBolts
from stickslip.solvers.stepping.history import HistoryRow, count_iterations
from stickslip.solvers.stepping.method_chain import MethodChain
from stickslip.solvers.stepping.sliding import carried_over, pairs_hold, relative_positions
from stickslip.solvers.stepping.slip_dependence import exact_by_turns, other_ends, solve_by_turns, with_slip
from stickslip.solvers.stepping.state import HALVINGS, Previous, State
from stickslip.solvers.stepping.tightening import Tightening
from stickslip.solvers.stepping.update import at_rest, displacement, new_state, relative_displacement, split
from stickslip.solvers.system.system import System

log = logging.getLogger(__name__)
SEARCHES = 6  # of the pairs, in one substep
PAIRS = 0.5  # of an error, what pairs that are searched elsewhere add to the next step; measured: .02 to .15
EASY = 0.5  # of the iterations allowed; a substep that takes more is not easy
OnIteration = Callable[[HistoryRow], None]  # called after each iteration of each attempt, on every rank


class Companion(Protocol):
    """Follows a history with other displacements, step by step."""

    nodes: Nodes  # of the displacements that `State.surplus` holds

    def vector(self) -> Vec:
        """No displacement of these nodes."""

    def __call__(self, stepper: Stepper, old: State, new: State, problem: SurfaceProblem) -> State | None:
        """What `State.refined` becomes after a substep from `old` to `new`; None: it was not found; collective.

        Args:
            stepper: with the contact rows of the substep.
            problem: that was solved.
        """


@dataclass(frozen=True, kw_only=True)
class Accepted:
    """A step that was solved, up to a requested time or, if it failed later, up to its last good substep."""

    stepper: Stepper  # with the contact rows that the state refers to
    state: State  # at the end
    start: State  # that the step started from
    substep_start: State  # that the last substep started from
    problem: SurfaceProblem  # of the last substep
    substeps: int
    iterations: int  # of all substeps and attempts
    volume_solves: int  # applications of K_B^-1 in this step
    residual: float  # relative natural residual of the last substep [-]
    slack: float  # relative distance to the friction bound at which a point still counts as slipping, see `Solution`
    weakening: float  # of all substeps, see `Solution`
    linear_error: float  # of the last substep [-], see `DelassusOperator`
    convergence: Convergence | None  # of the last substep, see `Solution`
    others: tuple[Array, ...]  # tractions (rows,) [Pa] of other solutions of a substep, the last one that has any
    history: tuple[HistoryRow, ...]  # every iteration of every attempt

    def after(self, before: Accepted | None) -> Accepted:
        """The same, with the work of a try before it."""
        if before is None:
            return self
        return replace(
            self,
            iterations=before.iterations + self.iterations,
            volume_solves=before.volume_solves + self.volume_solves,
            history=before.history + self.history,
        )


class StepError(SolverError):
    """A step could not be solved: its smallest substep failed.

    Attributes:
        history: every iteration of the step, those of good substeps first (tuple of `HistoryRow`).
        last_good: the step up to its last good substep (`Accepted`); None if no substep succeeded, or if bolts and
            springs do not have their forces there.
    """

    def __init__(self, time: float, text: str, history: tuple[HistoryRow, ...], last_good: Accepted | None) -> None:
        """
        Args:
            time: end of the substep that failed [s].
            text: why it failed, and what to try.
            history: every iteration of the step.
            last_good: the step up to its last good substep.
        """
        super().__init__(f"t = {time:g}: {text}")
        self.history, self.last_good = history, last_good


class NoEquilibriumError(StepError):
    """A step could not be solved, and it is proved that there is no equilibrium at the time in its text."""


class Stepper:
    """Solves load steps with bodies that are prepared once.

    A step is solved in one substep if that succeeds, otherwise in several; a substep is attempted with one method
    after the other, see `MethodChain`.
    """

    def __init__(
        self, system: System, chain: MethodChain | None = None, searched: Mapping[str, Array] | None = None
    ) -> None:
        """Prepare the bodies, unless `chain` has them, and the method, unless pairs were `searched`; collective.

        Args:
            system: the bodies, and the contact rows of their present pairs.
            chain: shared by the steppers of the same bodies with other pairs; None: made here.
            searched: by sliding contact, `relative_positions` (n_all, d) [m] that its pairs were searched at.
        """
        self.searched = dict(searched or {})
        self.system = system
        self.chain = chain or MethodChain(system)
        self.cone = AdmissibleSet(system.contacts, 0.0, system.problem.timeline.end)
        self.gap = np.concatenate([np.zeros(0), *(c.gap for c in system.contacts)])
        self.gamma, self.weight = elastic_stiffness(system)
        self.companion: Companion | None = None  # follows each substep, see `State.refined`
        self._with_bolts = StepsWithBolts(system)
        self._tightening: Tightening | None = None  # of the bolts, in the present step
        self.volume, self.surface = self.chain.volume, prepare_surface(system, self.chain.volume)
        self.stage: Stage | None = None  # that `method_after` is of; None: of none yet
        if not self.searched:
            self._follow()

    def _follow_bodies(self) -> None:
        """Take over the bodies of `chain`; the surface stays if their form does; collective."""
        if self.volume is not self.chain.volume:
            self.volume, self.surface = self.chain.volume, prepare_surface(self.system, self.chain.volume)

    def _follow(self) -> None:
        """Take over the current stage of `chain`; a SolverError says that it cannot be prepared; collective."""
        self._follow_bodies()
        self.method_after = self.chain.method(self.system, self.surface)
        self.stage = self.chain.stage

    def start(self) -> State:
        """The initial state: at rest at t = 0, without load, displacement or traction; collective."""
        return at_rest(self.system, self.cone)

    def reach(self, start: State, target: float, on_iteration: OnIteration) -> Accepted:
        """Solve one step, with bolts and springs as long as their forces ask; as `_reach`; collective."""
        tightening = self._tightening = Tightening.of(self.system, start, target)
        accepted: Accepted | None = None
        for tries in count(1):
            try:
                accepted = self._reach(start, target, on_iteration).after(accepted)
            except StepError as error:
                good = error.last_good
                if good is not None and tightening is not None and not tightening.holds(good.state):
                    good = None  # lengths that were only tried
                error.last_good = good and good.after(accepted)
                error.history = (accepted.history if accepted else ()) + error.history
                raise
            if tightening is None or tightening.done(accepted.state):
                break
            if tries >= tightening.most or tightening.lost:
                raise StepError(target, f"{tightening.names}: {tightening.unfound}", accepted.history, None)
        destroy_released(self.system.mesh.comm)
        assert accepted is not None
        return accepted

    def _reach(self, start: State, target: float, on_iteration: OnIteration) -> Accepted:
        """Solve one step, in substeps where that is needed; each attempt starts from the last good state; collective.

        Args:
            start: state that the step starts from.
            target: time at its end [s].
            on_iteration: called with each iteration.

        Raises:
            StepError: a substep of 1/2^HALVINGS of the step failed too; at once where the chain only repeats.
            NoEquilibriumError: so, and it is proved that nothing balances the loads.
        """
        state, substeps, control = start, 0, start.control
        history: list[HistoryRow] = []
        unbalanced: tuple[float, str] | None = None  # earliest time that is proved to have no equilibrium
        solves = self.system.counters.volume_solves
        step = target - start.time
        smallest = step if self.chain.repeats else step / 2**HALVINGS
        accepted: Accepted | None = None
        others: tuple[Array, ...] = ()
        weakening = 0.0
        failed: SurfaceProblem | None = None  # from the present state
        stuck = False  # whether a shorter step would be the same problem again
        while accepted is None or state.time < target:
            remaining = target - state.time
            size = control.next_size(remaining, smallest)
            end = target if size == remaining else state.time + size
            stepper, solution, problem, new = self._solve_with_pairs(
                state, end, history, on_iteration, can_be_cut=not stuck and size > smallest * (1 + ROUNDING)
            )
            if solution.status is Status.NO_EQUILIBRIUM:
                dofs = stepper.chain.volume.contact.rows
                unbalanced = end, f"{solution.status.value}: {describe_motion(stepper.system, solution.u_c, dofs)}"
            if new is None:
                # from rest, under loads in proportion to time, a shorter step is the same problem again
                at_rest = not (state.p.any() or state.w.any() or state.slid)  # slip that changes the law is not scaled
                known = stuck or self.chain.exhausted or solution.status is Status.NO_EQUILIBRIUM
                scaled = at_rest and failed is not None and problem is not None and problem.is_scaled(failed)
                failed = problem
                if scaled and not known:
                    stuck = True  # once more, now by all methods
                    continue
                if size <= smallest * (1 + ROUNDING) or scaled:
                    found = f"the last equilibrium that was found is at t = {state.time:g}"
                    if unbalanced is not None:
                        when, why = unbalanced
                        raise NoEquilibriumError(when, f"{why}; {found}", tuple(history), accepted)
                    text = failure.explain(problem, solution, self.system.problem.solver.tolerance, size)
                    text += f"; {found}" if stepper.surface.floating else ""
                    raise StepError(end, text, tuple(history), accepted)
                control = control.after_failure(size, smallest)
                log.warning("t = %g: %s; the step is cut to %.3g s", end, solution.status.value, control.size)
                continue
            assert problem is not None
            failed, stuck, others = None, False, solution.others or others
            weakening = max(weakening, solution.weakening)
            if self.companion is not None and not self.chain.repeats:
                new = replace(new, refined=self.companion(stepper, state, new, problem))
            easy = solution.iterations <= EASY * self.system.problem.solver.max_iterations
            control = control.after_success(size, step, easy)
            substep_start, state, substeps = state, replace(new, control=control), substeps + 1
            if stepper is not self:
                unbalanced = None  # it was proved for other pairs
            accepted = Accepted(
                stepper=stepper,
                state=state,
                start=start,
                substep_start=substep_start,
                problem=problem,
                substeps=substeps,
                iterations=count_iterations(history),
                volume_solves=self.system.counters.volume_solves - solves,
                residual=solution.residual,
                slack=solution.slack,
                weakening=weakening,
                linear_error=stepper.surface.linear_error,
                convergence=solution.convergence,
                others=others,
                history=tuple(history),
            )
        return accepted

    def _solve_with_pairs(
        self, state: State, end: float, history: list[HistoryRow], on_iteration: OnIteration, can_be_cut: bool
    ) -> tuple[Stepper, Solution, SurfaceProblem | None, State | None]:
        """One attempt at a substep from `state` to the time `end`; the stepper has the pairs that it was solved with.

        `can_be_cut`: see `_solve`.
        Sliding contacts take the pairs of where the substep starts. If points slide by more than a small part of a
        facet, it is solved again with the pairs of where it ends.
        """
        self.chain.begin()
        names = [c.name for c in self.system.contacts if self.system.problem.pairs[c.name].contact.sliding]
        if not names:
            return self, *self._solve(state, end, history, on_iteration, can_be_cut)
        self._follow_bodies()  # the steppers of other pairs share what it stores
        searched = relative_positions(self.system, state, names)
        for _ in range(SEARCHES):
            try:
                stepper = self._with_pairs(searched)
            except (SceneError, GeometryError) as error:
                log.warning("t = %g: %s", end, error)
                return self, _unsolved(state, self.surface.size, Status.APART, ()), None, None
            start = carried_over(state, stepper.system)
            solution, problem, new = stepper._solve(start, end, history, on_iteration, can_be_cut)
            if new is None:
                break
            now = relative_positions(stepper.system, new, names)
            if pairs_hold(stepper.system, searched, now):
                break
            searched = now
        else:
            log.warning("t = %g: pairs still change after %d searches; the last ones are kept", end, SEARCHES)
            self.chain.unsettled.append(end)
        return stepper, solution, problem, new

    def _with_pairs(self, searched: Mapping[str, Array]) -> Stepper:
        """A stepper of the same bodies, with the pairs that are found at these `relative_positions`; collective."""
        other = Stepper(self.system.searched(searched), self.chain, searched)
        other.surface.adopt(self.surface)
        return other

    def _solve(
        self, state: State, end: float, history: list[HistoryRow], on_iteration: OnIteration, can_be_cut: bool
    ) -> tuple[Solution, SurfaceProblem | None, State | None]:
        """One substep with the present pairs, by one method after the other; the new state is None if all fail.

        `can_be_cut`: whether a shorter one can follow. Then on the condensed form the first method alone is tried.
        """
        began = clock.perf_counter()

        def record(step: Step) -> None:
            row = HistoryRow(time=end, step=step, seconds=clock.perf_counter() - began, method=self.chain.stage.method)
            history.append(row)
            log.info("t = %g  iteration %d  residual %.2e", row.time, step.iteration, step.residual)
            on_iteration(row)

        while True:
            attempt = self._attempt(state, end, record)
            solution, _, new = attempt
            if new is not None or solution.status is Status.NO_EQUILIBRIUM:
                return attempt
            if can_be_cut and self.chain.stage.surface == "condensed":
                return attempt  # Newton's chain is long: a shorter step helps it more than another method
            if not self.chain.advance(self.system, end, solution):
                return attempt

    def _attempt(
        self, state: State, end: float, record: OnStep
    ) -> tuple[Solution, SurfaceProblem | None, State | None]:
        """One substep with the present pairs and method; a failure of linear algebra ends as `Status.BROKEN`."""
        system = self.system
        rows: list[Step] = []

        def on_step(step: Step) -> None:
            rows.append(step)
            record(step)

        problem = None
        try:
            if self.stage is not self.chain.stage:
                self._follow()
            problem, u_s, load = self.posed(state, end)
            start = (
                self._first_tractions(state, end) if problem.p_ref > 0 else np.zeros_like(state.p)
            )  # no load: no traction
            motion = unbalanced_motion(problem) if self.surface.floating else None
            if motion is not None:
                nothing_balances = Solution(
                    p=start, w=state.w, u_c=motion, status=Status.NO_EQUILIBRIUM, residual=np.inf, history=()
                )
                return nothing_balances, problem, None
            method = self.method_after(state)
            at_once = None
            if self._tightening is not None and self.chain.stage.method == CondensedNewton.NAME:
                at_once = self._with_bolts.solve(self._tightening, problem, u_s, state, start, on_step)
            if at_once is not None:
                solution, (problem, u_s, load) = at_once, self.posed(state, end)
            else:
                solution, problem = solve_by_turns(
                    problem,
                    self.cone.at(end),
                    state.slid,
                    start,
                    lambda problem, p: method(problem, p, on_step),
                    self.system.problem.solver.tolerance,
                )
            if solution.status is not Status.CONVERGED:
                return solution, problem, None
            q = problem.surface.recover(problem.load, solution.p, solution.u_c)
            u, u_strained = displacement(system, end, q, u_s)
        except (SolverError, np.linalg.LinAlgError) as error:
            log.warning("t = %g: %s", end, error)
            return _unsolved(state, self.surface.size, Status.BROKEN, tuple(rows)), problem, None
        new = new_state(
            system=system,
            old=state,
            problem=problem,
            u=u,
            u_strained=u_strained,
            u_s=u_s,
            load=load,
            p=solution.p,
            driven=solution.u_c[len(solution.u_c) - self.surface.driven :],
        )
        if not np.isfinite([new.energy.external, new.energy.stored, new.energy.contact]).all():
            return replace(solution, status=Status.NOT_FINITE), problem, None
        previous = Previous(time=state.time, p=state.p) if end > state.time else None
        peak = max(state.peak, new.energy.stored)
        law_error = state.law_error + solution.law_error
        if self.chain.repeats:
            return solution, problem, replace(new, previous=previous, law_error=law_error, peak=peak)
        try:
            with system.counters.clock.part("certificate"):
                left = self._correction(problem, solution, state, new)
        except (SolverError, np.linalg.LinAlgError) as error:  # the step is solved all the same
            log.warning("t = %g: the error of the iteration is unknown: %s", end, error)
            left = replace(state.correction or Correction.none(len(new.w)), size=np.nan)
        return (
            replace(solution, others=other_ends(problem, self.cone.at(end), state.slid, solution.p)),
            problem,
            replace(new, previous=previous, law_error=law_error, peak=peak, correction=left),
        )

    def _correction(self, problem: SurfaceProblem, found: Solution, old: State, new: State) -> Correction:
        """From what the method found to the exact solution of the same substep and of all before; collective.

        Args:
            problem: that the method solved.
            found: its solution.
            old: the state that the substep starts from.
            new: the state at its end.
        """
        before = old.correction or Correction.none(len(new.w))
        if not len(new.w) or problem.p_ref == 0:
            return replace(Correction.none(len(new.w)), slid=before.slid)
        if found.correct is not None:  # an estimate of the method's own, with mu as it ended
            left = found.correct(before)
        else:
            slid = {name: lengths + before.slid.get(name, 0.0) for name, lengths in old.slid.items()}
            if self.chain.stage.surface != "condensed":
                found = replace(found, w=new.w)  # of the displacement that was recovered
            nearer, size, slid = exact_by_turns(
                exact_problem(problem, before), self.cone.at(new.time), slid, found, self._exact
            )
            ahead = {name: lengths - new.slid[name] for name, lengths in slid.items()}
            left = Correction(nearer.p - found.p, nearer.w - found.w, size, ahead)
        return replace(left, size=left.size + PAIRS * before.size) if self.searched else left

    def _exact(self, problem: SurfaceProblem, found: Solution) -> tuple[Solution, float]:
        """The exact solution of a surface problem from one that is near, and their distance [J^(1/2)]; collective."""
        if self.chain.stage.surface == "condensed":
            return by_schur_complement(problem, found)
        # the uncondensed form solves floating bodies on springs: that is no response of theirs
        most = 0 if self.chain.stage.surface == "sparse" and self.surface.floating else SOLVES
        return by_flexibility(problem, self.chain.flexibility(self.system, self.surface), found, most)

    def _first_tractions(self, state: State, end: float) -> Array:
        """Tractions (rows,) [Pa] that the iteration starts from.

        Measured: with exact volume solves extrapolation saves a third to two thirds of Newton's iterations and an
        eighth to a quarter of Uzawa's; with iterative ones it costs a fifth more, so there it is off.
        """
        return state.ahead(end, self.system.course.timeline.turns) if self.surface.exact else state.p

    def split(self, p: Array) -> tuple[list[Array], list[Array]]:
        """Flat tractions (rows,) [Pa] as pressures (m_n,) and tangential tractions (m_t, d-1) of each contact."""
        return split(self.cone, p)

    def posed(self, state: State, time: float) -> tuple[SurfaceProblem, Vec, Vec]:
        """The surface problem of a substep from `state` to a time [s]; collective.

        Returns:
            The problem, and over all displacements what is prescribed [m] and the external forces [N].
        """
        system, n = self.system, self.surface.normal_rows
        external, u_s = system.load(time), system.prescribed(time)
        driving = system.obstacles.driving_force(time)
        problem = SurfaceProblem(
            surface=self.surface,
            cone=with_slip(self.cone.at(time), state.slid),
            load=self.surface.load(system.pull(time, external, u_s), driving),
            offset=relative_displacement(system, u_s, time, np.zeros(self.surface.driven)),
            u_before=self._at_contact(state) if self.surface.floating else np.zeros(self.surface.size),
            gap=np.concatenate([self.gap, (state.w - self.cone.give(state.p))[n:]]),
            gamma=self.gamma,
            weight=self.weight,
            force=sum_of_sizes(external) + float(np.abs(driving).sum()),
            stiffness=system.problem.softest / system.extent,
        )
        return problem, u_s, external

    def _at_contact(self, state: State) -> Array:
        """Displacement (c,) [m] of the contact dofs in a state; collective."""
        q = self.system.free_part(state.u, state.time)
        return np.concatenate([self.volume.contact.read(q), state.driven])


def _unsolved(state: State, size: int, status: Status, rows: tuple[Step, ...]) -> Solution:
    """What stands for the solution of a substep that ended early: the tractions of the state before it."""
    residual = rows[-1].residual if rows else np.inf
    return Solution(p=state.p, w=state.w, u_c=np.zeros(size), status=status, residual=residual, history=rows)
