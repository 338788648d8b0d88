"""The closed forms agree with the tabulated figures, and with what they were derived from by another way."""

import itertools
from decimal import Decimal, localcontext

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.workflows.lab.verification.closed_forms import circular_drive, column, raous, sheared_column


def exact_penetration(stiffness: float, excess: float, c_n: float, m: int) -> float:
    """Bisection with 50 digits: knows nothing of Newton, of scaling, or of rounding."""
    with localcontext() as context:
        context.prec = 50
        k, e, c = Decimal(stiffness), Decimal(excess), Decimal(c_n)
        low, high = Decimal(0), e
        for _ in range(120):  # 2^-120 = 1e-36
            middle = (low + high) / 2
            low, high = (middle, high) if c * middle**m < k * (e - middle) else (low, middle)
        return float(low)


# --- column on a compliant foundation


@pytest.mark.parametrize("case", column.TABLE)
def test_column_gives_the_tabulated_states(case: column.ColumnCase) -> None:
    M = column.constrained_modulus(case.E, case.nu)
    state = column.driven_by_displacement(M=M, U=case.U, g=case.g, c_n=case.c_n, m=case.m)
    rounding = 0.5 * 10.0 ** (1 - case.digits)  # half a unit of the last digit, for a leading 1
    assert_allclose([state.displacement, state.pressure], [case.d, case.p], rtol=rounding)


def test_constrained_modulus_of_the_table() -> None:
    assert_allclose(column.constrained_modulus(1000.0, 0.3), 1346.1538, rtol=5e-8)


@pytest.mark.parametrize("m", [1, 2, 3])
@pytest.mark.parametrize("c_n", [1e-3, 1.0, 1e4, 1e8, 1e16])
@pytest.mark.parametrize("relative", [1e-12, 1e-6, 1e-3, 4.0])
def test_penetration_keeps_all_digits_from_grazing_to_deep(m: int, c_n: float, relative: float) -> None:
    excess = 0.002 * relative
    x = column.penetration(stiffness=1346.0, excess=excess, c_n=c_n, m=m)
    assert_allclose(x, exact_penetration(1346.0, excess, c_n, m), rtol=1e-14)


@pytest.mark.parametrize("m", [1, 2, 3])
def test_grazing_column_answers_for_the_numbers_as_given(m: int) -> None:
    M, g, c_n = column.constrained_modulus(1000.0, 0.3), 0.002, 1e4
    for U in (g, g * (1 - 1e-9)):
        untouched = column.driven_by_displacement(M=M, U=U, g=g, c_n=c_n, m=m)
        assert (untouched.pressure, untouched.displacement) == (0.0, U)
    U = g * (1 + 1e-6)
    touching = column.driven_by_displacement(M=M, U=U, g=g, c_n=c_n, m=m)
    assert_allclose(touching.penetration, exact_penetration(M, U - g, c_n, m), rtol=1e-12)


@pytest.mark.parametrize("m", [1.0, 1.5, 2.0, 2.7, 3.0])
def test_column_balances_and_yields_more_the_harder_it_is_pressed(m: float) -> None:
    M, g, c_n, height = 1346.0, -0.002, 1e4, 2.0
    tops = np.linspace(-0.0019, 0.02, 50)
    states = [column.driven_by_displacement(M=M, U=float(U), g=g, c_n=c_n, m=m, height=height) for U in tops]
    d = np.array([state.displacement for state in states])
    p = np.array([state.pressure for state in states])
    # U - d loses digits against U when the foundation is soft: the bound is absolute
    assert_allclose(M * (tops - d) / height, p, rtol=1e-12, atol=1e-13 * M)
    assert np.all(np.diff(d) > 0)
    assert np.all(np.diff(p) > 0)
    assert np.all(d > g)
    assert np.all(d < tops)


@pytest.mark.parametrize("m", [1.0, 1.5, 2.7, 3.0])
def test_force_and_displacement_drive_reach_the_same_state(m: float) -> None:
    M, g, c_n = 1346.0, 0.002, 1e6
    forced = column.driven_by_force(p=7.0, g=g, c_n=c_n, m=m)
    U = forced.displacement + 7.0 / M
    driven = column.driven_by_displacement(M=M, U=U, g=g, c_n=c_n, m=m)
    assert_allclose(driven.displacement, forced.displacement, rtol=1e-12)
    assert_allclose(driven.pressure, 7.0, rtol=1e-9)  # m = 1: d - g = 7e-6, U is rounded at 1e-18


