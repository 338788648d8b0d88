"""What every method returns: tractions, how it ended, and each iteration's residual."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from geometry.arrays import Array


class Status(Enum):
    """How an iteration ended; the value tells the user what to try."""

    CONVERGED = "converged"
    MAX_IT = "the iterations ran out: raise solver.max_iterations"
    STALLED = "the residual stopped falling: try another solver.method, or a larger solver.tolerance"
    NOT_FINITE = "the iteration left the range of numbers: check the units of E, loads and lengths"
    BROKEN = 'a linear solve failed: try another solver.method, or solver.surface = "condensed"'
    NO_EQUILIBRIUM = "contact and friction cannot balance the loads"
    NO_HOLD = "contact and friction could not hold the body: check loads, friction and the start of contact"


@dataclass(frozen=True)
class Step:
    """One iteration: its residual is that of the tractions before its update."""

    iteration: int
    residual: float
    volume_solves: int


OnStep = Callable[[Step], None]


def ignore(step: Step) -> None:
    """The callback that does nothing."""


@dataclass(frozen=True)
class Solution:
    """p, w: flat, see `SurfaceProblem`; u_c (c,): displacement of the contact dofs [m], or the motion not held."""

    p: Array
    w: Array
    u_c: Array
    status: Status
    residual: float  # of these tractions
    history: tuple[Step, ...]
    law_error: float = 0.0  # energy norm of what the method's own approximation of the laws leaves [J^(1/2)]
    slack: float = 1e-6  # part of the friction bound by which a slipping point may fall short of it

    @property
    def iterations(self) -> int:
        return self.history[-1].iteration if self.history else 0
