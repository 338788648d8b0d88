"""Load steps: each starts from the slip of the one before; one that fails is tried again in smaller substeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SolverError
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Convergence
from stickslip.solvers.parallel.released import destroy_released
from stickslip.solvers.stepping.certificate import certified, with_others
from stickslip.solvers.stepping.clock import ClockLoop
from stickslip.solvers.stepping.cycles import CycleLoop
from stickslip.solvers.stepping.halving import Halving
from stickslip.solvers.stepping.history import History, HistoryRow, OnIteration, count_iterations
from stickslip.solvers.stepping.method_chain import MethodChain
from stickslip.solvers.stepping.pairs import PairSearch
from stickslip.solvers.stepping.sensitivity import Neighbours
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.substep import Attempt, Loop, Methods, Substep, SubstepSolver
from stickslip.solvers.stepping.tightening import BoltsAndSprings
from stickslip.solvers.stepping.update import at_rest
from stickslip.solvers.system.system import System


@dataclass(frozen=True, kw_only=True)
class Accepted:
    """A step that was solved, up to a requested time or, if it failed later, up to its last good substep."""

    stepper: SubstepSolver  # with the contact rows that the state refers to
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
    proved: bool  # whether it is proved that no substep has others
    jump: float | None  # energy [J] that jumps of substeps set free; None: none jumps
    history: tuple[HistoryRow, ...]  # every iteration of every attempt


class StepError(SolverError):
    """A step could not be solved: its smallest substep failed.

    Attributes:
        time: end of the substep that failed [s].
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
        self.time, self.history, self.last_good = time, history, last_good


class NoEquilibriumError(StepError):
    """A step could not be solved, and no equilibrium continues the one before to the time in its text.

    That is proved on rigid bodies by `limit_analysis`, or shown on elastic ones by springs, see `newton/collapse`.
    """


class Stepper(SubstepSolver):
    """Solves load steps with bodies that are prepared once: loops around one substep, see `substep`."""

    def __init__(self, system: System, chain: MethodChain | None = None) -> None:
        """Prepare the bodies, unless `chain` has them, and the method; collective.

        Args:
            system: the bodies, and the contact rows of their present pairs.
            chain: shared by the steppers of the same bodies; None: made here.
        """
        super().__init__(system, chain or MethodChain(system))
        self.bolts: BoltsAndSprings = BoltsAndSprings(system)
        self.clock = system.problem.timeline.clock  # finds the steps between requested times
        self.neighbours: Neighbours | None = None  # derivatives follow each substep, see `State.neighbours`
        self.follow()

    def start(self) -> State:
        """The initial state: at rest at t = 0, without load, displacement or traction; collective."""
        found = at_rest(self.system, self.cone)
        return replace(found, neighbours=self.neighbours.start()) if self.neighbours else found

    def reach(self, start: State, target: float, on_iteration: OnIteration, pauses: bool = False) -> Accepted:
        """Solve one step; collective.

        Args:
            start: state that the step starts from.
            target: time at its end [s].
            on_iteration: called with each iteration.
            pauses: whether a clock may end the step before that, to tell of an event.

        Raises:
            StepError: it was given up, see the loops.
            NoEquilibriumError: so, and it is shown that nothing balances the loads.
        """
        history = self.chain.history = History(on_iteration)
        solves, pairs = self.system.counters.volume_solves, PairSearch(self)
        halving = Halving(
            self.system, self.chain, (certified, with_others, self._accompanied, *filter(None, [self.neighbours]))
        )
        clock = ClockLoop(self, self.clock, pauses)
        loops: tuple[Loop, ...] = (
            Methods(self.chain),
            pairs,
            halving,
            clock,
            self.bolts,
            CycleLoop(self),
        )  # inside out

        def innermost(state: State, end: float) -> Attempt:
            return pairs.present.solve(state, end)

        step: Substep = innermost
        for loop in (loop for loop in loops if loop.active()):
            step = loop.around(step)
        try:
            tried = step(start, target)
        finally:
            self.chain.history = History()  # what is called with each iteration is let go
        rows = history.rows
        if tried.state is None:
            kind = NoEquilibriumError if tried.impossible else StepError
            good = _accepted(tried.good, start, rows, solves) if tried.good else None
            raise kind(tried.when, tried.why, tuple(rows), good)
        destroy_released(self.system.mesh.comm)
        return _accepted(tried, start, rows, solves)

    def _accompanied(self, attempt: Attempt) -> Attempt:
        """An accepted substep that the companion has followed; collective."""
        new, problem = attempt.state, attempt.problem
        if self.companion is None or new is None or problem is None:
            return attempt
        refined = self.companion(attempt.solver, attempt.begin, new, problem)
        return replace(attempt, state=replace(new, refined=refined))


def _accepted(tried: Attempt, start: State, rows: Sequence[HistoryRow], solves: int) -> Accepted:
    """A step that was solved.

    Args:
        tried: as it was.
        start: that it started from.
        rows: its iterations, and perhaps later ones.
        solves: of the run before it.
    """
    solution, history = tried.solution, tuple(rows[: tried.rows])
    assert tried.state is not None
    assert tried.problem is not None
    return Accepted(
        stepper=tried.solver,
        state=tried.state,
        start=start,
        substep_start=tried.begin,
        problem=tried.problem,
        substeps=tried.substeps,
        iterations=count_iterations(history),
        volume_solves=tried.volume_solves - solves,
        residual=solution.residual,
        slack=solution.slack,
        weakening=solution.weakening,
        linear_error=tried.linear_error,
        convergence=solution.convergence,
        others=solution.others,
        proved=solution.proved,
        jump=solution.jump if solution.jumps else None,
        history=history,
    )
