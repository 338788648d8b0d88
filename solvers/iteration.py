"""The driver of all iterations: a method yields what it has reached, the driver writes it down and says when it ends.

Tolerance, stall, cycle, numbers that are not finite, the largest number of iterations, the history and its callback are
the driver's. What every method returns is a `Solution` with its `Status`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from stickslip.geometry.arrays import CLOSE, EXACT, Array
from stickslip.solvers.parallel.counters import Counters


class Status(Enum):
    """Ending of an iteration; the value tells the user what to try."""

    CONVERGED = "converged"
    MAX_IT = "the iterations ran out: raise solver.max_iterations"
    UNSTEADY = "slip and friction do not settle: friction weakens, or wears off, too fast; check its law and wear.k"
    STALLED = "the residual stopped falling: try a larger solver.tolerance"
    SLOW = 'the volume solves take too many iterations: try solver.surface = "condensed"'
    NOT_FINITE = "the iteration left the range of numbers: check the units of E, loads and lengths"
    BROKEN = "a linear solve failed, run.log says why: try another solver.surface"
    APART = "the sides of a sliding contact have moved apart, run.log says where: check loads, friction and supports"
    NO_EQUILIBRIUM = "contact and friction cannot balance the loads"
    GIVES_WAY = "bodies give way, though friction is not shown to be spent: try shorter steps from a load that holds"
    NO_HOLD = "no state of contact that was tried holds the bodies: check loads, friction and the start of contact"


@dataclass(frozen=True)
class Step:
    """One iteration; `residual` is the complementarity residual of the tractions before its update."""

    iteration: int
    residual: float
    volume_solves: int


OnStep = Callable[[Step], None]


def ignore(step: Step) -> None:
    """The callback that does nothing."""


@dataclass
class Stall:
    """Notices a residual that has stopped falling: for `window` iterations none was below a part of the smallest.

    >>> stall = Stall(window=2)
    >>> [stall(k, residual) for k, residual in enumerate((1.0, 0.6, 0.4, 0.2, 0.3, 0.3))]
    [False, False, False, False, False, True]
    >>> stall = Stall(window=1, start=0)
    >>> [stall(k, residual) for k, residual in enumerate((0.1, 1.0, 0.4, 0.3, 0.3))]
    [False, False, False, False, True]
    """

    window: int
    start: int = -1  # residuals of iterations up to this one do not count
    part: float = 0.5  # of the smallest that a residual has to be below
    least: float = field(default=np.inf, init=False)  # the smallest residual that counts
    found_at: int = field(default=0, init=False)  # its iteration

    def __call__(self, k: int, residual: float) -> bool:
        """Whether the iteration has stalled at iteration k; called once in each, with its residual."""
        if k <= self.start:
            return False
        if residual < self.part * self.least:
            self.least, self.found_at = residual, k
        return k - self.found_at > self.window


@dataclass
class Plateau:
    """Notices a slow residual that has stopped falling: over `window` iterations its largest value did not.

    A residual that first dips, rises and then falls again, slowly, has not stopped.

    >>> plateau = Plateau(window=3)
    >>> [plateau(k, residual) for k, residual in enumerate((0.9, 0.1, 0.5, 0.4, 0.3, 0.3, 0.4, 0.3, 0.3))]
    [False, False, False, False, False, False, False, False, True]
    """

    window: int
    before: float = field(default=np.inf, init=False)  # largest of the last whole window
    largest: float = field(default=0.0, init=False)  # of the present one

    def __call__(self, k: int, residual: float) -> bool:
        """Whether it has stopped falling by iteration k; called once in each, with its residual."""
        self.largest = max(self.largest, residual)
        if (k + 1) % self.window:
            return False
        stopped = self.largest >= self.before
        self.before, self.largest = self.largest, 0.0
        return stopped


@dataclass(frozen=True, kw_only=True)
class Convergence:
    """Convergence of Uzawa's iteration on a step: as theory has it, and as it happened.

    Without projection and with fixed bounds the error falls by max |1 - alpha lambda_i| an iteration in the metric Q,
    and converges for 0 < alpha < 2 / lambda_1 only. lambda_i are the eigenvalues of Q^-1 B F'^-1 B^T.
    """

    preconditioner: str  # Q
    alpha: float  # step size; its unit is that of 1 / lambda_1
    lambda_1: float  # the largest eigenvalue, by power iteration, with its error added
    lambda_m: float | None  # the smallest eigenvalue, by Lanczos' method; None: not asked for
    bound: float | None  # max |1 - alpha lambda_i| [-]; None: lambda_m was not asked for
    observed: float | None  # mean factor of the residual [-], over the second half of the iterations; None: too few
    residuals: tuple[float, ...]  # natural residual of each iteration [-]


@dataclass(frozen=True)
class Correction:
    """Exact solution minus what the method returned."""

    p: Array  # (rows,) p* - p [Pa]
    w: Array  # (rows,) w* - w [m]
    size: float  # upper estimate of the energy norm of u* - u [J^(1/2)]; nan: no exact solution was found
    memory: Mapping[str, Array] = field(default_factory=dict)  # of `State.memory`; without a contact's name: zero

    @classmethod
    def none(cls, rows: int) -> Correction:
        """No correction of that many rows.

        >>> Correction.none(2)
        Correction(p=array([0., 0.]), w=array([0., 0.]), size=0.0, memory={})
        """
        return cls(np.zeros(rows), np.zeros(rows), 0.0)


@dataclass(frozen=True)
class Solution:
    """Tractions p (rows,) [Pa] and relative displacement w (rows,) [m], flat as in `SurfaceProblem`, and u_c (c,) [m].

    u_c is the displacement of the contact dofs; with NO_EQUILIBRIUM, GIVES_WAY the rigid motion that nothing resists.
    """

    p: Array
    w: Array
    u_c: Array
    status: Status
    residual: float  # complementarity residual of these tractions
    history: tuple[Step, ...]
    law_error: float = (
        0.0  # contact-law residual that the method's approximation of the laws leaves, in energy norm [J^(1/2)]
    )
    correct: Callable[[Correction], Correction] | None = None  # of approximate laws; takes that of the step before
    convergence: Convergence | None = None  # of methods that measure it
    others: tuple[Array, ...] = ()  # tractions (rows,) [Pa] of other solutions that were met
    proved: bool = False  # whether it is proved that there are none
    jumps: bool = False  # whether no solution goes on from the state before without a fall of the load
    jump: float = 0.0  # energy [J] that such jumps set free
    weakening: float = 0.0  # how much faster than bodies unload friction weakens by slip or wear [-]; above 1 it jumps
    lacking: float = 1.0  # see `Mechanism`, with NO_EQUILIBRIUM, GIVES_WAY
    slack: float = CLOSE  # part of the friction bound by which the traction of a slipping point may be smaller
    gap: Array | None = None  # (rows,) [m] with slip counted from where points touch; None: that of the problem

    @property
    def iterations(self) -> int:
        return self.history[-1].iteration if self.history else 0

    @property
    def contraction(self) -> float | None:
        """Mean factor of the residual [-], over the second half of the iterations; None: too few."""
        residuals = [step.residual for step in self.history]
        half = len(residuals) // 2
        if len(residuals) < 8 or not residuals[half] > 0:  # iterations of which the second half tells a rate
            return None
        return float((residuals[-1] / residuals[half]) ** (1 / (len(residuals) - 1 - half)))

    def needs(self, begin: float, end: float) -> float:
        """Iterations from one residual to another, where they ran out while it fell steadily; nan: unknown."""
        rate, last = self.contraction, [step.residual for step in self.history[len(self.history) // 2 :]]
        if rate is None or self.status is not Status.MAX_IT or not np.all(np.diff(last) < 0):
            return np.nan
        return float(np.log(end / begin) / np.log(rate))


QUICK, USUAL, PATIENT = 20, 50, 500  # windows of stalls, by the number of iterations that methods need
When = Callable[[int, float], bool]  # number and residual of an iterate: whether something is the case there


def never(number: int, residual: float) -> bool:
    """The condition that is never met."""
    return False


@dataclass(frozen=True)
class Iterate:
    """State that a method has reached: it yields one for each row of the history, and goes on if asked for more."""

    number: int  # of the iteration
    residual: float  # of the tractions, or the relative error that the method estimates [-]
    p: Array = field(default_factory=lambda: np.zeros(0))  # as in `Solution`, like the next two; a method that
    w: Array = field(default_factory=lambda: np.zeros(0))  # knows them only at its end leaves them out
    u_c: Array = field(default_factory=lambda: np.zeros(0))
    gap: Array | None = None
    enough: bool | None = None  # whether the method takes it for the solution; None: where `residual` is small enough
    known: bool = True  # False: the residual says nothing yet, for w is not the displacement under p

    def repeats(self, visited: Sequence[Iterate]) -> bool:
        """Whether tractions and motion are those of an earlier iterate, or go to and fro: the iteration cycles."""

        def same(x: Array, y: Array) -> bool:
            # relative change up to which two iterates are the same
            return bool(np.abs(x - y).max(initial=0.0) <= EXACT * np.abs(x).max(initial=0.0))

        def back(last: Iterate, one: Iterate, two: Iterate) -> bool:
            return bool(np.linalg.norm(last.p - two.p) < np.linalg.norm(last.p - one.p) / 10)

        hops = len(visited) > 2 and back(self, *visited[:-3:-1]) and back(*visited[:-4:-1])
        return hops or any(same(self.p, before.p) and same(self.w, before.w) for before in visited)


@dataclass
class Driver:
    """Runs iterations to their end; several runs share tolerance, history, and the best iterate."""

    counters: Counters
    rtol: float
    max_it: int
    on_step: OnStep = ignore
    history: list[Step] = field(default_factory=list, init=False)
    best: Solution | None = field(default=None, init=False)  # the iterate with the smallest residual, without history
    stalled: bool = field(default=False, init=False)  # whether the last run ended because its residual did not fall

    @property
    def last(self) -> int:
        """Number of the last iteration; 0: there is none."""
        return self.history[-1].iteration if self.history else 0

    @property
    def over(self) -> bool:
        """Whether the problem is solved, or the iterations ran out."""
        ran_out = bool(self.history) and self.last >= self.max_it
        return ran_out or (self.best is not None and self.best.status is Status.CONVERGED)

    def run(
        self,
        iterates: Iterable[Iterate],
        stalls: When = never,
        *,
        slow: When = never,
        cycles: bool = False,
        otherwise: Status = Status.NO_HOLD,
    ) -> Solution:
        """Iterate until it converges, stalls or cycles, or the iterations run out.

        Args:
            iterates: the method.
            stalls: whether the residual has stopped falling.
            slow: whether another method is to take over.
            cycles: whether an iterate that comes back is the end: all that follow would come back, too.
            otherwise: status where the method itself goes no further.

        Returns:
            The last iterate.
        """
        x, visited, self.stalled = Iterate(0, np.inf), list[Iterate](), False
        for x in iterates:
            self.history.append(Step(x.number, x.residual, self.counters.volume_solves))
            self.on_step(self.history[-1])
            status = self._ending(x)
            if x.known and status is None:
                self.stalled = stalls(x.number, x.residual)
                status = Status.STALLED if self.stalled or (cycles and x.repeats(visited)) else None
                visited += [x] if cycles else []
            if status is None and slow(x.number, x.residual):
                status = Status.SLOW
            if status is None and x.number >= self.max_it:
                status = Status.MAX_IT
            self._keep(Solution(x.p, x.w, x.u_c, status or Status.STALLED, x.residual, (), gap=x.gap))
            if status is not None:
                break
        else:
            status = otherwise
        return Solution(x.p, x.w, x.u_c, status, x.residual, tuple(self.history))

    def _ending(self, x: Iterate) -> Status | None:
        """The status of an iterate by its residual alone."""
        if not (np.isfinite(x.residual) if x.known else not np.isnan(x.residual)):
            return Status.NOT_FINITE
        enough = x.residual <= self.rtol if x.enough is None else x.enough
        return Status.CONVERGED if enough else None

    def _keep(self, solution: Solution) -> None:
        """Keep a solution if it is an answer, or the best one so far; of those equal to rounding the last, not NaN."""
        best, ended = self.best, solution.status is Status.CONVERGED
        if best is None or np.isnan(best.residual) or ended or solution.residual <= best.residual * (1 + EXACT):
            self.best = solution
        elif solution.status is Status.MAX_IT:
            self.best = replace(best, status=Status.MAX_IT)
