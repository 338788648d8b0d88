"""What every fuzzer shares: how many examples, and what an answer to any input has to be."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TypeVar

from hypothesis import HealthCheck, settings

from stickslip.geometry.errors import InputError

FEW = 8  # examples of a fuzzer in `make test`
LONG = int(os.environ.get("FUZZ", "0"))  # in `make fuzz`
LONGEST_LINE = 300  # characters
Result = TypeVar("Result")


def fuzzed(share: float = 1.0, least: int = 5) -> settings:
    """Settings of a fuzzer; the examples of `make test` are the same every time.

    Args:
        share: of the number of examples, for inputs that take long.
        least: examples at least.
    """
    return settings(
        max_examples=max(least, round(share * (LONG or FEW))),
        deadline=None,
        derandomize=not LONG,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


def accepted(act: Callable[[], Result]) -> Result | None:
    """Result of `act`, or None if it refuses its input, in one short line. Any other error is a defect."""
    try:
        return act()
    except InputError as error:
        refusal = error
    text = str(refusal)
    assert text
    assert "\n" not in text
    assert len(text) < LONGEST_LINE, text
    assert refusal.exit_code == 2
    return None


def assert_refusal(said: str, code: int = 2) -> None:
    """One line of less than 300 characters."""
    lines = said.splitlines()
    assert lines, code
    assert "Traceback" not in said, said
    assert len(lines) <= 3, said  # notes of the run, which stand above the refusal
    assert all(line.startswith("stickslip: ") for line in lines), said
    assert len(lines[-1]) < 300, said
