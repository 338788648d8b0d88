"""The closed forms agree with the tabulated figures, and with what they were derived from by another way."""

import itertools
from decimal import Decimal, localcontext

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.integrate import dblquad, quad
from scipy.optimize import lsq_linear
from scipy.special import ellipe, ellipk

from stickslip.geometry.arrays import Array
from stickslip.workflows.lab.verification.cases import (
    circular_drive,
    column,
    hertz,
    incline,
    punch,
    raous,
    shear_lag,
    sheared_column,
    shrink_fit,
)
from stickslip.workflows.lab.verification.cases.bearing import ellipse
from stickslip.workflows.lab.verification.cases.incline import HOLDS, LAYER, SLIDES
from stickslip.workflows.lab.verification.cases.limits import NONE, STEADY, Limit
from stickslip.workflows.lab.verification.cases.manufactured import LAMBDA, LAWS, MU, SLIP, G, Manufactured
from stickslip.workflows.lab.verification.cases.press_fit import HUB as PRESSED_HUB
from stickslip.workflows.lab.verification.cases.press_fit import SHAFT as PRESSED_SHAFT
from stickslip.workflows.lab.verification.cases.press_fit import pressure
from stickslip.workflows.lab.verification.cases.shear_lag import FORCE, STRIP
from stickslip.workflows.lab.verification.cases.shrink_fit import HUB, INNER, JOINT, OUTER, SHAFT, RingMaterial


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


def march(
    drive: circular_drive.CircularDrive, n: int, start: float = 0.0, turns: int = 1000
) -> circular_drive.SteadyTurn:
    """Take n implicit Euler steps a turn until a turn repeats the one before, the top at an angle at first."""
    angles = start + 2 * np.pi * np.arange(1, n + 1) / n
    turn = drive.radius * np.column_stack([np.cos(angles), np.sin(angles)])
    path = np.tile(turn, (turns, 1))
    _, slip, work = sheared_column.follow(drive.G / drive.height, np.full(len(path), drive.bound), path)
    losses = np.diff(work[n - 1 :: n])
    k = int(np.argmax(np.abs(np.diff(losses)) <= 1e-13 * losses[1:]))
    (w_x, w_y), (V_x, V_y) = w, V = slip[(k + 3) * n - 1], turn[-1]
    lag = float(np.arctan2(w_x * V_y - w_y * V_x, w @ V))
    return circular_drive.SteadyTurn(face_radius=float(np.linalg.norm(w)), lag=lag, dissipation=float(losses[k + 1]))


def test_circular_drive_gives_the_tabulated_steady_state() -> None:
    exact = circular_drive.steady(circular_drive.DRIVE)
    assert_allclose(figures(exact), figures(circular_drive.STEADY), rtol=1.5e-7)  # 7 digits


@pytest.mark.parametrize(("n", "error"), circular_drive.DISSIPATION_ERROR.items())
def test_implicit_euler_dissipates_too_little_by_the_tabulated_error(n: int, error: float) -> None:
    exact = circular_drive.steady(circular_drive.DRIVE)
    marched = march(circular_drive.DRIVE, n)
    assert_allclose(marched.dissipation / exact.dissipation - 1, error, atol=0.0005)  # one decimal of a %
    # the tabulated error is not the radius' nor the lag's, at least where the four differ most
    if n == 16:
        assert_allclose(marched.face_radius / exact.face_radius - 1, -0.0792, atol=5e-5)
        assert_allclose(marched.lag / exact.lag - 1, -0.0203, atol=5e-5)


@pytest.mark.parametrize("n", [3, 8, 16, 128])
@pytest.mark.parametrize("start", [0.0, np.radians(17), np.radians(45)])
def test_marching_ends_on_the_polygon_in_any_frame(n: int, start: float) -> None:
    marched = march(circular_drive.DRIVE, n, start=start)
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
    stiffness, shifts = np.array(list(raous.COMPLIANCE_SHIFTS.items())).T
    assert np.all(shifts < 0)
    assert np.all(np.diff(shifts) > 0)
    assert_allclose((stiffness * shifts)[:3], -0.43, rtol=0.08)  # as 1 / k, to the digits given


