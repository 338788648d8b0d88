"""The ready scene `block` sticks in part, whichever method solves it, in two steps or in one."""

from typing import get_args

import pytest

from workflows.verification import block_case
from workflows.verification.block_case import History
from workflows.verification.check import failures

METHODS = ("condensed-newton", "uzawa")
HISTORIES: tuple[History, ...] = get_args(History)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("history", HISTORIES)
def test_base_sticks_in_part(method: str, history: History) -> None:
    assert not failures(block_case.stuck(method, history))


@pytest.mark.parametrize("history", HISTORIES)
def test_both_methods_agree(history: History) -> None:
    # 1e-6 at tolerance 1e-11: the agreed margin between methods; 2e-11 was seen
    assert not failures(block_case.agree(history, "uzawa"))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("history", HISTORIES)
def test_checks_fail_without_friction(method: str, history: History) -> None:
    assert len(failures(block_case.stuck(method, history, mu=0.0))) == 2
