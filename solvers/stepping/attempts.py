"""The methods that a step is tried with, one after the other, and the bodies in the form that each needs."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

from solvers.interface.coarse_mesh import CoarseMesh
from solvers.interface.flexibility import DelassusOperator
from solvers.interface.prepare import prepare_volume
from solvers.methods import METHODS
from solvers.methods.method import Ready, Setup, Solve
from solvers.newton.solution import Solution
from solvers.parallel.serialise import Plain
from solvers.stepping.choice import Choice, Stage, choose, fits
from solvers.stepping.state import State
from solvers.system.system import System

SAFE = 4.0  # how much a safe metric gives way more than bodies do
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Switch:
    """The run went on with another method."""

    time: float  # that the step in question leads to
    iteration: int  # after which
    before: str
    after: str
    because: str


@dataclass(frozen=True)
class Reached:
    """How far down its chain of methods a run has come."""

    choice: Choice
    at: int
    switches: tuple[Switch, ...]


class Attempts:
    """Where a run stands in its chain of methods. A switch holds: what failed would fail again."""

    def __init__(self, system: System, reached: Reached | None = None) -> None:
        """Prepare the bodies for the first method, and a coarse mesh if it is worth its while; collective.

        Args:
            reached: where to go on, whatever would be chosen with the memory that is free now.
        """
        reached = reached or Reached(choose(system), 0, ())
        self.choice, self.at, self.switches = reached.choice, reached.at, list(reached.switches)
        self.volume = prepare_volume(system, self.stage.surface)
        self.coarse = CoarseMesh.beside(system) if self.choice.coarse else None
        self._ready: dict[Stage, Ready] = {}

    @property
    def stage(self) -> Stage:
        return self.choice.stages[self.at]

    @property
    def reached(self) -> Reached:
        return Reached(self.choice, self.at, tuple(self.switches))

    def advance(self, system: System, time: float, solution: Solution) -> bool:
        """Go on to the next method, if there is one that memory has room for; collective."""
        if self.at + 1 == len(self.choice.stages):
            return False
        before, after = self.stage, self.choice.stages[self.at + 1]
        if after.surface != before.surface and not fits(system, after.surface):
            log.warning("t = %g: %s: %s; no memory for %s", time, before, solution.status.value, after)
            return False
        self.at += 1
        switch = Switch(time, solution.iterations, str(before), str(self.stage), solution.status.value)
        self.switches.append(switch)
        log.warning("t = %g: %s: %s; goes on with %s", time, switch.before, switch.because, switch.after)
        if self.stage.surface != before.surface:
            self.volume.release()
            self.volume = prepare_volume(system, self.stage.surface)
        return True

    def method(self, system: System, surface: DelassusOperator) -> Callable[[State], Solve]:
        """The solver of the step that follows a state. What the method has learnt of the bodies, it keeps."""
        setup = Setup(system=system, surface=surface, coarse=self.coarse, safety=SAFE if self.stage.safe else 1.0)
        before = self._ready.get(self.stage)
        if before is None:
            ready = METHODS[self.stage.method].of(system.problem.solver).build(setup)
        else:
            ready = before.renewed(setup)
        self._ready[self.stage] = ready
        return ready.after

    def snapshot(self) -> dict[str, Plain]:
        """What the method in turn has learnt; see `restore`."""
        return self._ready[self.stage].snapshot()

    def restore(self, snapshot: dict[str, Plain], surface: DelassusOperator) -> None:
        """Go on with what a `snapshot` of the same method holds of the same bodies."""
        self._ready[self.stage].restore(snapshot, surface)