# --- punch


def test_punch_gives_the_tabulated_tractions() -> None:
    half_a_digit = 0.5e-5
    p, q = punch.bonded(punch.X, punch.NU)
    assert_allclose(punch.frictionless(punch.X), [0.31831, 0.36755, 0.73025], atol=half_a_digit)
    assert_allclose(p, [0.33216, 0.38152, 0.73329], atol=half_a_digit)
    assert_allclose(q, [0.0, 0.03935, 0.20725], atol=half_a_digit)


def hilbert(size: Array, t: Array, at: int) -> float:
    """PV∫ f(s) / (x - s) ds over the contact, x = tanh(t[at]), from values `size` = f(tanh t) / cosh(t).

    In t the integrand is size cosh(t_x) / sinh(t_x - t): analytic, decaying, and singular halfway between the nodes
    used, where the trapezoidal rule converges exponentially.
    """
    odd = np.arange(len(t)) % 2 != at % 2
    h = t[1] - t[0]
    return float(np.cosh(t[at]) * np.sum(size[odd] / np.sinh(t[at] - t[odd])) * 2 * h)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.4999])
def test_bonded_surface_is_flat_and_not_stretched(nu: float) -> None:
    t = np.arange(-2400, 2401) / 80  # cosh(30) = 5e12: the rest of the tractions is beyond rounding
    x = np.tanh(t)
    P, eps = 2.0, punch.oscillation(nu)
    near = np.abs(t) < 8  # closer to the edge 1 - x has no digits left
    p, q = punch.bonded(x[near], nu, P=P)
    exact = P * np.cosh(np.pi * eps) / np.pi * np.cosh(t[near])
    assert_allclose(
        [p, q], [exact * np.cos(2 * eps * t[near]), exact * np.sin(2 * eps * t[near])], rtol=1e-7, atol=1e-9
    )
    size_p, size_q = (P * np.cosh(np.pi * eps) / np.pi * f(2 * eps * t) for f in (np.cos, np.sin))
    assert_allclose(np.sum(size_p / np.cosh(t)) * (t[1] - t[0]), P, rtol=1e-12)  # dx = dt / cosh²
    beta = (1 - 2 * nu) / (2 * (1 - nu))
    for at in (2400, 2440, 2360, 2563):
        stretched = -hilbert(size_q, t, at) / np.pi - beta * size_p[at] * np.cosh(t[at])
        tilted = -hilbert(size_p, t, at) / np.pi + beta * size_q[at] * np.cosh(t[at])
        assert_allclose([stretched, tilted], 0, atol=1e-10 * np.cosh(t[at]))


def test_incompressible_bonded_punch_is_the_frictionless_one() -> None:
    p, q = punch.bonded(punch.X, 0.5)
    assert_allclose(p, punch.frictionless(punch.X), rtol=1e-14)
    assert not q.any()


def stick_half_width(mu: float, nu: float, n: int) -> float:
    """Boundary elements of constant traction on a half-plane, a = 1: sticking and slipping ones are told apart anew
    until none changes sides.

    Surface displacements are the module's derivatives, integrated; slip is towards the middle, so q is outward.
    """
    ends = np.sin(np.linspace(-np.pi / 2, np.pi / 2, n + 1))
    x, h = (ends[1:] + ends[:-1]) / 2, np.diff(ends)
    logarithm = [d * np.log(np.abs(d)) - d for d in (x[:, None] - ends[:-1], x[:, None] - ends[1:])]
    G = (logarithm[0] - logarithm[1]) / np.pi
    S = (1 - 2 * nu) / (2 * (1 - nu)) * np.sign(x[:, None] - x) * h / 2
    across = np.hstack([-S, -G])  # p and q to u_x / k
    slips = np.zeros(n, bool)
    for _ in range(50):
        matrix, right = np.zeros((2 * n + 1, 2 * n + 1)), np.eye(2 * n + 1)[-1]
        matrix[:n] = np.hstack([-G, S, -np.ones((n, 1))])  # the punch goes down as a whole
        matrix[n:-1, :-1][~slips] = across[~slips]
        rubs = np.flatnonzero(slips)
        matrix[n + rubs, n + rubs], matrix[n + rubs, rubs] = 1.0, -mu * np.sign(x[rubs])
        matrix[-1, :n] = h  # P = 1
        found = np.linalg.solve(matrix, right)
        p, q, moved = found[:n], found[n:-1], across @ found[:-1]
        before, slips = slips, np.where(slips, moved * np.sign(x) < 0, np.abs(q) > mu * p)
        if np.array_equal(slips, before):
            return float(h[~slips].sum() / 2)
    raise AssertionError("stick and slip do not settle")


