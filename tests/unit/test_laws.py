"""Normal and friction laws are what their formulas say, and refuse nonsense by key."""

from dataclasses import asdict, replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy import sparse

from shared.audited import record_of
from shared.cases import every_nth
from shared.failures import failures
from shared.problems import scene_of
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError
from stickslip.solvers.classical.uzawa import Uzawa
from stickslip.solvers.contact.admissible_set import project_disc
from stickslip.solvers.laws.friction import (
    CappedCoulomb,
    Cohesion,
    Coulomb,
    CoulombByPoint,
    OrthotropicCoulomb,
    Stick,
    Tresca,
)
from stickslip.solvers.laws.law import FrictionLaw, NormalLaw, Trial, touched
from stickslip.solvers.laws.mu_table import largest_from
from stickslip.solvers.laws.normal import Bilateral, Compliance, Tied, Unilateral
from stickslip.solvers.laws.pressure_dependent import PressureDependent
from stickslip.solvers.laws.rate_dependent import SPEEDS, RateDependent
from stickslip.solvers.laws.slip_dependent import SlipDependent, StaticKinetic
from stickslip.solvers.laws.tangential_compliance import TangentialCompliance
from stickslip.solvers.laws.wear import Worn
from stickslip.solvers.results.audit import Auditor
from stickslip.solvers.results.step_result import SLIP, STICK
from stickslip.solvers.scene.contact import Contact
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.stepping.stepper import StepError
from stickslip.workflows.lab.verification.cases import sheared_column
from stickslip.workflows.lab.verification.cases.sheared_column import K_T, PRESSURE, E, bases, compare, scene
from stickslip.workflows.lab.verification.prepared import prepare, system_of

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
    *(Worn(of=of, softness=np.array([0.3])) for of in (Unilateral(), Compliance(c_n=3.0, m_n=2.0))),
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
            patch.setattr("stickslip.solvers.laws.normal.NEWTON_STEPS", 50)
            assert_allclose(law.resolvent(p_hat, gamma), full, rtol=20 * EPS)


@pytest.mark.parametrize("law", NORMAL)
def test_stiffness_is_the_slope_of_the_resolvent_without_its_step(law: NormalLaw) -> None:
    # p = R(p_hat) and p_hat = p + gamma d give dp/dp_hat = k / (k + gamma)
    gamma, h = np.array([0.7]), 1e-6
    for trial in (np.array([0.9]), np.array([-0.4])):
        slope = (law.resolvent(trial + h, gamma) - law.resolvent(trial - h, gamma)) / (2 * h)
        k = law.stiffness(law.resolvent(trial, gamma), trial)
        rigid = 1 / (1 + gamma * law.give)
        expected = np.where(np.isinf(k), rigid, np.divide(k, k + gamma, where=np.isfinite(k), out=np.ones(1)))
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
    x, weights = np.polynomial.legendre.leggauss(20)
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


AXIS = (0.0, 3.0, 0.0)
PLAIN: list[FrictionLaw] = [
    Cohesion(a=0.7, mu=0.3),
    PressureDependent(mu=((0.5, 0.5), (2.0, 0.4), (4.0, 0.6))),
    OrthotropicCoulomb(mu_1=0.2, mu_2=0.5, axis=AXIS),
]
CAPPED = [CappedCoulomb(mu=0.5, s_max=s_max) for s_max in (2.0, 1.0, 0.4)]
BY_PENETRATION = [TangentialCompliance(c_T=2.0), TangentialCompliance(c_T=2.0, m_T=2.5)]
SLOPES: list[tuple[FrictionLaw, NormalLaw]] = [
    *product([Coulomb(mu=0.3), *BY_PENETRATION], [Compliance(c_n=4.0, m_n=m_n) for m_n in (1.0, 1.5, 3.0)]),
    *product([Coulomb(mu=0.3), *CAPPED], [Unilateral(), Compliance(c_n=4.0, m_n=2.0)]),
    *product(PLAIN, [Unilateral()]),
]
NOW: dict[str, Any] = {"average": SHARES, "time": 1.0, "end": 1.0}


@pytest.mark.parametrize(("law", "normal"), SLOPES)
def test_slope_of_the_bound_is_its_derivative(law: FrictionLaw, normal: NormalLaw) -> None:
    h = 1e-6
    smooth = [[1.0, 4.0, 9.0, 0.0], [-1.0, -4.0, 9.0, 1.0]] if law not in BY_PENETRATION else []
    for p in map(np.array, ([1.0, 0.4, 1.3, 0.9], *smooth)):
        ends = [[law.limit(p + sign * h * e, normal=normal, **NOW) for e in np.eye(4)] for sign in (1, -1)]
        slope = (np.array(ends[0]) - np.array(ends[1])).T / (2 * h)
        assert_allclose(law.limit_slope(p, SHARES, normal).toarray(), slope, atol=1e-9)  # h², eps / h


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


def fallen(**given: float) -> StaticKinetic:
    return StaticKinetic(**{"mu_s": 0.3, "mu_k": 0.2, "slip_length": 1.0} | given)


