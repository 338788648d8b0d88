"""A ball on a groove or a flat, from a STEP file: Hertz' closed form."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import dblquad
from scipy.special import ellipe, ellipk

from stickslip.workflows.lab.verification.cases import bearing as case
from stickslip.workflows.lab.verification.cases.bearing import Rest, figures
from stickslip.workflows.lab.verification.check import failures
from stickslip.workflows.lab.verification.closed_forms import hertz
from stickslip.workflows.lab.verification.closed_forms.hertz_ellipse import contact_modulus, ellipse

# --- the closed form


def test_round_ellipse_is_the_contact_of_a_sphere() -> None:
    F, R, E_star = 50.0, 5e-3, contact_modulus((210e9, 0.3), (70e9, 0.33))
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


# --- the scene; tolerances are the case's own, with their reasons there


def test_ball_on_a_flat_and_on_a_groove_are_those_of_hertz() -> None:
    assert not failures(figures(Rest(on="flat", cells=4.0)))
    assert not failures(figures(Rest(load=case.HEAVY, cells=2.5)))


@pytest.mark.slow
def test_bearing_is_that_of_hertz() -> None:
    assert not failures(case.checks("condensed-newton"))


def test_checks_notice_another_modulus(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(case, "E_STAR", 1.1 * case.E_STAR)
    assert len(failures(figures(Rest(on="flat", cells=3.0)))) >= 2