@pytest.mark.parametrize(("mu", "width"), punch.STICK.items())
def test_boundary_elements_stick_over_the_tabulated_widths(mu: float, width: float) -> None:
    # 201, 401, 801 elements: .0391, .0352, .0373 at mu = .1; .3591, .3636, .3622 at .2; .6875, .6917, .6910 at .3;
    # .9415, .9412, .9410 at .5
    assert abs(stick_half_width(mu, punch.NU, 201) - width) < punch.STICK_DIGITS


# --- Hertz


def test_hertz_gives_the_tabulated_sphere() -> None:
    contact = hertz.sphere(60 * np.pi, 8.0, hertz.plane_strain(1000.0, 0.3))
    assert_allclose(contact.a, 1.009635, atol=0.5e-6)
    assert_allclose(contact.p0, 88.2904, atol=0.5e-4)
    assert_allclose(hertz.approach(contact, 8.0), 0.127420, atol=0.5e-6)


def test_sphere_fits_the_half_space_and_carries_its_force() -> None:
    F, R, E_star = 7.0, 3.0, 50.0
    contact = hertz.sphere(F, R, E_star)
    a = contact.a

    def sunk(r: float) -> float:
        """Boussinesq: rings of pressure."""

        def ring(s: float) -> float:
            return float(
                4
                * s
                * hertz.Hertz(a=a, p0=contact.p0).pressure(np.array(s))
                / (s + r)
                * ellipk(4 * s * r / (s + r) ** 2)
            )

        return quad(ring, 0, r, limit=200)[0] / (np.pi * E_star) + quad(ring, r, a, limit=200)[0] / (np.pi * E_star)

    radii = np.array([0.1, 0.5, 0.9]) * a
    assert_allclose([sunk(r) for r in radii], hertz.approach(contact, R) - radii**2 / (2 * R), rtol=1e-7)
    assert_allclose(quad(lambda r: 2 * np.pi * r * contact.pressure(np.array(r)), 0, a)[0], F, rtol=1e-8)


def test_cylinder_fits_the_half_plane_and_carries_its_force() -> None:
    P, R, E_star, n = 7.0, 3.0, 50.0, 64
    contact = hertz.cylinder(P, R, E_star)
    # Gauss-Chebyshev of the second kind, exact for the singular integral at the points between its own
    nodes, between = (
        np.cos(np.arange(1, n + 1) * np.pi / (n + 1)),
        np.cos((np.arange(1, n + 2) - 0.5) * np.pi / (n + 1)),
    )
    weights = np.pi / (n + 1) * (1 - nodes**2)
    smooth = contact.pressure(contact.a * nodes) / np.sqrt(1 - nodes**2)
    assert_allclose(contact.a * np.sum(weights * smooth), P, rtol=1e-13)
    slope = -2 / (np.pi * E_star) * np.sum(weights * smooth / (between[:, None] - nodes), axis=1)
    assert_allclose(slope, -contact.a * between / R, atol=1e-12)


def test_shrink_fit_gives_the_tabulated_figures() -> None:
    fit = shrink_fit.fit()
    assert_allclose([fit.p, fit.u_in, fit.u_out], [15.0905433, -1.700201e-4, 8.299799e-4], rtol=3e-7)  # their digits


@pytest.mark.parametrize(("law", "p"), shrink_fit.COMPLIANT.items())
def test_compliant_shrink_fit_gives_the_tabulated_figures(law: tuple[float, float], p: float) -> None:
    assert_allclose(shrink_fit.fit(c_n=law[0], m=law[1]).p, p, rtol=5e-9)


