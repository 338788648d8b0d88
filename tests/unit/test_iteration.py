"""The driver of all iterations: how they end, what it writes down, and which iterate is the best."""

from collections.abc import Iterator

import numpy as np
import pytest

from stickslip.solvers.iteration import Driver, Iterate, Stall, Status, Step
from stickslip.solvers.parallel.counters import Counters


def yielding(*residuals: float) -> Iterator[Iterate]:
    return (Iterate(k, residual, np.array([float(k)])) for k, residual in enumerate(residuals))


@pytest.mark.parametrize(
    ("residuals", "status", "rows"),
    [
        ((1.0, 0.5, 0.1, 0.0), Status.CONVERGED, 3),  # as small as is asked for is enough
        ((1.0, np.nan, 0.0), Status.NOT_FINITE, 2),
        ((1.0, np.inf, 0.0), Status.NOT_FINITE, 2),
        ((1.0, 0.9, 0.8, 0.7, 0.0), Status.STALLED, 4),
        ((1.0, 0.9, 0.4, 0.3, 0.3, 0.1), Status.MAX_IT, 6),
        ((1.0, 0.9), Status.NO_HOLD, 2),  # the method goes no further
    ],
)
def test_an_iteration_ends_by_name(residuals: tuple[float, ...], status: Status, rows: int) -> None:
    told: list[Step] = []
    driver = Driver(Counters(volume_solves=7), 0.1 if status is Status.CONVERGED else 0.0, 5, told.append)
    found = driver.run(yielding(*residuals), Stall(2))
    assert (found.status, len(found.history)) == (status, rows)
    assert found.history == tuple(told) == tuple(driver.history)
    assert told[-1].volume_solves == 7
    assert found.p[0] == rows - 1  # the last one
    assert driver.stalled is (status is Status.STALLED)
    assert driver.over is (status in (Status.CONVERGED, Status.MAX_IT))


def test_a_method_may_say_itself_that_it_is_enough_or_that_a_residual_is_not_known() -> None:
    driver = Driver(Counters(), 0.5, 9)
    known = [Iterate(1, 0.1, enough=False), Iterate(2, 0.9, enough=True), Iterate(3, 0.0)]
    assert driver.run([Iterate(0, np.inf, known=False), *known]).history[-1].iteration == 2
    found = Driver(Counters(), 0.0, 9).run(yielding(1.0, 1.0, 1.0), slow=lambda k, residual: k == 1)
    assert (found.status, found.iterations) == (Status.SLOW, 1)


def test_runs_share_history_and_the_best_iterate() -> None:
    driver = Driver(Counters(), 0.0, 9)
    for residuals in ((np.nan,), (0.3, 0.1), (0.1, 0.4), (np.nan,)):  # of equal ones the first, and NaN is worst
        driver.run(yielding(*residuals), otherwise=Status.STALLED)
    assert [step.residual for step in driver.history[1:5]] == [0.3, 0.1, 0.1, 0.4]
    assert driver.best is not None
    assert (driver.best.p[0], driver.best.status, driver.best.history) == (1.0, Status.STALLED, ())
    driver.run([Iterate(9, 0.2)])
    assert (driver.best.p[0], driver.best.status) == (1.0, Status.MAX_IT)  # type: ignore[comparison-overlap]