def test_column_refuses_what_has_no_answer() -> None:
    with pytest.raises(ValueError, match=r"m = 0\.5: the compliance exponent"):
        column.penetration(stiffness=1.0, excess=1.0, c_n=1.0, m=0.5)
    with pytest.raises(ValueError, match=r"c_n = 0\.0: both must be positive"):
        column.penetration(stiffness=1.0, excess=1.0, c_n=0.0, m=1)
    with pytest.raises(ValueError, match=r"p = -1\.0 Pa"):
        column.driven_by_force(p=-1.0, g=0.0, c_n=1.0, m=1)


# --- sheared column


def test_sheared_column_gives_the_tabulated_states() -> None:
    history = sheared_column.drive(sheared_column.COLUMN, sheared_column.TOP)
    table = sheared_column.TABLE
    assert_allclose(history.tau, table.tau, rtol=1e-13)
    assert_allclose(history.slip, table.slip, atol=1e-16)
    assert_allclose(history.dissipation, table.dissipation, atol=1e-15)


@pytest.mark.parametrize("k_T", [np.inf, 800.0])
def test_work_of_the_top_is_stored_or_dissipated(k_T: float) -> None:
    tall = sheared_column.ShearedColumn(G=1000.0, bound=3.0, height=2.0, k_T=k_T)
    corners = np.concatenate([[0.0], sheared_column.TOP])
    top = np.concatenate([np.linspace(a, b, 10001)[1:] for a, b in itertools.pairwise(corners)])
    history = sheared_column.drive(tall, top)
    V, tau = np.concatenate([[0.0], top]), np.concatenate([[0.0], history.tau])
    work = np.sum(0.5 * (tau[1:] + tau[:-1]) * np.diff(V))
    stored = 0.5 * tau[-1] ** 2 * (tall.height / tall.G + 1 / k_T)  # column and base, springs in series
    assert stored > 0
    # trapezoids: exact but for the steps where slip begins, each 1e-3 of a stroke
    assert_allclose(work, history.dissipation[-1] + stored, rtol=1e-6)


def test_step_size_does_not_matter_and_cycles_repeat() -> None:
    cycle = np.array([0.01, -0.01])
    history = sheared_column.drive(sheared_column.COLUMN, np.tile(cycle, 6))
    loops = np.diff(history.dissipation[::2])
    assert_allclose(loops, 4 * 3.0 * 0.007, rtol=1e-13)  # loop area = 4 s (A - s H / G)
    fine = np.concatenate([np.linspace(0, 0.01, 8)[1:], np.linspace(0.01, -0.01, 38)[1:]])
    end = sheared_column.drive(sheared_column.COLUMN, fine)
    assert_allclose(end.dissipation[-1], history.dissipation[1], rtol=1e-13)


# --- circular drive


def figures(turn: circular_drive.SteadyTurn) -> tuple[float, float, float]:
    return turn.face_radius, turn.lag, turn.dissipation


def test_circular_drive_gives_the_tabulated_steady_state() -> None:
    exact = circular_drive.steady(circular_drive.DRIVE)
    assert_allclose(figures(exact), figures(circular_drive.STEADY), rtol=1.5e-7)  # 7 digits


@pytest.mark.parametrize(("n", "error"), circular_drive.DISSIPATION_ERROR.items())
def test_implicit_euler_dissipates_too_little_by_the_tabulated_error(n: int, error: float) -> None:
    exact = circular_drive.steady(circular_drive.DRIVE)
    marched = circular_drive.march(circular_drive.DRIVE, n)
    assert_allclose(marched.dissipation / exact.dissipation - 1, error, atol=0.0005)  # one decimal of a %
    # the tabulated error is not the radius' nor the lag's, at least where the four differ most
    if n == 16:
        assert_allclose(marched.face_radius / exact.face_radius - 1, -0.0792, atol=5e-5)
        assert_allclose(marched.lag / exact.lag - 1, -0.0203, atol=5e-5)


@pytest.mark.parametrize("n", [3, 8, 16, 128])
@pytest.mark.parametrize("start", [0.0, np.radians(17), np.radians(45)])
def test_marching_ends_on_the_polygon_in_any_frame(n: int, start: float) -> None:
    marched = circular_drive.march(circular_drive.DRIVE, n, start=start)
    polygon = circular_drive.steady_polygon(circular_drive.DRIVE, n)
    assert_allclose(figures(marched), figures(polygon), rtol=1e-10)