@pytest.mark.parametrize(("material", "free"), [(SHAFT, INNER), (HUB, OUTER)])
def test_ring_gives_way_as_the_differential_equation_of_the_radius_says(material: RingMaterial, free: float) -> None:
    # u = A r + B / r; sigma_rr = c (A - (1 - 2 nu) B / r^2) is -1 at the joint, 0 where it is free
    nu, c = material.nu, material.E / ((1 + material.nu) * (1 - 2 * material.nu))
    system = [[c, -c * (1 - 2 * nu) / r**2] for r in (JOINT, free)]
    A, B = np.linalg.solve(system, [-1.0, 0.0])
    assert_allclose(shrink_fit.give(material, JOINT, free), abs(A * JOINT + B / JOINT), rtol=1e-13)


def test_stiffer_interface_tends_to_one_that_does_not_give() -> None:
    rigid = shrink_fit.fit().p
    errors = [rigid - shrink_fit.fit(c_n=c_n).p for c_n in (1e8, 1e9)]
    assert_allclose(errors[0] / errors[1], 10.0, rtol=1e-2)  # first order in 1 / c_n


def test_rings_drawn_too_large_tend_to_rings_that_fit() -> None:
    off = [shrink_fit.drawn_too_large(d)[1].p / d - shrink_fit.fit(d).p / d for d in (1e-3, 1e-4)]
    assert_allclose(off[0] / off[1], 10.0, rtol=1e-2)


def test_hub_is_in_equilibrium_and_strained_as_its_stresses_say() -> None:
    r, h = np.linspace(PRESSED_HUB.bore, PRESSED_HUB.outer, 9)[1:-1], 1e-6
    radial, hoop = PRESSED_HUB.stresses(r, 1e6)
    up, down = PRESSED_HUB.stresses(r + h, 1e6)[0], PRESSED_HUB.stresses(r - h, 1e6)[0]
    assert_allclose((up - down) / (2 * h), (hoop - radial) / r, rtol=1e-6)
    below, u, above = (PRESSED_HUB.displacement(at, 1e6) for at in (r - h, r, r + h))
    slope = (above - below) / (2 * h)
    assert_allclose(u / r, (hoop - PRESSED_HUB.nu * radial) / PRESSED_HUB.E, rtol=1e-12)
    assert_allclose(slope, (radial - PRESSED_HUB.nu * hoop) / PRESSED_HUB.E, rtol=1e-6, atol=1e-12)
    ends = np.array([PRESSED_HUB.bore, PRESSED_HUB.outer])
    assert_allclose(PRESSED_HUB.stresses(ends, 1e6)[0], [-1e6, 0.0], atol=1e-3)


def test_both_together_give_way_by_the_interference_that_heat_leaves() -> None:
    at, expanded = np.array([PRESSED_HUB.bore]), 2e-4
    p = pressure(PRESSED_SHAFT, PRESSED_HUB, 1e-5, expanded)
    gives = PRESSED_HUB.displacement(at, p) - PRESSED_SHAFT.displacement(at, around=p)
    assert_allclose(gives + expanded * at, 1e-5, rtol=1e-12)


def test_round_ellipse_is_the_contact_of_a_sphere() -> None:
    F, R, E_star = 50.0, 5e-3, 1 / sum(1 / hertz.plane_strain(E, nu) for E, nu in ((210e9, 0.3), (70e9, 0.33)))
    found, sphere = ellipse(F, 1 / (2 * R), 1 / (2 * R), E_star), hertz.sphere(F, R, E_star)
    assert_allclose([found.a, found.b, found.p0], [sphere.a, sphere.a, sphere.p0], rtol=1e-12)
    assert_allclose(found.approach, hertz.approach(sphere, R), rtol=1e-12)


def test_curvatures_are_those_of_johnson() -> None:
    found = ellipse(1.0, 1.0, 7.5, 1.0)
    k = found.b / found.a
    m = 1 - k**2  # (4.25), e² = m
    along = found.p0 * found.b / (m * found.a**2) * (ellipk(m) - ellipe(m))
    across = found.p0 * found.b / (m * found.a**2) * (ellipe(m) / k**2 - ellipk(m))
    assert_allclose([along, across], [1.0, 7.5], rtol=1e-12)


