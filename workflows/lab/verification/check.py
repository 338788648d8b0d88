"""One number of a verification problem: computed value, reference, tolerance."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from stickslip.geometry.arrays import Array


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


def failures(checks: Iterable[Check]) -> list[str]:
    """A sentence for each check that does not pass; raises if there is nothing to check.

    >>> failures([Check("force [N]", 2.0, 1.0, 0.1, relative=False)])
    ['force [N]: 2, expected 1; absolute deviation 1.0e+00, allowed 1.0e-01']
    """
    all_checks = list(checks)
    if not all_checks:
        raise ValueError("nothing was checked")
    return [str(check) for check in all_checks if not check.passed]


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
