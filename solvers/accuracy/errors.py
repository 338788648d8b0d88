"""All errors of the numbers of a run: of each step when it is solved, of the time steps at the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from solvers.accuracy.iteration_errors import iteration_errors
from solvers.accuracy.mesh_error import mesh_errors
from solvers.results.error_parts import ErrorParts, Errors
from solvers.results.numbers import quantities
from solvers.results.observe import Observer
from solvers.results.step_result import StepResult
from solvers.stepping.stepper import Accepted


def with_errors(observe: Observer, accepted: Accepted, result: StepResult) -> StepResult:
    """The result of a step with the errors of its numbers, but for those of the time steps; collective."""
    found = quantities(result)
    corrected, of_mesh = mesh_errors(observe, accepted, result)
    of_iteration = iteration_errors(observe, accepted, found)
    exact_laws = accepted.stepper.chain.exact_laws
    errors = {}
    for key, value in found.items():
        laws = ErrorParts(law=np.abs(0.0 * value) if exact_laws else None)
        parts = [part for part in (of_mesh.get(key), of_iteration.get(key)) if part is not None]
        for part in parts:
            laws = laws.joined(part)
        errors[str(key)] = laws
    return replace(result, corrected={str(key): value for key, value in corrected.items()}, errors=errors)


def joined(steps: Sequence[StepResult], of_time: Sequence[Errors]) -> tuple[Errors, ...]:
    """All errors of the numbers of each step.

    Args:
        of_time: those of the time steps, for as many steps as they are known for.
    """
    found = []
    for step, times in zip(steps, [*of_time, *({} for _ in steps[len(of_time) :])], strict=True):
        own = {key: step.errors.get(str(key), ErrorParts()) for key in quantities(step)}
        found.append({key: parts.joined(times.get(key, ErrorParts())) for key, parts in own.items()})
    return tuple(found)
