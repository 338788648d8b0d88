"""A top driven on a circle drags its base on a smaller one: the friction cone is round, in every frame."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import every_nth
from stickslip.workflows.lab.verification.cases.circular_drive import (
    FRAME_TOLERANCE,
    first_order,
    last_turn,
    steady,
    turned,
)
from stickslip.workflows.lab.verification.check import failures

METHODS = ("condensed-newton", "uzawa")


@pytest.mark.parametrize(("method", "n"), every_nth(2, METHODS, [32, 16]))
def test_third_turn_runs_on_the_polygon_of_implicit_euler(method: str, n: int) -> None:
    # 1e-9 of the polygon: the transient is down to 1e-11; and the tabulated -8.5, -4.2 % against the circle
    assert not failures(steady(method, n))


@pytest.mark.slow
@pytest.mark.parametrize("n", [64, 128])
def test_more_steps_come_as_near_as_tabulated(n: int) -> None:
    assert not failures(steady("condensed-newton", n))


def test_dissipation_is_of_first_order_in_the_step() -> None:
    assert not failures(first_order("condensed-newton", counts=(16, 32)))  # 1.0126, as the polygon's
    assert first_order("condensed-newton", counts=(16, 32))[0].computed > 1  # it comes down to 1


@pytest.mark.slow
def test_dissipation_is_of_first_order_down_to_128_steps_a_turn() -> None:
    assert not failures(first_order("condensed-newton"))


@pytest.mark.parametrize(
    ("method", "degrees"),
    [
        ("condensed-newton", 17),
        pytest.param("uzawa", 17, marks=pytest.mark.slow),
        pytest.param("condensed-newton", 45, marks=pytest.mark.slow),
    ],
)
def test_turning_the_drive_or_the_whole_scene_changes_no_scalar(method: str, degrees: float) -> None:
    # 1e-10, the project's rule for isotropy: nothing but directions differ
    assert not failures(turned(method, 16, np.radians(degrees)))


def test_both_methods_end_on_the_same_turn() -> None:
    a, b = (last_turn(method, 16) for method in METHODS)
    # both at tolerance 1e-12 per step, 16 steps
    assert_allclose((a.face_radius, a.lag, a.dissipation), (b.face_radius, b.lag, b.dissipation), rtol=FRAME_TOLERANCE)


@pytest.mark.parametrize("method", METHODS)
def test_checks_fail_without_friction(method: str) -> None:
    checks = [check for check in steady(method, 16, mu=0.0) if "work that" not in check.name]
    assert len(failures(checks)) == len(checks)  # the base follows its top: radius A, no lag, no dissipation