def across(**given: Any) -> OrthotropicCoulomb:
    return OrthotropicCoulomb(**{"mu_1": 0.1, "mu_2": 0.1, "axis": AXIS} | given)


def test_memory_of_slip_grows_by_the_slip_of_a_step() -> None:
    for law in (fallen(), SlipDependent(mu=((0.0, 0.1), (1.0, 0.5)))):
        assert_array_equal(law.after(np.array([0.0, 2.0]), np.array([1.0, 0.5]), 1.0), [1.0, 2.5])


def test_a_field_of_friction_has_a_coefficient_for_each_point() -> None:
    points = np.array([[0.0, 1.0], [2.0, 1.0]])
    for mu, expected in (("0.1 + 0.1*x", [0.1, 0.3]), ("0.1*t", [0.05, 0.05]), (((0.0, 0.2), (1.0, 0.4)), [0.3, 0.3])):
        law = Coulomb(mu=mu, k_T=7.0).placed(points, 0.5, 2.0)
        assert_allclose(law.mu, expected)
        assert law.k_T == 7.0
        assert law.of_points(np.array([1])).mu == pytest.approx(expected[1:])
    with pytest.raises(SceneError, match=r"^friction\.mu = \"1/x\": has no finite value"):
        Coulomb(mu="1/x").placed(points, 0.5, 2.0)
    with pytest.raises(SceneError, match=r"^friction\.mu = -2\.0: must not be negative"):
        Coulomb(mu="-x").placed(points, 0.5, 2.0)
    with pytest.raises(SceneError, match=r'^mu = "q": column 1: q is not known'):
        Coulomb(mu="q")


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
        (lambda: CappedCoulomb(mu=-0.1, s_max=1.0), r"mu = -0\.1: must not be negative"),
        (lambda: CappedCoulomb(mu=0.1, s_max=0.0), r"s_max = 0\.0: must be positive, in pascal"),
        (lambda: CappedCoulomb(mu=0.1, s_max=1.0, k_T=-1.0), r"k_T = -1\.0: must be positive, in Pa/m"),
        (lambda: Cohesion(a=-1.0, mu=0.1), r"^a = -1\.0: must not be negative, in pascal"),
        (lambda: Cohesion(a=1.0, mu=-0.1), r"^mu = -0\.1: must not be negative"),
        (lambda: fallen(mu_k=-0.1), r"^mu_k = -0\.1: must not be negative"),
        (lambda: fallen(mu_k=0.4), r"^mu_s = 0\.3: must not be below mu_k = 0\.4"),
        (lambda: fallen(slip_length=0.0), r"^slip_length = 0\.0: must be positive, in metres"),
        (lambda: SlipDependent(mu=()), r"^mu = \[\]: a table needs at least one \[value, mu\]"),
        (
            lambda: SlipDependent(mu=((0.0, 0.1), (0.0, 0.2))),
            r"^mu = \[0\.0, 0\.0\]: its first column must increase from 0",
        ),
        (lambda: SlipDependent(mu=((-1.0, 0.1),)), r"^mu = .*: its first column must increase from 0"),
        (lambda: SlipDependent(mu=((0.0, -0.1),)), r"^mu = -0\.1: mu must not be negative"),
        (lambda: across(mu_1=0.0), r"^mu_1 = 0\.0: must be positive"),
        (lambda: across(mu_2=0.0), r"^mu_2 = 0\.0: must be positive"),
        (
            lambda: across(k_T=1.0),
            r"^k_T = 1\.0: orthotropic friction is rigid",
        ),
        (
            lambda: across(axis=(1.0, 0.0)),
            r"^axis = \[1\.0, 0\.0\]: expected a direction",
        ),
        (lambda: across(axis=(0.0, 0.0, 0.0)), r"^axis = .*: expected a direction"),
        (lambda: RateDependent(mu=((0.0, -0.1),)), r"^mu = -0\.1: mu must not be negative"),
        (
            lambda: RateDependent(mu=((0.0, 0.0), (1.0, 0.3))),
            r"^mu = \[\[0\.0, 0\.0\], \[1\.0, 0\.3\]\]: is 0 at V = 0, .*, such as 1e-3$",
        ),
        (lambda: RateDependent(mu=((0.0, 0.3), (1.0, 0.2))), r"^mu = \[\[0\.0, 0\.3\], \[1\.0, 0\.2\]\]: mu falls as"),
        (lambda: RateDependent(mu=((0.0, 0.3),), damping=-1.0), r"^damping = -1\.0: must not be negative, in Pa s/m"),
        (lambda: RateDependent(mu="q("), r'^mu = "q\(": column'),
        (lambda: PressureDependent(mu=()), r"^mu = \[\]: a table needs at least one \[value, mu\]"),
        (lambda: across().check_model("plane strain"), r'^law = "orthotropic_coulomb": a plane model has one'),
        (lambda: RateDependent(mu="0.3 + x + y"), r'^mu = "0\.3 \+ x \+ y": x, y: mu depends on V alone'),
    ],
)
def test_impossible_laws_are_refused(make: Any, text: str) -> None:
    with pytest.raises(SceneError, match=text):
        make()


