"""Bounds of friction laws beyond Coulomb's: their slopes, their lines, and what remembers slip."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import sparse

from stickslip.geometry.errors import SceneError
from stickslip.solvers.laws.bilateral import Bilateral
from stickslip.solvers.laws.cohesion import Cohesion
from stickslip.solvers.laws.coulomb_by_point import CoulombByPoint
from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.laws.law import FrictionLaw, Trial
from stickslip.solvers.laws.orthotropic_coulomb import OrthotropicCoulomb
from stickslip.solvers.laws.pressure_dependent import PressureDependent
from stickslip.solvers.laws.rate_dependent import RateDependent
from stickslip.solvers.laws.slip_dependent import SlipDependent, StaticKinetic
from stickslip.solvers.laws.unilateral import Unilateral

AXIS = (0.0, 3.0, 0.0)
PLAIN: list[FrictionLaw] = [
    Cohesion(a=0.7, mu=0.3),
    PressureDependent(mu=((0.5, 0.5), (2.0, 0.4), (4.0, 0.6))),
    OrthotropicCoulomb(mu_1=0.2, mu_2=0.5, axis=AXIS),
]
SHARES = sparse.csr_matrix([[0.7, 0.5, -0.2, 0.0], [0.0, -0.1, 0.4, 0.7]])  # dual functions are negative somewhere
NOW: dict[str, Any] = {"normal": Unilateral(), "time": 1.0, "end": 1.0}


@pytest.mark.parametrize("law", PLAIN)
def test_slope_of_the_bound_is_its_derivative(law: FrictionLaw) -> None:
    h = 1e-6
    for p in (np.array([1.0, 4.0, 9.0, 0.0]), np.array([-1.0, -4.0, 9.0, 1.0])):
        at = [[law.limit(p + sign * h * e, average=SHARES, **NOW) for e in np.eye(4)] for sign in (1, -1)]
        slope = (np.array(at[0]) - np.array(at[1])).T / (2 * h)
        assert_allclose(law.limit_slope(p, SHARES, Unilateral()).toarray(), slope, atol=1e-9)  # eps / h


@pytest.mark.parametrize("law", PLAIN)
def test_lines_are_the_bound_from_both_sides(law: FrictionLaw) -> None:
    p = np.linspace(0.01, 20.0, 500)
    cap, below, above = law.lines(Unilateral(), 1.0, 1.0)
    s = law.limit(p, average=sparse.identity(500, format="csr"), **NOW) - law.at_no_pressure
    assert np.all(np.minimum(cap, below * p) <= s * (1 + 1e-14))
    assert np.all(s <= np.minimum(cap, above * p) * (1 + 1e-14))
    assert law.homogeneous(Unilateral(), 1.0, 1.0) == (law is PLAIN[2])


def test_cohesion_holds_where_surfaces_press_and_everywhere_if_they_cannot_part() -> None:
    law, alone, p = Cohesion(a=0.7, mu=0.3), sparse.identity(3, format="csr"), np.array([-1.0, 0.0, 2.0])
    assert_allclose(law.limit(p, average=alone, **NOW), [0.0, 0.0, 1.3])
    assert_allclose(law.limit(p, average=alone, **NOW | {"normal": Bilateral()}), [0.7, 0.7, 1.3])
    assert law.resists()
    assert Cohesion(a=0.7, mu=0.0).resists()
    assert not Cohesion(a=0.0, mu=0.0).resists()


def test_a_bound_that_would_fall_as_the_pressure_grows_is_refused() -> None:
    PressureDependent(mu=((0.0, 0.4), (2.0, 0.2)))  # s = 0.4 p - 0.1 p^2 is level at 2 Pa
    with pytest.raises(SceneError, match="the bound mu p_n falls as the pressure grows"):
        PressureDependent(mu=((0.0, 0.4), (2.0, 0.19)))
    assert not PressureDependent(mu=((0.0, 0.0),)).resists()


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
        assert_allclose(law.weakening, 0.1)
    assert not StaticKinetic(mu_s=0.0, mu_k=0.0, slip_length=1.0).resists()
    assert Coulomb(mu=0.3).at(slid) == Coulomb(mu=0.3)


RATES = [RateDependent(mu=((0.1, 0.2), (0.5, 0.4), (2.0, 1.0))), RateDependent(mu="0.2 + 0.1*log(1 + V) + 0*abs(V)")]


@pytest.mark.parametrize("k_T", [None, 3.0])
@pytest.mark.parametrize("law", RATES)
def test_the_bound_of_slip_in_a_step_is_that_of_its_rate_and_has_its_derivatives(
    law: RateDependent, k_T: float | None
) -> None:
    now = replace(law, k_T=k_T).within(np.zeros(2), 0.5)
    p, gamma, h = np.array([1.0, 4.0, 9.0, 1.0]), np.array([2.0, 5.0]), 1e-6
    for size in (np.array([0.1, 0.2]), np.array([3.0, 6.0]), np.array([9.0, 40.0])):
        found = now.dragged(p, SHARES, Trial(size, gamma))
        slip = np.maximum(size - found.bound * (1 + gamma * now.softness), 0.0) / gamma  # of t + gamma (slip + t/k_T)
        at_rest = size <= now.limit(p, average=SHARES, **NOW) * (1 + gamma * now.softness)
        assert_allclose(np.where(at_rest, 0.0, found.bound), law.at(slip / 0.5).limit(p, SHARES, **NOW) * ~at_rest)
        assert_allclose(found.bound[at_rest], now.limit(p, average=SHARES, **NOW)[at_rest])
        for k, sign in ((0, 1), (1, 1)):
            ends = [now.dragged(p, SHARES, Trial(size + s * h * np.eye(2)[k], gamma)).bound[k] for s in (sign, -sign)]
            assert_allclose(found.by_trial[k] * ~at_rest[k], (ends[0] - ends[1]) / (2 * h), atol=1e-8)
        ends = [[now.dragged(p + s * h * e, SHARES, Trial(size, gamma)).bound for e in np.eye(4)] for s in (1, -1)]
        slope = (np.array(ends[0]) - np.array(ends[1])).T / (2 * h)
        resting = law.at(np.zeros(2)).limit_slope(p, SHARES, Unilateral()).toarray()
        own = np.where(at_rest[:, None], resting, found.by_pressure.toarray())
        assert_allclose(own, slope, atol=1e-8)


def test_the_rate_of_a_step_without_length_is_that_of_rest() -> None:
    law, slip = RATES[0], np.array([0.0, 3.0])
    assert_array_equal(law.after(np.zeros(2), slip, 0.5), [0.0, 6.0])
    assert_array_equal(law.after(np.ones(2), slip, 0.0), [0.0, 0.0])
    assert_array_equal(law.within(np.ones(2), 0.0).mu, [0.2, 0.2])  # type: ignore[attr-defined]
    assert law.resists()
    assert not RateDependent(mu="0").resists()
    assert not RateDependent(mu=((0.0, 0.0),)).resists()
    assert law.within(slip, 0.5).lines(Unilateral(), 1.0, 1.0) == (np.inf, 0.2, 1.0)
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
    with pytest.raises(SceneError, match=r"axis = \[0.0, 3.0, 0.0\]: is normal to the side at some point"):
        OrthotropicCoulomb(mu_1=0.2, mu_2=0.5, axis=AXIS).directions(np.eye(3)[None, [0, 2]], np.ones((1, 2), bool))
