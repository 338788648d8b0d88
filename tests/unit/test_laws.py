"""Contact laws, point by point: pressures that only push, tractions inside their disc."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray
from scipy import sparse

from stickslip.geometry.errors import SceneError
from stickslip.solvers.contact.admissible_set import project_disc
from stickslip.solvers.laws import compliance
from stickslip.solvers.laws.bilateral import Bilateral
from stickslip.solvers.laws.compliance import Compliance
from stickslip.solvers.laws.coulomb_by_point import CoulombByPoint
from stickslip.solvers.laws.friction import Coulomb, Stick, Tresca
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw
from stickslip.solvers.laws.slip_dependent import SlipDependent
from stickslip.solvers.laws.tangential_compliance import TangentialCompliance
from stickslip.solvers.laws.tied import Tied
from stickslip.solvers.laws.unilateral import Unilateral
from stickslip.solvers.scene.contact import Contact

Array = NDArray[np.float64]
EPS = float(np.finfo(float).eps)
EXPONENTS = st.sampled_from([1.0, 1.5, 2.0, 2.7, 3.0])
STIFFNESS = st.floats(-20, 20).map(lambda e: 10.0**e)  # Pa/m^m_n, from a sponge to rigid
STEPS = st.floats(-12, 12).map(lambda e: 10.0**e)
PRESSURES = st.floats(-12, 12).map(lambda e: 10.0**e)
NORMAL = [
    Unilateral(),
    Bilateral(),
    Tied(),
    Compliance(c_n=3.0),
    Compliance(c_n=1e9, m_n=2.0),
    Compliance(c_n=0.2, m_n=1.5),
]


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
    for law in (Bilateral(), Tied()):
        assert_array_equal(law.resolvent(trial, gamma), trial)
        assert_array_equal(law.stiffness(trial, trial), np.inf)
    assert_array_equal(Unilateral().stiffness(trial, trial), [0.0, 0.0, np.inf])
    for law in (Unilateral(), Bilateral(), Tied()):
        assert law.penetration(trial).tolist() == law.energy(trial).tolist() == [0.0, 0.0, 0.0]


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
    one, two, alone = Unilateral(), Bilateral(), sparse.identity(3, format="csr")
    at_half = {"average": alone, "time": 0.5, "end": 1.0}
    for law in (one, two):  # Coulomb's bound is the pressure's, and nothing where it pulls
        assert_array_equal(Coulomb(mu=0.25).limit(p, normal=law, **at_half), [0.0, 0.0, 0.5])
    assert_array_equal(Tresca(bound=4.0).limit(p, normal=one, **at_half), [0.0, 0.0, 2.0])  # ramped: half way
    assert_array_equal(Tresca(bound=4.0).limit(p, normal=two, **at_half), 2.0)
    assert_array_equal(Tresca(bound=((0.0, 3.0),)).limit(p, normal=two, **at_half), 3.0)
    assert_array_equal(Stick().limit(p, normal=one, **at_half), [0.0, 0.0, np.inf])
    assert_array_equal(Stick().limit(p, normal=two, **at_half), np.inf)
    assert_array_equal(Coulomb(mu=0.25).limit_slope(p, alone, one).toarray(), np.diag([0.0, 0.0, 0.25]))
    assert_array_equal(Tresca(bound=4.0).limit_slope(p, alone, one).toarray(), 0.0)


SHARES = sparse.csr_matrix([[0.7, 0.5, -0.2, 0.0], [0.0, -0.1, 0.4, 0.7]])  # dual functions are negative somewhere


def test_coulomb_takes_the_average_first_and_compliance_the_power_first() -> None:
    normal, p = Compliance(c_n=4.0, m_n=2.0), np.array([1.0, 4.0, 9.0, 0.0])  # penetrations .5, 1, 1.5, 0
    at_once: dict[str, Any] = {"average": SHARES, "normal": normal, "time": 1.0, "end": 1.0}
    assert_allclose(Coulomb(mu=0.5).limit(p, **at_once), 0.5 * np.array([0.9, 3.2]), rtol=4 * EPS)
    law = TangentialCompliance(c_T=8.0, m_T=3.0)  # c_T delta^3 = 1, 8, 27, 0
    assert_allclose(law.limit(p, **at_once), [np.maximum(0.7 + 4 - 5.4, 0), -0.8 + 10.8], rtol=8 * EPS)


@pytest.mark.parametrize("m_n", [1.0, 1.5, 3.0])
@pytest.mark.parametrize(
    "law", [Coulomb(mu=0.3), TangentialCompliance(c_T=2.0), TangentialCompliance(c_T=2.0, m_T=2.5)]
)
def test_slope_of_the_bound_is_its_derivative(law: FrictionLaw, m_n: float) -> None:
    normal, p, h = Compliance(c_n=4.0, m_n=m_n), np.array([1.0, 0.4, 1.3, 0.9]), 1e-6
    at_once: dict[str, Any] = {"average": SHARES, "normal": normal, "time": 1.0, "end": 1.0}
    columns = [(law.limit(p + h * e, **at_once) - law.limit(p - h * e, **at_once)) / (2 * h) for e in np.eye(4)]
    assert_allclose(law.limit_slope(p, SHARES, normal).toarray(), np.stack(columns, axis=1), atol=1e-9)  # h², eps/h


def test_slope_of_the_bound_is_finite_at_first_touch() -> None:
    p = np.array([0.0, 1e-300, 1e-12, 1.0])
    for m_n in (1.0, 2.0, 3.0):
        for m_T in (1.0, 2.0, 3.0):  # below m_n the slope is infinite at p = 0, where the point is open
            slope = TangentialCompliance(c_T=2.0, m_T=m_T).limit_slope(p, SHARES, Compliance(c_n=4.0, m_n=m_n))
            assert np.all(np.isfinite(slope.toarray()))
            assert_array_equal(slope[:, 0].toarray(), 0.0)


def test_bound_by_penetration_needs_a_law_that_has_one() -> None:
    friction, side = TangentialCompliance(c_T=1.0), {"surface": "block.bottom", "against": "floor"}
    assert Contact(**side, normal=Compliance(c_n=1.0), friction=friction).tangential is friction
    for law in (Unilateral(), Bilateral()):
        with pytest.raises(SceneError, match=r'friction: law = "compliance" bounds friction by the penetration'):
            Contact(**side, normal=law, friction=friction)


def test_tied_surface_sticks_and_refuses_a_friction_law() -> None:
    side = {"surface": "block.bottom", "against": "floor"}
    tied = Contact(**side, normal=Tied())
    assert (tied.friction, tied.tangential) == (None, Stick())
    with pytest.raises(SceneError, match=r"friction: a tied surface sticks, leave it out"):
        Contact(**side, normal=Tied(), friction=Coulomb(mu=0.3))


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: Coulomb(mu=-0.1), r"mu = -0\.1: must not be negative"),
        (lambda: Tresca(bound=((0.0, 1.0), (1.0, -2.0))), r"bound = -2\.0: must not be negative, in pascal"),
        (lambda: Coulomb(mu=0.3, k_T=0.0), r"k_T = 0\.0: must be positive, in Pa/m"),
        (lambda: Tresca(bound=1.0, k_T=-1.0), r"k_T = -1\.0: must be positive, in Pa/m"),
        (lambda: Stick(k_T=-1.0), r"k_T = -1\.0: must be positive, in Pa/m"),
        (lambda: TangentialCompliance(c_T=-1.0), r"c_T = -1\.0: must not be negative, in Pa/m\^m_T"),
        (lambda: TangentialCompliance(c_T=1.0, m_T=0.5), r"m_T = 0\.5: must be at least 1"),
        (lambda: Compliance(c_n=0.0), r"c_n = 0\.0: must be positive, in Pa/m\^m_n"),
        (lambda: Tresca(bound=((1.0, 1.0), (0.5, 2.0))), r"^bound = .*: times must increase"),
        (lambda: CoulombByPoint(mu=np.array([0.3, -0.1])), r"mu = -0\.1: must not be negative"),
        (lambda: Compliance(c_n=1.0, m_n=0.5), r"m_n = 0\.5: must be at least 1"),
    ],
)
def test_impossible_laws_are_refused(make: Any, text: str) -> None:
    with pytest.raises(SceneError, match=text):
        make()


def test_laws_at_the_edge_of_what_is_possible_are_accepted() -> None:
    for law in (Coulomb(mu=0.0), Tresca(bound=0.0), Tresca(bound=((1.0, 0.0),)), TangentialCompliance(c_T=0.0)):
        assert not law.resists()
    at_least: list[FrictionLaw] = [Coulomb(mu=0.3), Tresca(bound=0.5), Tresca(bound=((0.0, 0.0), (1.0, 0.5))), Stick()]
    for law in (*at_least, TangentialCompliance(c_T=0.5), CoulombByPoint(mu=np.array([0.0, 0.1]))):
        assert law.resists()
    assert not CoulombByPoint(mu=np.zeros(2)).resists()
    assert CoulombByPoint(mu=np.zeros(0)).lines(Unilateral(), 1.0, 1.0) == (np.inf, np.inf, 0.0)


def test_no_bound_from_above_is_below_what_mu_becomes_by_slip() -> None:
    """A proof that nothing balances the loads must hold for the mu that points have once they slip."""
    law = SlipDependent(mu=((0.0, 0.1), (1e-3, 0.5), (2e-3, 0.3)))
    for slid, most in ((0.0, 0.5), (1.5e-3, 0.4), (1.0, 0.3)):
        assert law.at(np.array([slid])).lines(Unilateral(), 1.0, 1.0)[2] == pytest.approx(most)
    assert Coulomb(mu=0.3, k_T=0.5).softness == 2.0
    assert Compliance(c_n=0.5).c_n == 0.5


def test_each_point_has_its_own_coefficient() -> None:
    law, p, alone = CoulombByPoint(mu=np.array([0.1, 0.2, 0.3])), np.array([-1.0, 2.0, 3.0]), sparse.identity(3).tocsr()
    normal = Unilateral()
    assert_allclose(law.limit(p, alone, normal, 1.0, 1.0), [0.0, 0.4, 0.9])
    assert_allclose(law.limit_slope(p, alone, normal).toarray(), np.diag([0.0, 0.2, 0.3]))
    assert_allclose(law.limit_slope(np.array([0.0, 0.5, 2.0]), alone, normal).toarray(), np.diag([0.0, 0.2, 0.3]))
    assert law.lines(normal, 1.0, 1.0) == (np.inf, 0.1, 0.3)
    with pytest.raises(AssertionError, match="all points of the contact at once"):
        law.limit(p[:2], sparse.identity(2).tocsr(), normal, 1.0, 1.0)


LINES: list[tuple[FrictionLaw, NormalLaw, bool]] = [  # and whether the lines are the bound itself
    (Coulomb(mu=0.3), Unilateral(), True),
    (Tresca(bound=((1.0, 0.8), (2.0, 4.0))), Unilateral(), True),
    (Tresca(bound=4.0), Unilateral(), True),
    (Stick(), Unilateral(), True),
    (TangentialCompliance(c_T=2.0), Compliance(c_n=3.0), True),
    (TangentialCompliance(c_T=2.0, m_T=1.000001), Compliance(c_n=3.0), False),
    (TangentialCompliance(c_T=0.7, m_T=1.5), Compliance(c_n=3.0, m_n=1.5), True),
    (TangentialCompliance(c_T=2.0, m_T=2.0), Compliance(c_n=3.0, m_n=1.5), False),
    (CoulombByPoint(mu=np.array([0.1, 0.2, 0.3])), Unilateral(), False),
]


@pytest.mark.parametrize(("law", "normal", "exact"), LINES)
def test_lines_enclose_the_bound(law: FrictionLaw, normal: NormalLaw, exact: bool) -> None:
    p, time = np.array([0.2, 1.0, 7.0]), 1.25
    cap, below, above = law.lines(normal, time, 2.0)
    s = law.limit(p, sparse.identity(3, format="csr"), normal, time, 2.0)
    low, high = (np.minimum(cap, slope * p) for slope in (below, above))
    assert np.all(low <= s * (1 + 4 * EPS))
    assert np.all(s <= high * (1 + 4 * EPS))
    assert np.array_equal(low, high) is exact


def test_amplitudes_of_laws_are_values_in_time() -> None:
    assert Tresca(bound=4.0).amplitudes() == {"bound": 4.0}
    assert Coulomb(mu=0.3).amplitudes() == {}


def test_a_law_is_integrated_to_the_degree_of_its_power() -> None:
    """A traction of degree m_n k times a test function of degree k."""
    for order in (1, 2):
        assert Unilateral().degree(order) == 2 * order
        assert [Compliance(c_n=1.0, m_n=m_n).degree(order) for m_n in (1.0, 1.5, 3.0)] == [
            2 * order, order + (2 if order == 1 else 3), 4 * order]  # fmt: skip
        assert [TangentialCompliance(c_T=1.0, m_T=m_T).degree(order) for m_T in (1.0, 3.0)] == [2 * order, 4 * order]
        assert Coulomb(mu=0.3).degree(order) == 0


def test_pressure_and_penetration_are_inverses() -> None:
    d, law = np.array([-0.5, 0.0, 0.5, 3.0]), Compliance(c_n=4.0, m_n=3.0)
    assert_allclose(law.pressure(d), [0.0, 0.0, 0.5, 108.0])
    assert_allclose(law.penetration(law.pressure(d)), np.maximum(d, 0.0), rtol=4 * EPS)


def test_a_light_touch_is_a_touch() -> None:
    alone, at_end = sparse.identity(2, format="csr"), {"time": 1.0, "end": 1.0}
    light = np.array([0.0, 1e-9])
    assert_array_equal(Tresca(bound=4.0).limit(light, alone, Unilateral(), **at_end), [0.0, 4.0])
    soft = Compliance(c_n=0.2)
    for law, slope in ((Coulomb(mu=0.3), 0.3), (TangentialCompliance(c_T=2.0), 10.0)):
        assert_allclose(law.limit_slope(light, alone, soft).toarray(), np.diag([0.0, slope]))


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
