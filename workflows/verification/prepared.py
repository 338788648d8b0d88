"""A system that no scene can say, solved: moved nodes, loads that vary in space."""

from __future__ import annotations

from collections.abc import Iterator

from solvers.observe import Observer
from solvers.step_result import StepResult
from solvers.stepping import Accepted, Stepper
from solvers.system import System


def accepted(system: System) -> Iterator[Accepted]:
    """The requested times, one after the other."""
    yield from _march(Stepper(system))


def observed(system: System) -> Iterator[StepResult]:
    """What the requested times leave behind."""
    stepper = Stepper(system)
    observe = Observer(stepper)
    yield from map(observe, _march(stepper))


def _march(stepper: Stepper) -> Iterator[Accepted]:
    state = stepper.start()
    for time in stepper.system.scene.requested_times():
        step = stepper.reach(state, time, lambda row: None)
        state = step.state
        yield step
