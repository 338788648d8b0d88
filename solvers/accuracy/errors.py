"""All errors of the numbers of a run: of each step when it is solved; at the end of the time steps, and of order 2."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stickslip.solvers.accuracy.iteration_errors import iteration_errors
from stickslip.solvers.accuracy.mesh_error import mesh_errors
from stickslip.solvers.accuracy.next_order import smooth_errors
from stickslip.solvers.accuracy.resolution import with_unresolved
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.results.observe import Observer
from stickslip.solvers.results.step_result import ErrorParts, Errors, Quantity, StepResult, quantities
from stickslip.solvers.stepping.stepper import Accepted


def with_errors(observe: Observer, accepted: Accepted, result: StepResult) -> StepResult:
    """The result of a step with the errors of its numbers, but for those that are found at the end; collective."""
    found = quantities(result)
    of_order_1 = accepted.stepper.system.mesh.degree == 1
    corrected, of_mesh = (mesh_errors if of_order_1 else smooth_errors)(observe, accepted, result)
    of_iteration = iteration_errors(observe, accepted, found)
    exact_laws = accepted.stepper.chain.exact_laws
    errors = dict[Quantity, ErrorParts]()
    for key, value in found.items():
        laws = ErrorParts(law=np.abs(0.0 * value) if exact_laws else None)
        parts = [part for part in (of_mesh.get(key), of_iteration.get(key)) if part is not None]
        for part in parts:
            laws = laws.joined(part)
        errors[key] = laws
    known = with_unresolved(accepted.stepper.system.contacts, result, errors)
    return replace(
        result,
        corrected={str(key): value for key, value in corrected.items()},
        errors={str(key): parts for key, parts in known.items()},
    )


def joined(
    contacts: Sequence[ContactRows], steps: Sequence[StepResult], *found_later: Sequence[Errors]
) -> tuple[Errors, ...]:
    """All errors of the numbers of each step.

    Args:
        contacts: of the run's mesh.
        found_later: those that are found at the end of a run, each for as many steps as they are known for.
    """
    found = []
    for k, step in enumerate(steps):
        later = [errors[k] for errors in found_later if k < len(errors)]
        own = {key: step.errors.get(str(key), ErrorParts()) for key in quantities(step)}
        for errors in later:
            own = {key: parts.joined(errors.get(key, ErrorParts())) for key, parts in own.items()}
        found.append(with_unresolved(contacts, step, own))
    return tuple(found)
