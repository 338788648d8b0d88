"""Contact laws, point by point: pressures that only push, tractions inside their disc."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from geometry.errors import SceneError
from solvers.cone import project_disc
from solvers.effects import compliance
from solvers.effects.bilateral import Bilateral
from solvers.effects.compliance import Compliance
from solvers.effects.friction import Coulomb, Stick, Tresca
from solvers.effects.laws import NormalLaw
from solvers.effects.unilateral import Unilateral

Array = NDArray[np.float64]
EPS = float(np.finfo(float).eps)
EXPONENTS = st.sampled_from([1.0, 1.5, 2.0, 2.7, 3.0])
STIFFNESS = st.floats(-20, 20).map(lambda e: 10.0**e)  # Pa/m^m_n, from a sponge to rigid
STEPS = st.floats(-12, 12).map(lambda e: 10.0**e)
PRESSURES = st.floats(-12, 12).map(lambda e: 10.0**e)
NORMAL = [Unilateral(), Bilateral(), Compliance(c_n=3.0), Compliance(c_n=1e9, m_n=2.0), Compliance(c_n=0.2, m_n=1.5)]


@given(EXPONENTS, STIFFNESS, STEPS, PRESSURES)
def test_compliance_resolvent_solves_its_equation(m_n: float, c_n: float, gamma: float, p_hat: float) -> None:
    law = Compliance(c_n=c_n, m_n=m_n)
    p = law.resolvent(np.array([p_hat]), np.array([gamma]))
    assert 0 < p[0] <= p_hat * (1 + 8 * EPS)
    left = p + gamma * law.penetration(p)
    assert_allclose(left, p_hat, rtol=50 * EPS)  # both terms positive: a few roundings, powers of 1/m among them


@given(EXPONENTS, STIFFNESS, STEPS, PRESSURES)
def test_compliance_never_pulls(m_n: float, c_n: float, gamma: float, p: float) -> None:
    law = Compliance(c_n=c_n, m_n=m_n)
    trial = np.array([-p, 0.0])
    assert_array_equal(law.resolvent(trial, np.full(2, gamma)), 0.0)
    assert_array_equal(law.stiffness(np.zeros(2), trial), 0.0)


@pytest.mark.parametrize("m_n", [1.5, 2.0, 2.7, 3.0])
def test_compliance_newton_never_meets_its_bound(m_n: float, monkeypatch: pytest.MonkeyPatch) -> None:
    exponents = np.arange(-12.0, 13.0, 2.0)
    gamma, p_hat = (10.0 ** grid.ravel() for grid in np.meshgrid(exponents, exponents))
    for c_n in 10.0 ** np.arange(-20.0, 21.0, 4.0):
        law = Compliance(c_n=float(c_n), m_n=m_n)
        full = law.resolvent(p_hat, gamma)
        with monkeypatch.context() as patch:
            patch.setattr(compliance, "NEWTON_STEPS", 50)
            assert_allclose(law.resolvent(p_hat, gamma), full, rtol=20 * EPS)


@pytest.mark.parametrize("law", NORMAL)
def test_stiffness_is_the_slope_of_the_resolvent_without_its_step(law: NormalLaw) -> None:
    # p = R(p_hat) and p_hat = p + gamma d give dp/dp_hat = k / (k + gamma)
    gamma, h = np.array([0.7]), 1e-6
    for trial in (np.array([0.9]), np.array([-0.4])):
        slope = (law.resolvent(trial + h, gamma) - law.resolvent(trial - h, gamma)) / (2 * h)
        k = law.stiffness(law.resolvent(trial, gamma), trial)
        expected = np.where(np.isinf(k), 1.0, np.divide(k, k + gamma, where=np.isfinite(k), out=np.ones(1)))
        assert_allclose(slope, expected, atol=1e-8)  # central difference, h² and eps/h


@pytest.mark.parametrize("law", NORMAL)
def test_resolvents_never_move_two_trials_apart(law: NormalLaw) -> None:
    trial = np.random.default_rng(1).normal(size=(200, 2))
    gamma = np.full(200, 1.3)
    p, q = law.resolvent(trial[:, 0], gamma), law.resolvent(trial[:, 1], gamma)
    assert np.all((p - q) * (trial[:, 0] - trial[:, 1]) >= 0)
    assert np.all(np.abs(p - q) <= np.abs(trial[:, 0] - trial[:, 1]) * (1 + 4 * EPS))


def test_rigid_laws_keep_the_trial_where_it_may_be() -> None:
    trial, gamma = np.array([-2.0, 0.0, 3.0]), np.ones(3)
    assert_array_equal(Unilateral().resolvent(trial, gamma), [0.0, 0.0, 3.0])
    assert_array_equal(Bilateral().resolvent(trial, gamma), trial)
    assert_array_equal(Unilateral().stiffness(trial, trial), [0.0, 0.0, np.inf])
    assert_array_equal(Bilateral().stiffness(trial, trial), np.inf)
    for law in (Unilateral(), Bilateral()):
        assert_array_equal(law.penetration(trial), 0.0)
        assert_array_equal(law.energy(trial), 0.0)


@given(EXPONENTS, st.floats(1e-3, 1e3), st.floats(1e-3, 10.0))
def test_compliance_energy_is_the_work_of_pressing(m_n: float, c_n: float, depth: float) -> None:
    law = Compliance(c_n=c_n, m_n=m_n)
    x, weights = np.polynomial.legendre.leggauss(20)  # type: ignore[no-untyped-call]
    d = depth * (1 + x) / 2
    work = depth / 2 * weights @ (c_n * d**m_n)
    found = law.energy(np.array([c_n * depth**m_n]))
    assert_allclose(found, work, rtol=1e-6)  # 20 Gauss points on d^1.5: 1e-8


def test_friction_bounds_follow_their_laws() -> None:
    p = np.array([-1.0, 0.0, 2.0])
    at_half = {"time": 0.5, "end": 1.0}
    for sides in (1, 2):  # Coulomb's bound is the pressure's, and nothing where it pulls
        assert_array_equal(Coulomb(mu=0.25).limit(p, sides, **at_half), [0.0, 0.0, 0.5])
    assert_array_equal(Tresca(bound=4.0).limit(p, 1, **at_half), [0.0, 0.0, 2.0])  # ramped: half way
    assert_array_equal(Tresca(bound=4.0).limit(p, 2, **at_half), 2.0)
    assert_array_equal(Tresca(bound=((0.0, 3.0),)).limit(p, 2, **at_half), 3.0)
    assert_array_equal(Stick().limit(p, 1, **at_half), [0.0, 0.0, np.inf])
    assert_array_equal(Stick().limit(p, 2, **at_half), np.inf)
    assert_array_equal(Coulomb(mu=0.25).limit_slope(p), [0.0, 0.0, 0.25])
    assert_array_equal(Tresca(bound=4.0).limit_slope(p), 0.0)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Coulomb(mu=-0.1), r"mu = -0\.1: must not be negative"),
        (lambda: Tresca(bound=((0.0, 1.0), (1.0, -2.0))), r"bound = -2\.0: must not be negative, in pascal"),
        (lambda: Compliance(c_n=0.0), r"c_n = 0\.0: must be positive"),
        (lambda: Compliance(c_n=1.0, m_n=0.5), r"m_n = 0\.5: must be at least 1"),
    ],
)
def test_impossible_laws_are_refused(make: Any, text: str) -> None:
    with pytest.raises(SceneError, match=text):
        make()


@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 2]))
def test_projection_onto_the_disc_is_a_projection(seed: int, components: int) -> None:
    random = np.random.default_rng(seed)
    t, other = random.normal(scale=3.0, size=(2, 20, components))
    s = random.exponential(size=20) * (random.random(20) > 0.2)  # some bounds are 0
    q, q_other = project_disc(t, s), project_disc(other, s)
    length = np.linalg.norm(q, axis=1)
    assert np.all(length <= s * (1 + 4 * EPS))
    assert_allclose(project_disc(q, s), q, rtol=4 * EPS)  # twice is once
    inside = np.linalg.norm(t, axis=1) <= s
    assert_array_equal(q[inside], t[inside])
    apart = np.linalg.norm(t - other, axis=1)
    assert np.all(np.linalg.norm(q - q_other, axis=1) <= apart * (1 + 1e-12))
    # nearest point of the disc: (t - q) . (z - q) <= 0 for every z in it
    z = q_other
    assert np.all(np.einsum("mi,mi->m", t - q, z - q) <= 1e-12 * (1 + apart))


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 2 * np.pi))
def test_projection_onto_the_disc_has_no_preferred_direction(seed: int, angle: float) -> None:
    random = np.random.default_rng(seed)
    t, s = random.normal(size=(20, 2)), random.exponential(size=20)
    turn: Array = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    assert_allclose(project_disc(t @ turn.T, s), project_disc(t, s) @ turn.T, atol=1e-14)


def test_no_bound_leaves_every_traction_as_it_is() -> None:
    t = np.array([[1e150, -3.0], [0.0, 0.0]])
    assert_array_equal(project_disc(t, np.full(2, np.inf)), t)
    assert_array_equal(project_disc(t[1:], np.zeros(1)), 0.0)
