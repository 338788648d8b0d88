"""What numbers of a contact may be off by although their differences cancel."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.testing import assert_allclose

from stickslip.geometry.arrays import Array
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.accuracy.mesh_error import DISSIPATION, FORCE, PRESSURE, SLIP, by_chance
from stickslip.solvers.results.step_result import OPEN, STICK

WEIGHT = np.array([0.5, 1.0, 1.0, 0.5])


def rows() -> Any:
    """Four nodes on the line y = 0."""
    k = np.arange(4)
    points = np.stack([k, 0.0 * k], axis=1)
    side = Surface("interval", 1, k, k, points, np.stack([k[:-1], k[1:]], axis=1), np.ones(3), False)
    return SimpleNamespace(surface=side, frames=np.tile(-np.eye(2)[::-1], (4, 1, 1)))


def state(pressure: Array, traction: Array | float = 0.0, slip: Array | float = 0.0, status: int = STICK) -> Any:
    along = np.array([1.0, 0.0])
    slips = np.outer(slip + np.zeros(4), along)
    return SimpleNamespace(
        weight=WEIGHT,
        pressure=pressure,
        traction=np.outer(traction + np.zeros(4), along),
        slip=slips,
        slip_increment=slips,
        status=np.full(4, status),
    )


def test_differences_that_cancel_leave_the_root_of_their_squares() -> None:
    own, better = state(np.ones(4)), state(np.array([1.0, 1.2, 0.8, 1.0]))
    found = by_chance(rows(), own, better)
    assert_allclose(found["normal_force"], FORCE * 0.2 * np.sqrt(2))
    assert_allclose(found["force"], [0.0, FORCE * 0.2 * np.sqrt(2)], atol=1e-16)
    assert_allclose(found["max_pressure"], PRESSURE * 0.2)
    assert found["dissipation"] == 0.0


def test_the_largest_values_are_off_by_what_those_around_them_are() -> None:
    own = state(np.array([0.1, 1.0, 0.5, 0.2]), slip=np.array([0.0, 0.0, 0.1, 0.3]))
    better = state(np.array([0.1, 1.0, 0.6, 0.9]), slip=np.array([0.5, 0.0, 0.3, 0.3]))
    found = by_chance(rows(), own, better)
    assert_allclose(found["max_pressure"], PRESSURE * 0.1)  # not .7 of the node farther off
    assert_allclose(found["max_slip"], SLIP * 0.2)


def test_dissipation_counts_work_at_nodes() -> None:
    own, better = state(np.ones(4), 2.0, 0.1), state(np.ones(4), 2.0, np.array([0.1, 0.2, 0.0, 0.1]))
    expected = DISSIPATION * 2.0 * np.hypot(0.1, 0.1)
    assert_allclose(by_chance(rows(), own, better)["dissipation"], expected)


def test_pressure_and_traction_act_together_where_the_side_is_inclined() -> None:
    """The normal (1, -1) / sqrt(2) pushes to the left as much as the traction pulls to the right."""
    inclined = rows()
    inclined.frames[:, 0] = np.array([1.0, -1.0]) / np.sqrt(2)
    better = state(np.array([1.0, 1.0 + np.sqrt(2), 1.0, 1.0]), np.array([0.0, 1.0, 0.0, 0.0]))
    found = by_chance(inclined, state(np.ones(4)), better)
    assert_allclose(found["force"], [0.0, FORCE], atol=1e-15)


def test_what_touches_nowhere_is_off_by_nothing() -> None:
    apart = state(np.zeros(4), slip=np.arange(4.0), status=OPEN)
    found = by_chance(rows(), apart, state(np.zeros(4), slip=np.zeros(4), status=OPEN))
    assert all(np.all(value == 0) for value in found.values())
