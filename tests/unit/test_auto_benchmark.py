"""The benchmark of the choice: a line for each number of steps, a run that was cut short extended by its last steps."""

import numpy as np
import pytest

from stickslip.workflows.lab.benchmarks import auto
from stickslip.workflows.lab.benchmarks.auto import Case, Run


def test_every_method_solves_a_scene_in_few_and_in_many_steps() -> None:
    counts = (2, 4)
    few, many = (auto.row(Case("two_blocks", 6.0, tied=True), count, limit=60.0) for count in counts)
    assert (few.size.steps, many.size.steps) == counts
    for row in (few, many):
        assert {run.status for run in row.runs.values()} == {"converged"}
        assert row.ratio >= 1.0
        assert row.line().split()[0] == "two_blocks"


def test_a_run_that_takes_too_long_is_extended_by_the_second_half_of_its_steps() -> None:
    run = Run(prepared=5.0, steps=(4.0, 3.0, 1.0, 1.0), iterations=(1,) * 4, linear=0, count=32, status=auto.LONG)
    assert run.seconds == pytest.approx(5.0 + 9.0 + 28 * 1.0)


def test_a_run_that_solves_no_step_or_fails_is_never_the_best() -> None:
    run = Run(prepared=5.0, steps=(), iterations=(), linear=0, count=2, status=auto.LONG)
    assert run.seconds == np.inf
    assert Run(5.0, (1.0,), (1,), 0, 2, "the step failed").seconds == np.inf


def test_the_limit_ends_a_run() -> None:
    row = auto.row(Case("cube", 4.0), 2, limit=1e-9)
    assert {(run.status, run.seconds) for run in row.runs.values()} == {(auto.LONG, np.inf)}
    assert np.isnan(row.ratio)
