"""Cyclic histories: every cycle after the second repeats the second one, and the energy balance closes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.results.step_result import ContactState, StepResult
from stickslip.workflows.lab.verification.check import Check, close

CYCLES = 5
SAME = 1e-8  # relative to the largest value of the same kind
BALANCE = 1e-9  # the trapezoid rule makes it exact: what is left is the solver's 1e-11 over the steps
GAIN = 1e-10  # relative to the largest energy: friction never gives energy back
OF_A_NODE: Mapping[str, Callable[[ContactState], Array]] = {
    "tractions": lambda face: np.column_stack([face.pressure, face.traction]),
    "slip increments": lambda face: face.slip_increment,
    "gaps, slip": lambda face: np.column_stack([face.gap, face.slip]),
    "forces": lambda face: face.force,
}


def repeats(name: str, steps: Sequence[StepResult], per_cycle: int, same: float = SAME) -> list[Check]:
    """Cycles 3, 4, ... against cycle 2: states of every node in every step, and the dissipation of each cycle.

    Args:
        steps: whole cycles, without the steps before the first one.
    """
    cycles = [steps[k : k + per_cycle] for k in range(0, len(steps), per_cycle)]
    second, loss = cycles[1], [_loss(cycle) for cycle in cycles]
    found = []
    for k, cycle in enumerate(cycles[2:], start=3):
        for what, of in OF_A_NODE.items():
            apart = _apart(cycle, second, of)
            at = f"{name}, cycle {k} less cycle 2: {what}, over the largest"
            found.append(Check(at, apart, 0.0, same, relative=False))
        found.append(close(f"{name}, cycle {k}: dissipation [J]", loss[k - 1], loss[1], same, 1.0))
    return found


def accounted(name: str, steps: Sequence[StepResult]) -> list[Check]:
    """After every step external work = stored energy + contact work, and no contact's dissipation decreases."""
    terms = np.array([[s.energy.external, s.energy.stored, s.energy.contact] for s in steps])
    scale = np.maximum.accumulate(np.abs(terms).max(axis=1))
    missing = np.abs(terms @ [1.0, -1.0, -1.0])
    worst = float((missing[scale > 0] / scale[scale > 0]).max())
    least = min(face.dissipation for step in steps for face in step.contacts.values())
    return [
        Check(f"{name}: work that is neither stored nor left at contacts, relative", worst, 0.0, BALANCE, False),
        Check(f"{name}: work that friction makes in a step, relative", min(least, 0.0) / scale[-1], 0.0, GAIN, False),
    ]


def _apart(one: Sequence[StepResult], other: Sequence[StepResult], of: Callable[[ContactState], Array]) -> float:
    """Largest difference over all steps, contacts and nodes, relative to the largest value."""
    pairs = [
        (of(face), of(b.contacts[key])) for a, b in zip(one, other, strict=True) for key, face in a.contacts.items()
    ]
    largest = max(float(np.abs(value).max()) for _, value in pairs)
    return max(float(np.abs(a - b).max()) for a, b in pairs) / (largest or 1.0)


def _loss(cycle: Sequence[StepResult]) -> float:
    return sum(face.dissipation for step in cycle for face in step.contacts.values())