def test_laws_at_the_edge_of_what_is_possible_are_accepted() -> None:
    for law in (Coulomb(mu=0.0), Tresca(bound=0.0), Tresca(bound=((1.0, 0.0),)), TangentialCompliance(c_T=0.0)):
        assert not law.resists()
    for law in (Cohesion(a=0.0, mu=0.0), CappedCoulomb(mu=0.0, s_max=1.0), PressureDependent(mu=((0.0, 0.0),))):
        assert not law.resists()
    at_least: list[FrictionLaw] = [Coulomb(mu=0.3), Tresca(bound=0.5), Tresca(bound=((0.0, 0.0), (1.0, 0.5))), Stick()]
    for law in (
        *at_least,
        *RATES,
        Cohesion(a=0.0, mu=0.3),
        TangentialCompliance(c_T=0.5),
        CoulombByPoint(mu=np.array([0.0, 0.1])),
        *PLAIN,
        *CAPPED,
    ):
        assert law.resists()
    assert not CoulombByPoint(mu=np.zeros(2)).resists()
    for most in (None, np.zeros(0)):
        assert CoulombByPoint(mu=np.zeros(0), most=most).lines(Unilateral(), 1.0, 1.0) == (np.inf, np.inf, 0.0)


def test_no_bound_from_above_is_below_what_mu_becomes_by_slip() -> None:
    """A proof that nothing balances the loads must hold for the mu that points have once they slip."""
    law = SlipDependent(mu=((0.0, 0.1), (1e-3, 0.5), (2e-3, 0.3)))
    for slid, most in ((0.0, 0.5), (1.5e-3, 0.4), (1.0, 0.3)):
        assert law.at(np.array([slid])).lines(Unilateral(), 1.0, 1.0)[2] == pytest.approx(most)
    both = SlipDependent(mu=((0.0, 0.1), (1.0, 0.5), (2.0, 0.2), (3.0, 0.3))).at(np.array([0.0, 2.0]))
    assert both.of_points(np.array([1])).lines(Unilateral(), 1.0, 1.0)[2] == pytest.approx(0.3)
    assert_allclose(largest_from(((0.0, 0.2), (1.0, 0.3), (2.0, 0.5), (3.0, 0.1)), np.array([0.5, 1.5])), 0.5)
    assert Coulomb(mu=0.3, k_T=0.5).softness == 2.0
    assert Compliance(c_n=0.5).c_n == 0.5


def test_each_point_has_its_own_coefficient() -> None:
    law, p, alone = CoulombByPoint(mu=np.array([0.1, 0.2, 0.3])), np.array([-1.0, 2.0, 3.0]), sparse.identity(3).tocsr()
    normal = Unilateral()
    assert_allclose(law.limit(p, alone, normal, 1.0, 1.0), [0.0, 0.4, 0.9])
    assert_allclose(law.limit_slope(p, alone, normal).toarray(), np.diag([0.0, 0.2, 0.3]))
    assert_allclose(law.limit_slope(np.array([0.0, 0.5, 2.0]), alone, normal).toarray(), np.diag([0.0, 0.2, 0.3]))
    assert law.lines(normal, 1.0, 1.0) == (np.inf, 0.1, 0.3)
    assert law.homogeneous(normal, 1.0, 1.0)
    with pytest.raises(ValueError, match="broadcast"):  # all points of the contact at once
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
    (TangentialCompliance(c_T=0.7, m_T=2.0), Compliance(c_n=3.0, m_n=1.5), False),
    (TangentialCompliance(c_T=0.0, m_T=2.0), Compliance(c_n=3.0, m_n=1.5), True),
    (CoulombByPoint(mu=np.array([0.1, 0.2, 0.3])), Unilateral(), False),
    (PLAIN[0], Unilateral(), True),
    (PLAIN[1], Unilateral(), False),
    (PLAIN[2], Unilateral(), True),
    (CappedCoulomb(mu=0.3, s_max=2.0), Unilateral(), True),
    (CappedCoulomb(mu=0.3, s_max=2.0), Compliance(c_n=4.0, m_n=2.0), True),
]


@pytest.mark.parametrize(("law", "normal", "exact"), LINES)
def test_lines_enclose_the_bound(law: FrictionLaw, normal: NormalLaw, exact: bool) -> None:
    p, time = np.array([0.2, 1.0, 7.0]), 1.25
    if not isinstance(law, CoulombByPoint):
        p = np.concatenate([p, np.linspace(0.01, 20.0, 500)])
    cap, below, above = law.lines(normal, time, 2.0)
    s = law.limit(p, sparse.identity(len(p), format="csr"), normal, time, 2.0)
    low, high = (law.at_no_pressure + np.minimum(cap, slope * p) for slope in (below, above))
    assert np.all(low <= s * (1 + 4 * EPS))
    assert np.all(s <= high * (1 + 4 * EPS))
    assert np.array_equal(low, high) is exact
    assert law.homogeneous(normal, time, 2.0) == (law is PLAIN[2]) or law not in PLAIN