def test_dissipation_is_the_work_of_the_top_over_a_turn_and_the_first_order_limit_of_the_polygon() -> None:
    drive = circular_drive.CircularDrive(G=300.0, bound=2.0, radius=0.03, height=1.5)
    exact = circular_drive.steady(drive)
    # tau has the constant component s cos(lag) along the path of the top: nothing is stored over a turn
    assert_allclose(exact.dissipation, 2 * np.pi * drive.radius * 2.0 * np.cos(exact.lag))
    polygons = [circular_drive.steady_polygon(drive, n) for n in (1000, 2000, 4000)]
    errors = np.array([polygon.dissipation / exact.dissipation - 1 for polygon in polygons])
    assert_allclose(errors[:-1] / errors[1:], 2, rtol=1e-2)  # first order


def test_circular_drive_refuses_a_base_that_never_slips() -> None:
    with pytest.raises(ValueError, match="never slips"):
        circular_drive.CircularDrive(G=100.0, bound=3.0, radius=0.03)
    with pytest.raises(ValueError, match="n = 2"):
        circular_drive.steady_polygon(circular_drive.DRIVE, 2)
    with pytest.raises(RuntimeError, match="no steady state after 1 turns"):
        circular_drive.march(circular_drive.DRIVE, 16, max_turns=1)


# --- block of Raous, Chabrand and Lebon


def test_raous_columns_agree_with_one_another() -> None:
    for u_x in (raous.U_X_PUBLISHED, raous.U_X_CONVERGED, raous.U_X_P1_32):
        assert u_x.shape == raous.X.shape
        assert np.all(np.diff(u_x) < 0)  # the pushed side moves most
    # linear triangles come out stiffer, by less than 0.4 % on this mesh
    stiffer = raous.U_X_P1_32 / raous.U_X_CONVERGED - 1
    assert np.all(stiffer < 0)
    assert np.all(stiffer > -0.004)
    # the published values are rounded to 3 digits, and 2.7 % low at the last sample
    assert_allclose(raous.U_X_PUBLISHED[:-1], raous.U_X_CONVERGED[:-1], rtol=0.0035)
    assert_allclose(raous.U_X_PUBLISHED[-1] / raous.U_X_CONVERGED[-1] - 1, -0.0266, atol=5e-5)


def test_raous_forces_balance_and_lie_in_the_cone() -> None:
    assert_allclose(raous.F_N, raous.TOP_PRESSURE * raous.SIDE, rtol=1e-12)
    assert 0 < raous.F_T < raous.MU * raous.F_N  # part of the face sticks
    assert raous.F_T < raous.SIDE_PRESSURE * raous.SIDE  # the wall x = 0.04 carries the rest


def test_raous_face_opens_then_slips_then_sticks() -> None:
    states = [raous.state(x) for x in (0.0, 0.00339, 0.00341, 0.02979, 0.02981, raous.SIDE)]
    assert states == ["open", "open", "slip", "slip", "stick", "stick"]
    with pytest.raises(ValueError, match=r"the block reaches from 0 to 0\.04 m"):
        raous.state(0.05)


def test_raous_dissipation_is_the_sum_over_the_ramp() -> None:
    for n in (1, 5, 20):
        steps = sum((k / n) * (1 / n) for k in range(1, n + 1))  # traction k/n times slip 1/n
        assert_allclose(raous.dissipation(n), raous.dissipation(1) * steps, rtol=1e-13)
    assert raous.dissipation(1) == 2 * raous.DISSIPATION_LIMIT
    # no more than all the friction along the largest slip
    assert raous.dissipation(1) < raous.F_T * raous.U_X_CONVERGED[0]
    with pytest.raises(ValueError, match="n = 0"):
        raous.dissipation(0)


def test_raous_compliance_shift_falls_as_the_compliance_does() -> None:
    shifts = np.array([case.shift for case in raous.COMPLIANCE_SHIFTS])
    stiffness = np.array([case.k for case in raous.COMPLIANCE_SHIFTS])
    assert np.all(shifts < 0)
    assert np.all(np.diff(shifts) > 0)
    assert_allclose((stiffness * shifts)[:3], -0.43, rtol=0.08)  # as 1 / k, to the digits given
    for case in raous.COMPLIANCE_SHIFTS:
        if case.k > 1000:
            assert abs(case.shift) + case.tolerance <= 0.001 * (1 + 1e-12)
