"""One number of a verification problem: computed value, reference, tolerance.

Cyclic histories: every cycle after the second repeats the second one, and the energy balance closes.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from stickslip.geometry.arrays import Array
from stickslip.solvers.results.step_result import ContactState, StepResult


@dataclass(frozen=True)
class Check:
    """A number and its reference; it passes if the deviation is at most the tolerance. NaN never passes.

    >>> Check("pressure [Pa]", 9.9, 10.0, 0.02, relative=True).passed
    True
    >>> Check("pressure [Pa]", float("nan"), 10.0, 0.02, relative=True).passed
    False
    """

    name: str  # quantity, unit and place
    computed: float
    reference: float
    tolerance: float
    relative: bool  # whether deviation and tolerance are relative to the reference

    def __post_init__(self) -> None:
        if self.relative and self.reference == 0:
            raise ValueError(f"{self.name}: a deviation from 0 cannot be relative")

    @property
    def deviation(self) -> float:
        """Distance from the reference, in its unit or relative to it."""
        return abs(self.computed - self.reference) / (abs(self.reference) if self.relative else 1.0)

    @property
    def passed(self) -> bool:
        return bool(self.deviation <= self.tolerance)

    def __str__(self) -> str:
        kind = "relative" if self.relative else "absolute"
        return (
            f"{self.name}: {self.computed:.10g}, expected {self.reference:.10g}; "
            f"{kind} deviation {self.deviation:.1e}, allowed {self.tolerance:.1e}"
        )


TWO = ("condensed-newton", "uzawa")
METHODS = (*TWO, "surface-uzawa")  # surface-uzawa where it does not take minutes
ONE = ("condensed-newton",)  # where there is little contact, or none
FLOATING = ("condensed-newton", "surface-uzawa")  # where contact alone holds the bodies


@dataclass(frozen=True, kw_only=True)
class Case:
    """A verification problem; `checks` solves it with a method."""

    about: str
    checks: Callable[[str], list[Check]]
    methods: tuple[str, ...] = METHODS
    slow: tuple[str, ...] = ()  # methods that take more than some seconds


PROBLEMS: dict[str, Case] = {}
Checks = TypeVar("Checks", bound=Callable[..., list[Check]])


def problem(about: str, methods: tuple[str, ...] = METHODS, slow: tuple[str, ...] = ()) -> Callable[[Checks], Checks]:
    """Enter a function in PROBLEMS by its own name, or by that of its file if it is called `checks`."""

    def enter(checks: Checks) -> Checks:
        name = checks.__module__.rpartition(".")[2] if checks.__name__ == "checks" else checks.__name__
        PROBLEMS[name] = Case(about=about, checks=checks, methods=methods, slow=slow)
        return checks

    return enter


def close(name: str, computed: float, reference: float, tolerance: float, scale: float) -> Check:
    """Relative to the reference, or to `scale` where the reference is 0.

    >>> close("slip [m]", 1e-12, 0.0, 1e-9, scale=0.01).passed
    True
    """
    if reference == 0:
        return Check(name, float(computed), 0.0, tolerance * scale, relative=False)
    return Check(name, float(computed), float(reference), tolerance, relative=True)


def within(name: str, computed: float, low: float, high: float) -> Check:
    """A number of which only a lower and an upper limit are known.

    >>> within("iterations", 11, 0, 10).passed
    False
    >>> within("share", 0.3, 0.2, 0.5).passed
    True
    """
    return Check(name, float(computed), (low + high) / 2, (high - low) / 2, relative=False)


def worst(checks: Iterable[Check]) -> list[Check]:
    """For each quantity (the end of a check's name) the check that failed or is nearest to failing.

    >>> pressures = [Check(f"step {k}: pressure [Pa]", 10.0 + k, 10.0, 5.0, relative=False) for k in range(4)]
    >>> [check.name for check in worst([*pressures, Check("step 1: gap [m]", 0.0, 0.0, 0.1, relative=False)])]
    ['step 3: pressure [Pa]', 'step 1: gap [m]']
    """
    found: dict[str, Check] = {}
    for check in checks:
        quantity = check.name.rpartition(": ")[2]
        if quantity not in found or _nearness(check) > _nearness(found[quantity]):
            found[quantity] = check
    return list(found.values())


def _nearness(check: Check) -> tuple[bool, float]:
    return not check.passed, check.deviation / check.tolerance if check.tolerance else check.deviation


def farthest(values: Array, reference: float) -> float:
    """The value that is farthest from the reference: a field that must be uniform is checked by its worst point.

    >>> farthest(np.array([1.0, 1.2, 0.9]), 1.0)
    1.2
    """
    return float(values[np.argmax(np.abs(values - reference))])


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
