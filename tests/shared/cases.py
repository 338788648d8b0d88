"""Cases of a test that always run; the others go the same ways through the code, and run in `make verify`."""

from collections.abc import Collection, Iterable
from itertools import product
from typing import Any

import pytest


def slow(*cases: Any) -> list[Any]:
    """Cases that run when there is time."""
    return [pytest.param(case, marks=pytest.mark.slow) for case in cases]


def often(cases: Iterable[Any], kept: Collection[Any]) -> list[Any]:
    """All cases in their order, of which those that are kept always run."""
    return [case if case in kept else slow(case)[0] for case in cases]


def every_nth(n: int, *lists: Iterable[Any]) -> list[Any]:
    """Rows of all combinations, of which every n-th always runs: diagonals, so that each value has its turn.

    That needs another list of at least n cases; a single list with a period, as of slave and master by turns, needs an
    n that has no divisor in common with it.
    """
    return [
        pytest.param(*(value for _, value in row), marks=[pytest.mark.slow] * (sum(k for k, _ in row) % n > 0))
        for row in product(*map(enumerate, lists))
    ]
