"""What every method returns: tractions, its status, the residual of each iteration, and when it has stopped falling."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from stickslip.geometry.arrays import CLOSE, Array


class Status(Enum):
    """How an iteration ended; the value tells the user what to try."""

    CONVERGED = "converged"
    MAX_IT = "the iterations ran out: raise solver.max_iterations"
    STALLED = "the residual stopped falling: try another solver.method, or a larger solver.tolerance"
    SLOW = 'the volume solves take too many iterations: try solver.surface = "condensed"'
    NOT_FINITE = "the iteration left the range of numbers: check the units of E, loads and lengths"
    BROKEN = "a linear solve failed, run.log says why: try another solver.method or solver.surface"
    APART = "the sides of a sliding contact have moved apart, run.log says where: check loads, friction and supports"
    NO_EQUILIBRIUM = "contact and friction cannot balance the loads"
    NO_HOLD = "no state of contact that was tried holds the bodies: check loads, friction and the start of contact"


@dataclass(frozen=True)
class Step:
    """One iteration; `residual` is the complementarity residual of the tractions before its update."""

    iteration: int
    residual: float
    volume_solves: int


def ending(residual: float, rtol: float, stopped: bool) -> Status | None:
    """How an iteration ends at a residual; None: it goes on.

    Args:
        residual: of the iterate.
        rtol: that is enough.
        stopped: whether residuals have stopped falling.
    """
    if not np.isfinite(residual):
        return Status.NOT_FINITE
    if residual <= rtol:
        return Status.CONVERGED
    return Status.STALLED if stopped else None


OnStep = Callable[[Step], None]


def ignore(step: Step) -> None:
    """The callback that does nothing."""


@dataclass
class Stall:
    """Notices a residual that has stopped falling: for `window` iterations none was below `factor` times the smallest.

    >>> stall = Stall(window=2, factor=0.5)
    >>> [stall(k, residual) for k, residual in enumerate((1.0, 0.6, 0.4, 0.3, 0.3, 0.3))]
    [False, False, False, False, False, True]
    """

    window: int
    factor: float
    least: float = field(default=np.inf, init=False)  # the smallest residual that counts
    found_at: int = field(default=0, init=False)  # its iteration

    def __call__(self, k: int, residual: float) -> bool:
        """Whether the iteration has stalled at iteration k; called once in each, with its residual."""
        if residual < self.factor * self.least:
            self.least, self.found_at = residual, k
        return k - self.found_at > self.window


@dataclass
class Plateau:
    """Notices a slow residual that has stopped falling: over `window` iterations its largest value did not.

    A residual that first dips, rises and then falls again, slowly, has not stopped.

    >>> plateau = Plateau(window=2)
    >>> [plateau(k, residual) for k, residual in enumerate((0.9, 0.1, 0.5, 0.4, 0.3, 0.3, 0.3, 0.3))]
    [False, False, False, False, False, False, False, True]
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
    """What theory says of Uzawa's iteration on a step, beside what happened.

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
        """No correction of that many rows."""
        return cls(np.zeros(rows), np.zeros(rows), 0.0)


@dataclass(frozen=True)
class Solution:
    """Tractions p (rows,) [Pa] and relative displacement w (rows,) [m], flat as in `SurfaceProblem`, and u_c (c,) [m].

    u_c is the displacement of the contact dofs; with Status.NO_EQUILIBRIUM, the rigid motion that nothing resists.
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
    weakening: float = 0.0  # how much faster than bodies unload friction weakens by slip [-]; above 1 slip jumps
    slack: float = CLOSE  # part of the friction bound by which the traction of a slipping point may be smaller

    @property
    def iterations(self) -> int:
        return self.history[-1].iteration if self.history else 0