def test_pressures_add_up_to_the_load() -> None:
    found = ellipse(3.0, 1.0, 7.5, 1.0)
    pressure = lambda y, x: float(found.pressure(np.array([x]), np.array([y]))[0])  # noqa: E731
    edge = lambda x: found.b * np.sqrt(1 - (x / found.a) ** 2)  # noqa: E731
    quarter = dblquad(pressure, 0.0, found.a, 0.0, edge, epsrel=1e-6)[0]
    assert_allclose(4 * quarter, 3.0, rtol=1e-5)


def minimised(forces: tuple[float, ...], cells: int = 400) -> tuple[list[float], list[float]]:
    """Displacements of the end and dissipation so far, from the least complementary energy of each step.

    The bar force N has N(0) = F, |N'| <= q, and minimises the integral of (N - N_before)² / (2 E A): a bounded least
    squares problem in the bed's shear, which knows nothing of slip zones.
    """
    h = shear_lag.LENGTH / cells
    sums = np.tri(cells, k=-1) * h + np.eye(cells) * h / 2  # shear of the cells to N in their middles
    N, u, loss, ends, losses = np.zeros(cells), np.zeros(cells), 0.0, [], []
    for F in forces:
        shear = lsq_linear(sums, F - N, bounds=(-STRIP.q, STRIP.q), tol=1e-14).x
        change = (F - sums @ shear - N) / STRIP.EA
        N = F - sums @ shear
        du = np.cumsum(change[::-1])[::-1] * h - change * h / 2  # nothing moves at the far end
        u, loss = u + du, loss + float(np.sum(shear * du) * h)
        ends.append(float(u[0]))
        losses.append(loss)
    return ends, losses


def test_strip_is_the_least_energy_of_a_chain_of_cells() -> None:
    ends, losses = minimised((FORCE, 0.0, -FORCE, FORCE))
    there, back = shear_lag.pulled(STRIP, FORCE), shear_lag.let_go(STRIP, FORCE)
    leg = shear_lag.let_go(STRIP, 2 * FORCE)
    exact = [there.displacement, there.displacement - back.displacement, -there.displacement, there.displacement]
    # 400 cells: the end stands for the middle of the first, h / 2 of F / E A away
    assert_allclose(ends, exact, atol=1.2 * FORCE / STRIP.EA / 800)
    lost = [there.dissipation, there.dissipation + back.dissipation, there.dissipation + leg.dissipation]
    assert_allclose(losses, [*lost, lost[-1] + leg.dissipation], rtol=1e-3)


def test_strip_gives_the_tabulated_figures() -> None:
    there, back = shear_lag.pulled(STRIP, FORCE), shear_lag.let_go(STRIP, FORCE)
    assert_allclose([there.displacement, there.slip_length], [4.5e-3, 0.6], rtol=1e-14)
    assert_allclose([there.displacement - back.displacement, back.slip_length], [2.25e-3, 0.3], rtol=1e-14)
    assert_allclose(2 * shear_lag.let_go(STRIP, 2 * FORCE).dissipation, 1.8e-3, rtol=1e-14)


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


def test_incline_gives_the_tabulated_figures() -> None:
    assert_allclose([LAYER.pressure, LAYER.shear], [incline.PRESSURE, incline.SHEAR], atol=5e-8)  # 8 and 7 digits
    assert_allclose(LAYER.top, incline.TOP, rtol=1e-5)  # 5 digits
    assert SLIDES < LAYER.slope < HOLDS
    assert_allclose(LAYER.shear / LAYER.pressure, LAYER.slope, rtol=1e-15)
    assert_allclose(np.hypot(LAYER.along, LAYER.across), LAYER.weight, rtol=1e-15)


def test_loads_that_are_held_to_the_end_have_no_limit() -> None:
    with pytest.raises(ValueError, match="held to the end"):
        _ = Limit(length=1.0, height=1.0, mu=0.5, press=STEADY, push=NONE).time
