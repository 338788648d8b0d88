"""Problems with tangents in place of powers lead to the solution with the powers."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.geometry.arrays import Array
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Solution, Status
from stickslip.solvers.laws.coulomb_by_point import CoulombByPoint
from stickslip.solvers.methods.condensed_newton import CondensedNewton
from stickslip.solvers.newton import condensed_system, path, semismooth
from stickslip.solvers.newton.semismooth import SemismoothNewton
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation

SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]
COULOMB = {"law": "coulomb", "mu": 0.4}
CAPPED = {"law": "capped_coulomb", "mu": 0.4, "s_max": 0.06}


@pytest.fixture
def problem_of(scene_of: SceneOf, simulation_of: SimulationOf) -> Callable[..., SurfaceProblem]:
    """A block pressed and dragged in one step, on a surface that gives way; by tractions if it floats."""

    def make(m_n: float = 2.0, friction: dict[str, Any] | None = COULOMB, floating: bool = False) -> SurfaceProblem:
        base = {"surface": "block.bottom", "against": "foundation", "gap_offset": -0.01}
        base |= {"friction": friction} if friction else {}
        law = {"law": "compliance", "c_n": 40.0, "m_n": m_n}
        drag = {"supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.06, "y": -0.1}}}}
        pull = {"loads": {"pull": {"boundary": "block.top", "traction": [0.02, -0.1]}}}
        stepper = simulation_of(
            scene_of(contacts={"base": base | {"normal": law}}, **pull if floating else drag)
        ).stepper
        return stepper.reach(stepper.start(), 1.0, lambda row: None).problem

    return make


def newton(problem: SurfaceProblem, p: Array) -> Solution:
    return SemismoothNewton(rtol=1e-12, max_it=200, linear=condensed_system.solve)(problem, p)


@pytest.mark.parametrize("friction", [COULOMB, CAPPED, {"law": "compliance", "c_T": 10.0, "m_T": 1.5}])
@pytest.mark.parametrize("floating", [False, True])
def test_simpler_laws_lead_to_the_solution(
    floating: bool, friction: dict[str, Any], problem_of: Callable[..., SurfaceProblem]
) -> None:
    problem = problem_of(2.0, friction, floating=floating)
    exact = newton(problem, np.zeros(len(problem.gap)))
    assert exact.status is Status.CONVERGED
    ends = list(semismooth.simpler_ends(problem, np.zeros(len(problem.gap)), newton))
    off = [np.abs(end.p - exact.p).max() / exact.p.max() for end in ends]
    assert len(ends) >= 3
    assert off[0] < 10 * semismooth.NEAR
    assert off[-1] < 1e-9


def test_the_problem_of_tangents_is_piecewise_linear(problem_of: Callable[..., SurfaceProblem]) -> None:
    problem = problem_of()
    n = problem.surface.normal_rows
    p = np.where(np.arange(len(problem.gap)) < n, 0.3, 0.1)
    simpler = semismooth.simplified(problem, p, 1e-3)
    assert not path.applies(problem)
    assert path.applies(simpler)
    assert (simpler.cone.time, simpler.cone.end) == (problem.cone.time, problem.cone.end) == (1.0, 1.0)
    # at the pressure of the tangent both laws have the same penetration, and nearly so beside it
    for factor, apart in ((1.0, 1e-14), (1.01, 1e-4)):
        give = [of.cone.give(factor * p)[:n] + of.gap[:n] for of in (problem, simpler)]
        assert_allclose(give[1], give[0], rtol=apart)
    assert not np.allclose(simpler.cone.give(2 * p)[:n] + simpler.gap[:n], problem.cone.give(2 * p)[:n], rtol=1e-2)


def test_open_points_have_tangents_at_the_floor(problem_of: Callable[..., SurfaceProblem]) -> None:
    problem = problem_of()
    p = np.zeros(len(problem.gap))
    p[0] = 0.5
    (contact,) = semismooth.simplified(problem, p, 1e-2).cone.contacts
    slope = 2 * np.sqrt(40.0 * np.array([0.5, 0.005]))  # of c d^2 at p: 2 sqrt(c p)
    assert_allclose(contact.normal.k[:2], slope, rtol=1e-12)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("m_n", "friction", "expected"),
    [
        (2.0, COULOMB, True),
        (2.0, None, True),
        (1.0, COULOMB, False),  # linear already
        (2.0, {"law": "capped_coulomb", "mu": 0.4, "s_max": 0.1}, True),
        (1.0, {"law": "capped_coulomb", "mu": 0.4, "s_max": 0.1}, True),
        (2.0, {"law": "compliance", "c_T": 10.0, "m_T": 1.5}, True),
        (2.0, {"law": "tresca", "bound": 0.1}, False),
        (2.0, {"law": "stick"}, False),
    ],
)
def test_what_has_simpler_laws(
    m_n: float, friction: dict[str, Any] | None, expected: bool, problem_of: Callable[..., SurfaceProblem]
) -> None:
    problem = problem_of(m_n, friction)
    assert semismooth.has_simpler_laws(problem) is expected
    if not expected:
        assert not list(semismooth.simpler_ends(problem, np.zeros(len(problem.gap)), newton))


def test_bounds_are_those_at_the_last_pressures(problem_of: Callable[..., SurfaceProblem]) -> None:
    problem = problem_of(2.0, CAPPED)
    n = problem.surface.normal_rows
    p = np.where(np.arange(len(problem.gap)) < n, 0.3, 0.0)
    simpler = semismooth.simplified(problem, p, 1e-3)
    (place,), (before,) = simpler.cone.places, problem.cone.places
    assert_allclose(simpler.cone.bound(place, p[:n]), 0.06)
    assert_allclose(simpler.cone.bound(place, p[:n] / 3), 0.02)
    assert_allclose(problem.cone.bound(before, p[:n] / 3), 0.04)


def test_no_end_where_the_simpler_problem_is_not_solved(problem_of: Callable[..., SurfaceProblem]) -> None:
    problem = problem_of()
    lost = CondensedNewton(max_it=0)
    assert not list(semismooth.simpler_ends(problem, np.zeros(len(problem.gap)), lost))


def test_a_tangent_is_a_spring_that_only_presses() -> None:
    """Its resolvent solves p + gamma p / k = p_hat where that is positive."""
    k, gamma, p_hat = np.array([2.0, 3.0, 4.0]), np.array([1.0, 5.0, 0.5]), np.array([-1.0, 0.3, 2.0])
    law = semismooth.Tangent(k=k)
    p = law.resolvent(p_hat, gamma)
    assert_allclose(p + gamma * law.penetration(p), [0.0, 0.3, 2.0])
    assert_allclose(law.penetration(p), p / k)
    assert_allclose(law.stiffness(p, p_hat), [0.0, 3.0, 4.0])


def test_a_bound_of_the_same_power_as_the_pressure_becomes_coulombs(
    problem_of: Callable[..., SurfaceProblem],
) -> None:
    """c_T d^2 is (c_T / c_n) p; under a tangent the bound would be another one."""
    problem = problem_of(2.0, {"law": "compliance", "c_T": 12.0, "m_T": 2.0, "k_T": 4.0})
    (contact,) = semismooth.simplified(problem, np.ones(len(problem.gap)), 1e-3).cone.contacts
    assert isinstance(contact.friction, CoulombByPoint)
    assert_allclose(contact.friction.mu, 12.0 / 40.0, rtol=1e-12)
    assert contact.friction.k_T == 4.0


def test_floors_fall_to_the_last(problem_of: Callable[..., SurfaceProblem], monkeypatch: pytest.MonkeyPatch) -> None:
    problem, seen = problem_of(), list[float]()
    simplified = semismooth.simplified
    monkeypatch.setattr(semismooth, "simplified", lambda *of: seen.append(of[-1]) or simplified(*of))
    list(semismooth.simpler_ends(problem, np.zeros(len(problem.gap)), newton))
    assert len(seen) == semismooth.MOST
    assert seen == [*semismooth.FLOOR, *[semismooth.FLOOR[-1]] * (len(seen) - len(semismooth.FLOOR))]
