"""A smooth solution with compliance and slip: errors fall with the mesh size at the rates of the theory."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from stickslip.workflows.lab.verification.cases import manufactured as manufactured_case
from stickslip.workflows.lab.verification.cases.manufactured import BESIDE, MESHES, SLACK, errors, slopes
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.closed_forms.manufactured import (
    LAMBDA,
    LAWS,
    MU,
    RATES,
    SLIP,
    G,
    Manufactured,
)

METHODS = ("condensed-newton", "uzawa")
SHORT = (8, 16)  # two meshes, past the coarsest
STEP = 1e-6  # of the differences below: their error is of the order of its square, and of rounding over it


def gradient(law: Manufactured, x: float, y: float) -> NDArray[np.float64]:
    """du_i/dx_j (2, 2) by central differences."""
    at = np.array([x, y]) + STEP * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    right, left, up, down = np.stack(law.displacement(*at.T), axis=1)
    return np.stack([right - left, up - down], axis=1) / (2 * STEP)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("x", [0.0, 0.3, 0.7, 1.0])
def test_field_meets_both_laws_on_the_base(law: Manufactured, x: float) -> None:
    du = gradient(law, x, 0.0)
    u_x, u_y = law.displacement(x, 0.0)
    p = law.pressure(x)
    assert_allclose(law.c_n * (-u_y) ** law.m, p, rtol=1e-12)
    assert_allclose(LAMBDA * np.trace(du) + 2 * G * du[1, 1], -p, rtol=1e-8)  # sigma_yy
    assert_allclose(G * (du[0, 1] + du[1, 0]), MU * p, rtol=1e-8)  # pulls back at the body, n = -y
    assert u_x > 0  # all of it has slipped forward
    assert p > 0


@pytest.mark.parametrize("law", LAWS)
def test_field_is_constant_where_it_is_supported(law: Manufactured) -> None:
    along = np.linspace(0, 1, 7)
    u_x, u_y = law.displacement(along, 1.0)
    assert_allclose(u_x, SLIP, rtol=1e-14)
    assert_allclose(u_y, 0, atol=1e-17)
    assert_allclose(law.displacement(0.0, along)[0], SLIP, rtol=1e-14)


@pytest.mark.parametrize("law", LAWS)
def test_slope_of_the_shape_is_its_derivative(law: Manufactured) -> None:
    x = np.linspace(0, 1, 7)
    assert_allclose(law.shape_slope(x), (law.shape(x + STEP) - law.shape(x - STEP)) / (2 * STEP), atol=1e-9)
    assert np.all(law.shape(x) > 0.8)


@pytest.mark.parametrize("order", RATES)
def test_errors_fall_at_the_rates_of_their_order(order: int) -> None:
    assert not failures(manufactured_case.rates("condensed-newton", LAWS[1], order, SHORT))


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("order", RATES)
def test_errors_fall_at_their_rates_over_four_meshes(method: str, law: Manufactured, order: int) -> None:
    assert not failures(manufactured_case.rates(method, law, order))


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("order", "expected"), [(1, (2, 1, 2)), (2, (3, 2, 2.5))])
def test_support_beside_the_base_costs_half_an_order_of_the_pressure_at_order_2(
    law: Manufactured, order: int, expected: tuple[float, ...]
) -> None:
    # the corner's friction is its neighbours': their bound is off by h p', the force by h^2, hence u and p by h^2 along
    # a length h, which is h^2.5 in L2
    found = [errors(law, "condensed-newton", order, n, held=BESIDE) for n in MESHES]
    assert np.all(np.array(slopes(found, MESHES)) > np.array(expected) - SLACK)


def test_no_error_falls_without_friction() -> None:
    checks = manufactured_case.rates("condensed-newton", LAWS[1], 1, SHORT, mu=0.0)
    assert len(failures(checks)) == len(checks)
