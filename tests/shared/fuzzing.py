"""What every fuzzer shares: how many examples, and what an answer to any input has to be."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import TypeVar

from hypothesis import HealthCheck, settings

from stickslip.geometry.errors import InputError

FEW = 8  # examples of a fuzzer in `make test`
LONG = int(os.environ.get("FUZZ", "0"))  # in `make fuzz`
LONGEST_LINE, LONGEST_TIME = 300, 60.0  # characters, seconds
Result = TypeVar("Result")
EXAMPLES = LONG or 2  # of whole runs, which take long


def fuzzed(share: float = 1.0) -> settings:
    """Settings of a fuzzer; the examples of `make test` are the same every time.

    Args:
        share: of the number of examples, for inputs that take long.
    """
    return settings(
        max_examples=max(5, round(share * (LONG or FEW))),
        deadline=None,
        derandomize=not LONG,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


def accepted(act: Callable[[], Result]) -> Result | None:
    """Result of `act`, or None if it refuses its input: in time, in one short line. Any other error is a defect."""
    began = time.monotonic()
    try:
        return act()
    except InputError as error:
        refusal = error
    finally:
        assert time.monotonic() - began < LONGEST_TIME
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