def test_amplitudes_of_laws_are_values_in_time() -> None:
    assert Tresca(bound=4.0).amplitudes() == {("bound",): 4.0}
    assert Coulomb(mu=0.3).amplitudes() == {}
    assert Coulomb(mu=((0.0, 0.1), (1.0, 0.3))).amplitudes() == {("mu",): ((0.0, 0.1), (1.0, 0.3))}


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
    assert_array_equal(touched(light, alone, soft), [0.0, 1.0])
    level = PressureDependent(mu=((0.0, 0.3), (1.0, 0.3)))
    for law, slope in ((Coulomb(mu=0.3), 0.3), (TangentialCompliance(c_T=2.0), 10.0), (level, 0.3)):
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


def test_cohesion_holds_where_surfaces_press_and_everywhere_if_they_cannot_part() -> None:
    law, alone, p = Cohesion(a=0.7, mu=0.3), sparse.identity(3, format="csr"), np.array([-1.0, 0.0, 2.0])
    assert_allclose(law.limit(p, normal=Unilateral(), **NOW | {"average": alone}), [0.0, 0.0, 1.3])
    assert_allclose(law.limit(p, normal=Bilateral(), **NOW | {"average": alone}), [0.7, 0.7, 1.3])
    assert Cohesion(a=0.7, mu=0.0).resists()


def test_a_bound_that_would_fall_as_the_pressure_grows_is_refused() -> None:
    PressureDependent(mu=((0.0, 0.4), (2.0, 0.2)))  # s = 0.4 p - 0.1 p^2 is level at 2 Pa
    with pytest.raises(SceneError, match="the bound mu p_n falls as the pressure grows"):
        PressureDependent(mu=((0.0, 0.4), (2.0, 0.19)))
    with pytest.raises(SceneError, match="the bound mu p_n falls as the pressure grows"):
        PressureDependent(mu=((1.0, 0.4), (2.0, 0.25)))


def test_laws_by_slip_are_coulombs_with_the_mu_of_each_point() -> None:
    slid = np.array([0.0, 0.5, 1.0, 7.0])
    for law, mu in (
        (StaticKinetic(mu_s=0.3, mu_k=0.2, slip_length=1.0, k_T=4.0), [0.3, 0.25, 0.2, 0.2]),
        (SlipDependent(mu=((0.5, 0.1), (1.0, 0.4), (3.0, 0.2)), k_T=4.0), [0.1, 0.1, 0.4, 0.2]),
    ):
        found = law.at(slid)
        assert isinstance(found, CoulombByPoint)
        assert_allclose(found.mu, mu, rtol=1e-15)
        assert found.of_point(1) == Coulomb(mu=mu[1], k_T=4.0)
        assert law.remembers
        assert law.resists()
        assert_array_equal(law.within(slid, 1.0).mu, found.mu)  # type: ignore[attr-defined]
        assert_allclose(law.weakening, 0.1)
    assert not StaticKinetic(mu_s=0.0, mu_k=0.0, slip_length=1.0).resists()
    assert Coulomb(mu=0.3).at(slid) == Coulomb(mu=0.3)
    assert_array_equal(Coulomb(mu=0.3).memory(2), [0.0, 0.0], strict=True)
    assert_array_equal(Coulomb(mu=0.3).work_aside(slid, SHARES, slid, 1.0), [0.0, 0.0], strict=True)
    assert Coulomb(mu=0.3).rates(slid) is None
    assert_array_equal(RATES[0].rates(slid), slid)  # type: ignore[arg-type]
    across().check_model("3d")


RATES = [
    RateDependent(mu=((0.1, 0.2), (0.5, 0.4), (2.0, 1.0))),
    RateDependent(mu="0.2 + 0.1*log(1 + V) + 0*abs(V)"),
    RateDependent(mu=((0.1, 0.2), (0.5, 0.4), (2.0, 1.0)), damping=0.7),
]


@pytest.mark.parametrize("k_T", [None, 3.0])
@pytest.mark.parametrize("law", RATES)
def test_the_bound_of_slip_in_a_step_is_that_of_its_rate_and_has_its_derivatives(
    law: RateDependent, k_T: float | None
) -> None:
    now = replace(law, k_T=k_T).within(np.zeros(2), 0.5)
    p, gamma, h = np.array([1.0, 4.0, 9.0, 1.0]), np.array([0.5, 5.0]), 1e-6
    soft = 1 + gamma / k_T if k_T else 1.0
    for size in (np.array([0.1, 0.2]), np.array([3.0, 6.0]), np.array([9.0, 40.0])):
        found = now.dragged(p, SHARES, Trial(size, gamma))
        slip = np.maximum(size - found.bound * soft, 0.0) / gamma  # of t + gamma (slip + t/k_T)
        at_rest = size <= now.limit(p, normal=Unilateral(), **NOW) * soft
        moving = law.at(slip / 0.5).limit(p, normal=Unilateral(), **NOW)
        assert_allclose(np.where(at_rest, 0.0, found.bound), moving * ~at_rest)
        assert_allclose(found.bound[at_rest], now.limit(p, normal=Unilateral(), **NOW)[at_rest])
        for k, sign in ((0, 1), (1, 1)):
            ends = [now.dragged(p, SHARES, Trial(size + s * h * np.eye(2)[k], gamma)).bound[k] for s in (sign, -sign)]
            assert_allclose(found.by_trial[k] * ~at_rest[k], (ends[0] - ends[1]) / (2 * h), atol=1e-8)
        ends = [[now.dragged(p + s * h * e, SHARES, Trial(size, gamma)).bound for e in np.eye(4)] for s in (1, -1)]
        slope = (np.array(ends[0]) - np.array(ends[1])).T / (2 * h)
        resting = law.at(np.zeros(2)).limit_slope(p, SHARES, Unilateral()).toarray()
        own = np.where(at_rest[:, None], resting, found.by_pressure.toarray())
        assert_allclose(own, slope, atol=1e-8)
    for none in (-p, 0 * p):
        found = now.dragged(none, SHARES, Trial(size, gamma))
        assert not found.bound.any()
        assert not found.by_pressure.toarray().any()
    assert not now.homogeneous(Unilateral(), 1.0, 1.0)
    assert replace(law, k_T=k_T).at(np.zeros(2)).k_T == k_T
    assert now.lines(Unilateral(), 1.0, 1.0) == (np.inf, 0.2, 1.0 if law is RATES[0] else np.inf)


