"""Problems with tangents in place of powers lead to the solution with the powers."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from geometry.arrays import Array
from solvers.interface.problem import SurfaceProblem
from solvers.methods.condensed_newton import CondensedNewton
from solvers.newton import condensed_system, path, simpler_laws
from solvers.newton.semismooth import SemismoothNewton
from solvers.newton.solution import Solution, Status
from solvers.scene.scene import Scene
from solvers.simulation.simulation import Simulation

SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]
COULOMB = {"law": "coulomb", "mu": 0.4}
CAPPED = {"law": "capped_coulomb", "mu": 0.4, "s_max": 0.06}


@pytest.fixture
def problem_of(scene_of: SceneOf, simulation_of: SimulationOf) -> Callable[..., SurfaceProblem]:
    """A block pressed and dragged in one step, on a surface that gives way."""

    def make(m_n: float = 2.0, friction: dict[str, Any] | None = COULOMB) -> SurfaceProblem:
        base = {"surface": "block.bottom", "against": "foundation"} | ({"friction": friction} if friction else {})
        law = {"law": "compliance", "c_n": 40.0, "m_n": m_n}
        drag = {"top": {"boundary": "block.top", "displacement": {"x": 0.06, "y": -0.1}}}
        stepper = simulation_of(scene_of(contacts={"base": base | {"normal": law}}, supports=drag)).stepper
        return stepper.reach(stepper.start(), 1.0, lambda row: None).problem

    return make


def newton(problem: SurfaceProblem, p: Array) -> Solution:
    return SemismoothNewton(rtol=1e-12, max_it=200, linear=condensed_system.solve)(problem, p)


@pytest.mark.parametrize("friction", [COULOMB, CAPPED, {"law": "compliance", "c_T": 10.0, "m_T": 1.5}])
def test_simpler_laws_lead_to_the_solution(friction: dict[str, Any], problem_of: Callable[..., SurfaceProblem]) -> None:
    problem = problem_of(2.0, friction)
    exact = newton(problem, np.zeros(len(problem.gap)))
    assert exact.status is Status.CONVERGED
    ends = list(simpler_laws.ends(problem, np.zeros(len(problem.gap)), newton))
    off = [np.abs(end.p - exact.p).max() / exact.p.max() for end in ends]
    assert len(ends) >= 3
    assert off[0] < 10 * simpler_laws.NEAR
    assert off[-1] < 1e-9


def test_the_problem_of_tangents_is_piecewise_linear(problem_of: Callable[..., SurfaceProblem]) -> None:
    problem = problem_of()
    n = problem.surface.normal_rows
    p = np.where(np.arange(len(problem.gap)) < n, 0.3, 0.1)
    simpler = simpler_laws.simplified(problem, p, 1e-3)
    assert not path.applies(problem)
    assert path.applies(simpler)
    # at the pressure of the tangent both laws have the same penetration, and nearly so beside it
    for factor, apart in ((1.0, 1e-14), (1.01, 1e-4)):
        give = [of.cone.give(factor * p)[:n] + of.gap[:n] for of in (problem, simpler)]
        assert_allclose(give[1], give[0], rtol=apart)
    assert not np.allclose(simpler.cone.give(2 * p)[:n] + simpler.gap[:n], problem.cone.give(2 * p)[:n], rtol=1e-2)


def test_open_points_have_tangents_at_the_floor(problem_of: Callable[..., SurfaceProblem]) -> None:
    problem = problem_of()
    p = np.zeros(len(problem.gap))
    p[0] = 2.0
    (contact,) = simpler_laws.simplified(problem, p, 1e-2).cone.contacts
    slope = 2 * np.sqrt(40.0 * np.array([2.0, 0.02]))  # of c d^2 at p: 2 sqrt(c p)
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
    ],
)
def test_what_has_simpler_laws(
    m_n: float, friction: dict[str, Any] | None, expected: bool, problem_of: Callable[..., SurfaceProblem]
) -> None:
    problem = problem_of(m_n, friction)
    assert simpler_laws.applies(problem) is expected
    if not expected:
        assert not list(simpler_laws.ends(problem, np.zeros(len(problem.gap)), newton))


def test_bounds_are_those_at_the_last_pressures(problem_of: Callable[..., SurfaceProblem]) -> None:
    problem = problem_of(2.0, CAPPED)
    n = problem.surface.normal_rows
    p = np.where(np.arange(len(problem.gap)) < n, 0.3, 0.0)
    simpler = simpler_laws.simplified(problem, p, 1e-3)
    (place,), (before,) = simpler.cone.places, problem.cone.places
    assert_allclose(simpler.cone.bound(place, p[:n]), 0.06)
    assert_allclose(simpler.cone.bound(place, p[:n] / 3), 0.02)
    assert_allclose(problem.cone.bound(before, p[:n] / 3), 0.04)


def test_no_end_where_the_simpler_problem_is_not_solved(problem_of: Callable[..., SurfaceProblem]) -> None:
    problem = problem_of()
    lost = CondensedNewton(max_it=0)
    assert not list(simpler_laws.ends(problem, np.zeros(len(problem.gap)), lost))
