"""Closed forms of half-spaces agree with the tabulated figures, and satisfy the equations they were derived from."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.special import ellipk

from stickslip.workflows.lab.verification.closed_forms import hertz, punch

Array = NDArray[np.float64]


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