@pytest.mark.parametrize("law", RATES[:2])
def test_a_rate_balances_its_trial_traction(law: RateDependent, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stickslip.solvers.laws.rate_dependent.NEWTON_STEPS", 60)
    size, p, gamma = (10.0 ** grid.ravel() for grid in np.meshgrid(*3 * [np.arange(-6.0, 7.0, 2.0)]))
    V = law.rate(size, p, gamma)
    left = law.coefficient(V) * p + gamma * V
    assert_allclose(left[V > 0], size[V > 0], rtol=20 * EPS)
    assert np.all(left[V == 0] >= size[V == 0])


def test_points_that_slide_radiate_where_they_press() -> None:
    """eta V = 0.21, 2.1 and 2.1 Pa on top of mu(V) p."""
    law, p, normal = RATES[2].at(np.array([0.3, 3.0, 3.0])), np.array([2.0, 0.0, -1.0]), Unilateral()
    assert_allclose(law.limit(p, np.eye(3), normal, 1.0, 1.0), [0.3 * 2.0 + 0.7 * 0.3, 0.0, 0.0])
    assert_allclose(law.limit_slope(p, sparse.identity(3, format="csr"), normal).toarray(), np.diag([0.3, 0.0, 0.0]))
    assert law.lines(normal, 1.0, 1.0) == (np.inf, pytest.approx(0.3), np.inf)
    assert RATES[2].at(np.zeros(2)).lines(normal, 1.0, 1.0) == (np.inf, 0.2, 0.2)
    assert RATES[2].at(np.zeros(0)).lines(normal, 1.0, 1.0) == (np.inf, np.inf, 0.0)
    other = law.of_points(np.array([2, 0]))
    assert_allclose(other.limit(np.ones(2), np.eye(2), normal, 1.0, 1.0), [1.0 + 0.7 * 3.0, 0.3 + 0.7 * 0.3])


@pytest.mark.parametrize(
    ("mu", "said"),
    [
        ("0.3*exp(-1e-3/V)", "has no finite value or no finite slope at V = 0"),
        ("0.3 + V/V", "has no finite value or no finite slope at V = 0"),
        ("0.3 + V**60", "has no finite value or no finite slope at V = 1.41e+05"),
        ("0.3 + 1e-2*V**1e-4", "has no finite value or no finite slope at V = 0"),
        ("0.3*V**3/(1 + V**3)", "is 0 at V = 0, so that nothing holds bodies at rest"),
        ("V - 1e-9", "is -1e-09 at V = 0; must not be negative"),
        ("0.3 - 0.2*exp(-((V-1.03e-1)/1e-4)**2)", "mu falls as the slip rate grows"),
        ("0.3 + 0.1*V + 0.01*sin(200*V)*exp(-V)", "mu falls as the slip rate grows"),
        ("0.3 - 1e-20*V*exp(-1e14*V)*1e20", "mu falls as the slip rate grows"),
        ("0.3 - 0.2*exp(-((V - 0.103 + 2e-4)/1e-5)**2)", "mu falls as the slip rate grows"),  # below a number in it
        ("0.3 - 0.1*max(V - 9.5e5, 0)/1e6", "mu falls as the slip rate grows"),
        ("0.5 + V - 0.1*(3*V - 1)/abs(3*V - 1)", "mu falls as the slip rate grows"),  # at a jump alone
    ],
)
def test_an_expression_without_values_or_slopes_or_that_falls_is_refused_in_one_line(mu: str, said: str) -> None:
    with pytest.raises(SceneError) as caught:
        RateDependent(mu=mu)
    assert str(caught.value).startswith(f'mu = "{mu}": {said}')
    assert len(caught.value.lines) == 1


@pytest.mark.parametrize(
    "mu",
    [
        *("0.3", "0.3*(1 + V)/(1 + V)", "0.2 + 0.1*V**2/(1e-4 + V**2)", "0.2 + 0.1*sqrt(V)", "0.2 + 0.1*V/(V + 1e-3)"),
        *(
            "min(0.2 + 0.1*V, 0.5)",
            "max(0.2, 0.2 + 0.1*(V - 1))",
            "0.4 - 0.1*exp(-V/1e-3)",
            "0.2 + 0.01*log(1 + V/1e-6)",
            "0.3 + 1/(1 + exp(1e3 - 1e3*V))",
            "1e-3 + 0.3*V**3/(1 + V**3)",
            "0.1*pi",
            "0.3 + V**51.2",  # almost too large for a float
            "0.3 - 0.1*max(V - 2e6, 0)/1e6",  # falls beyond all speeds that are looked at
        ),
    ],
)
def test_an_expression_that_grows_or_stays_is_accepted_and_read_without_warnings(mu: str) -> None:
    law = RateDependent(mu=mu)
    assert np.isfinite([law.coefficient(SPEEDS), law.slope(SPEEDS)]).all()


def test_the_rate_of_a_step_without_length_is_that_of_rest() -> None:
    law, slip = RATES[0], np.array([0.0, 3.0])
    assert_array_equal(law.after(np.zeros(2), slip, 0.5), [0.0, 6.0])
    assert_array_equal(law.after(np.ones(2), slip, 0.0), [0.0, 0.0], strict=True)
    assert_array_equal(law.within(np.ones(2), 0.0).mu, [0.2, 0.2])  # type: ignore[attr-defined]
    assert law.resists()
    assert RateDependent(mu="0.3").resists()
    assert not RateDependent(mu="0").resists()
    assert not RateDependent(mu=((0.0, 0.0),)).resists()
    assert RATES[1].at(slip).lines(Unilateral(), 1.0, 1.0)[2] == np.inf
    assert_allclose(RATES[1].slope(slip), 0.1 / (1 + slip))


def test_directions_are_orthogonal_as_long_as_mu_and_along_the_axis() -> None:
    law, up = OrthotropicCoulomb(mu_1=0.2, mu_2=0.5, axis=(0.0, 3.0, 9.0)), np.array([[1.0, 0, 0], [0, 1.0, 0]])
    turned = np.array([[0.6, 0.8, 0.0], [0.8, -0.6, 0.0]])
    both = law.directions(np.array([up, turned]), np.ones((2, 2), bool))
    assert_allclose(both[:, 0], [[0.0, 0.4, 0.0]] * 2, atol=1e-15)
    assert_allclose(np.abs(both[:, 1]), [[1.0, 0.0, 0.0]] * 2, atol=1e-15)
    one = law.directions(np.array([turned]), np.array([[True, False]]))  # the ellipse, cut along the free direction
    assert_allclose(one[0, 0] / np.linalg.norm(one[0, 0]), turned[0])
    assert_allclose(np.linalg.norm(one[0, 0]) * 0.5, 1 / np.hypot(0.8 / 0.2, 0.6 / 0.5))
    assert_array_equal(Coulomb(mu=0.3).directions(up, np.ones((1, 2), bool)), up)
    short = replace(law, axis=(0.0, 1e-4, 3e-4))  # its length tells nothing
    assert_allclose(short.directions(np.array([up]), np.ones((1, 2), bool)), both[:1])
    with pytest.raises(SceneError, match=r"axis = \[0.0, 3.0, 0.0\]: is normal to the side at some point"):
        OrthotropicCoulomb(mu_1=0.2, mu_2=0.5, axis=AXIS).directions(np.eye(3)[None, [0, 2]], np.ones((1, 2), bool))


MU, TOP = 0.3, sheared_column.TOP
PRESSED: list[NormalLaw] = [Unilateral(), Compliance(c_n=4.0, m_n=2.0)]


@pytest.mark.parametrize("normal", PRESSED)
def test_bound_is_that_of_coulomb_and_no_more_than_the_cap(normal: NormalLaw) -> None:
    p = np.array([1.0, 4.0, 9.0, 0.0])  # averages 0.9 and 3.2
    for s_max, expected in ((2.0, [0.45, 1.6]), (1.0, [0.45, 1.0]), (0.4, [0.4, 0.4])):
        assert_allclose(CappedCoulomb(mu=0.5, s_max=s_max).limit(p, normal=normal, **NOW), expected, rtol=1e-15)
    assert_array_equal(CappedCoulomb(mu=0.5, s_max=1.0).limit(-p, normal=normal, **NOW), 0.0)  # what pulls has none


@pytest.mark.parametrize(
    ("method", "cap", "k_T"),
    every_nth(2, ["condensed-newton", "uzawa", "surface-uzawa"], [(2.0, 2.0), (5.0, 3.0)], [None, K_T]),
)
def test_sheared_column_slips_at_the_cap_or_at_mu_p(method: str, cap: tuple[float, float], k_T: float | None) -> None:
    s_max, bound = cap
    law = CappedCoulomb(mu=MU, s_max=s_max, k_T=k_T)
    states = bases(scene(dim=2, method=method, E=E, friction=law, path=TOP[:, None]))
    exact = replace(sheared_column.COLUMN, bound=bound, k_T=k_T or np.inf)
    assert not failures(compare("capped", states, PRESSURE, exact, TOP))  # traction, slip, dissipation: within 1e-9
    assert_allclose(states[2].tangential_force, bound, rtol=1e-9)  # steady slip over 1 m: 2 or 3 N
    assert np.all(states[1].status == STICK)
    assert np.all(states[2].status == SLIP)
    assert failures(compare("without the law", states, PRESSURE, replace(exact, bound=1.1 * bound), TOP))


def test_without_friction_the_column_fails() -> None:
    states = bases(
        scene(dim=2, method="condensed-newton", E=E, friction=CappedCoulomb(mu=0.0, s_max=2.0), path=TOP[:, None])
    )
    checks = compare("smooth", states, PRESSURE, replace(sheared_column.COLUMN, bound=2.0), TOP)
    assert {check.name for check in checks if check.passed} == {
        "smooth: pressure [Pa]",
        "smooth, top at +1 mm (move 1): dissipation so far [J]",  # a move that only sticks dissipates nothing either
    }


@pytest.mark.parametrize("dim", [2, 3])
def test_a_block_is_capped_where_it_presses_hard_and_follows_mu_p_where_it_does_not(dim: int) -> None:
    """Bent by the drag, one end presses harder: both branches of the law at once, audited."""
    mu, s_max, up = 0.3, 0.03, "xyz"[dim - 1]
    drive = {"x": [[0, 0], [1, 0], [2, 0.2]], up: [[0, 0], [1, -0.08]]}
    friction = {"law": "capped_coulomb", "mu": mu, "s_max": s_max}
    simulation = prepare(
        scene_of(
            dim,
            {"mesh_size": 0.25},
            contacts={"base": {"surface": "block.bottom", "against": "foundation", "friction": friction}},
            supports={"top": {"boundary": "block.top", "displacement": drive}},
            steps={"end": 2.0, "count": 4},
            solver={"tolerance": 1e-11},
        )
    )
    audit = Auditor(simulation.problem, simulation.mesh)
    for step in simulation.steps():
        record = record_of(step)
        assert max(asdict(audit(record)).values()) < 1e-9
    base = step.contacts["base"]
    capped, slipping = mu * base.pressure > s_max, base.status == SLIP
    traction = np.linalg.norm(base.traction, axis=1)
    assert min(np.sum(capped & slipping), np.sum(~capped & slipping)) > 2
    assert_allclose(traction[slipping], np.minimum(mu * base.pressure, s_max)[slipping], rtol=1e-9)


def test_a_floating_block_rests_below_the_cap_and_there_is_no_equilibrium_beyond_it() -> None:
    """Pressed by 0.2 Pa over 2 m: mu p = 0.06 Pa, a cap of 0.05 Pa holds 0.1 N."""

    friction = {"law": "capped_coulomb", "mu": MU, "s_max": 0.05}
    for force, held in ((0.098, True), (0.102, False)):
        scene = scene_of(
            geometry={"mesh_size": 0.5},
            contacts={"base": {"surface": "block.bottom", "against": "foundation", "friction": friction}},
            loads={
                "press": {"boundary": "block.top", "pressure": 0.2},
                "pull": {"boundary": "block.bottom", "traction": [force / 2.0, 0.0]},
            },
        )
        make_plan(scene)
        steps = prepare(scene).steps()
        if held:
            assert_allclose([*steps][-1].contacts["base"].force[0], -force, rtol=1e-8)
        else:
            with pytest.raises(StepError, match="contact and friction cannot balance the loads"):
                list(steps)


METHODS = ("condensed-newton", "uzawa")
LAWS: dict[str, dict[str, Any]] = {
    "coulomb": {"friction": {"law": "coulomb", "mu": 0.15, "k_T": 4.0}},
    "tresca": {"friction": {"law": "tresca", "bound": [[0, 0.01]], "k_T": 4.0}, "normal": {"law": "bilateral"}},
    "penetration": {
        "friction": {"law": "compliance", "c_T": 30.0, "m_T": 2.0},
        "normal": {"law": "compliance", "c_n": 40.0, "m_n": 1.5},
    },
    "penetration, k_T": {
        "friction": {"law": "compliance", "c_T": 0.8, "m_T": 1.0, "k_T": 4.0},
        "normal": {"law": "compliance", "c_n": 40.0, "m_n": 1.5},
    },
}


def rubbed(law: str, method: str, count: int = 4, dim: int = 2, geometry: dict[str, Any] | None = None) -> Scene:
    """A block pressed, then its top driven there, back and there again; in 3D also across."""
    drive = {"x": [[1, 0], [2, 0.06], [3, -0.06], [4, 0.06]], "xyz"[dim - 1]: [[0, 0], [1, -0.08]]}
    if dim == 3:
        drive["y"] = [[2, 0], [3, 0.06]]
    return scene_of(
        dim,
        geometry,
        contacts={"base": {"surface": "block.bottom", "against": "foundation"} | LAWS[law]},
        supports={"top": {"boundary": "block.top", "displacement": drive}},
        steps={"end": 4.0, "count": count},
        solver={"method": method, "tolerance": 1e-10},
    )


@pytest.mark.parametrize(
    ("law", "method", "shape"),
    [
        *every_nth(2, LAWS, METHODS, [(2, {})]),
        *every_nth(3, LAWS, METHODS[:1], [(2, {"order": 2}), (3, {}), (3, {"cells": "tensor"})]),
    ],
)
def test_history_is_audited_clean_and_its_energy_is_all_there(
    law: str, method: str, shape: tuple[int, dict[str, Any]]
) -> None:
    dim, geometry = shape
    simulation = prepare(rubbed(law, method, dim=dim, geometry=geometry))
    audit = Auditor(simulation.problem, simulation.mesh)
    seen: set[int] = set()
    for step in simulation.steps():
        assert max(asdict(audit(record_of(step))).values()) < 1e-8  # solver.tolerance is 1e-10
        energy = step.energy
        assert_allclose(energy.external, energy.stored + energy.contact, rtol=1e-8)
        assert step.contacts["base"].dissipation >= -1e-10 * energy.external
        seen |= set(step.contacts["base"].status.tolist())
    assert seen >= {SLIP, STICK}
    assert energy.dissipated > 0.01 * energy.stored


@pytest.mark.parametrize("law", ["coulomb", "tresca"])
def test_slip_is_what_the_give_leaves(law: str) -> None:
    """The audit counts slip from w - t/k_T: with the whole displacement a stuck point would seem to slip."""
    scene = rubbed(law, "condensed-newton", count=32)
    simulation = prepare(scene)
    steps = {step.time: step for step in simulation.steps()}
    (place,) = simulation.stepper.cone.places
    before, after = steps[2.0], steps[2.125]  # where the drive turns back
    expected = (before.w - before.p / 4.0)[place.tangential]  # k_T = 4 Pa/m
    assert_allclose(after.reference[place.tangential], expected, atol=1e-15)
    assert np.any(after.contacts["base"].status == STICK)
    audit = Auditor(resolve(scene), simulation.mesh)
    assert audit(record_of(after)).complementarity < 1e-8
    assert audit(replace(record_of(after), reference=before.w)).complementarity > 1e-3


@pytest.mark.parametrize("law", LAWS)
def test_time_remainder_falls_with_the_step(law: str) -> None:
    remainders, loops = [], []
    for count in (16, 32):
        *_, last = prepare(rubbed(law, "condensed-newton", count)).steps()
        remainders.append(abs(last.energy.time_remainder) / last.energy.dissipated)
        loops.append(last.energy.dissipated)
    assert remainders[1] < 0.7 * remainders[0]  # first order: a half
    assert remainders[1] < 0.1


@pytest.mark.parametrize(("law", "relaxation"), every_nth(2, LAWS, [0.3, 1.9]))
def test_uzawa_is_admissible(law: str, relaxation: float) -> None:
    simulation = prepare(rubbed(law, "uzawa"))
    stepper = simulation.stepper
    problem = stepper.reach(stepper.start(), 1.0, lambda row: None).problem
    (place,) = problem.cone.places
    for max_it in (1, 2, 5, 20):
        p = Uzawa(relaxation=relaxation, rtol=1e-14, max_it=max_it)(problem, np.zeros(problem.cone.size)).p
        s = problem.cone.bound(place, p[place.normal])
        t = p[place.tangential].reshape(-1, place.components)
        assert np.all(np.linalg.norm(t, axis=1) <= s * (1 + 1e-15))
        assert np.all(p[place.normal] >= 0) or place.rows.normal.sides == 2
        assert np.any(t) or max_it == 1  # the first step sees bodies that move down as a whole, and do not widen yet


def test_bound_is_integrated_exactly() -> None:
    """A penetration of (2 + x) m, to the fifth: the quadrature of the pressure would not do."""
    laws = {"normal": {"law": "compliance", "c_n": 40.0}, "friction": {"law": "compliance", "c_T": 3.0, "m_T": 5.0}}
    top = {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0}}
    contact = {"surface": "block.bottom", "against": "foundation"} | laws
    (rows,) = system_of(scene_of(contacts={"base": contact}, supports={"top": top})).contacts
    u = np.zeros_like(rows.surface.points)
    u[:, 1] = -(2.0 + rows.surface.points[:, 0])
    s = rows.friction.limit(40.0 * (rows.N_n @ u.ravel()), rows.average, rows.normal, 1.0, 1.0)
    assert_allclose(rows.W_t @ s, 3.0 * (4.0**6 - 2.0**6) / 6, rtol=1e-13)  # block from x = 0 to 2 m


@pytest.mark.parametrize("friction", [{}, {"friction": {"law": "coulomb", "mu": 0.0}}])
def test_nothing_sticks_if_smooth(friction: dict[str, Any]) -> None:
    """Pressed between its symmetry planes no point of the base moves sideways: no slip, but no stick either."""
    scene = scene_of(
        contacts={"base": {"surface": "block.bottom", "against": "foundation"} | friction},
        supports={
            "top": {"boundary": "block.top", "displacement": {"y": -0.01}},
            "left": {"boundary": "block.left", "displacement": {"x": 0.0}},
            "right": {"boundary": "block.right", "displacement": {"x": 0.0}},
        },
    )
    (step,) = prepare(scene).steps()
    base = step.contacts["base"]
    assert base.max_slip < 1e-12
    assert (base.stick_area, base.slip_area) == (0.0, base.contact_area)
    assert_allclose(base.contact_area, 2.0)
