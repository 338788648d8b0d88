"""Linear saddle points: the bound on alpha is sharp, inexact solves keep to their rates; projection only helps."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.linalg import eigvalsh

from shared.problems import surface_problem
from stickslip.solvers.classical.uzawa import Uzawa
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.iteration import Status
from stickslip.solvers.methods.condensed_newton import CondensedNewton
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.lab.analysis.saddle_points import (
    Bounds,
    Exact,
    InexactRichardson,
    Inner,
    Reducing,
    SaddlePoint,
    Tied,
    Worst,
    conjugate_gradients,
    dual,
    measured,
    membrane,
)
from stickslip.workflows.lab.studies import saddle_points as study

Array = NDArray[np.float64]
SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]
SOFTNESS = (0.0, 0.3)  # C = 0 and C != 0
ROUNDING = 1e-5  # of an error that has fallen to 1e-10, condition some 1e2 and more
RULES = [Reducing(0.02), Reducing(0.2), Tied(0.05), Tied(0.5)]


def metric(m: int, seed: int = 3) -> Array:
    """A positive definite Q (m, m), not diagonal."""
    root = np.random.default_rng(seed).normal(size=(m, m))
    return np.asarray(np.eye(m) + root @ root.T / m)


def at_random(m: int, n: int, soft: bool, seed: int) -> SaddlePoint:
    """A problem without any structure; C is singular where it is not zero."""
    random = np.random.default_rng(seed)
    root, C = random.normal(size=(n, n)), np.diag(np.arange(m) * float(soft))
    B, p, q = random.normal(size=(m, n)), random.normal(size=n), random.normal(size=m)
    return SaddlePoint(A=root @ root.T + np.eye(n), B=B, C=C, p=p, q=q)


PROBLEMS = {
    "membrane": (membrane(6), np.eye(6) / 7),
    "soft membrane": (membrane(6, softness=0.3), np.eye(6) / 7),
    "random": (at_random(5, 9, False, 1), metric(5)),
    "random, C": (at_random(5, 9, True, 2), metric(5)),
}
every_problem = pytest.mark.parametrize(("problem", "Q"), PROBLEMS.values(), ids=PROBLEMS)


def run(
    problem: SaddlePoint, Q: Array, inner: Inner, part: float, iterations: int = 1500
) -> tuple[Array, float, float]:
    """Errors from a random start; factor and weight of theory."""
    bounds = Bounds.of(problem, Q)
    alpha = part * bounds.limit
    start = np.random.default_rng(7).normal(size=len(problem.q))
    method = InexactRichardson(alpha=alpha, Q=Q, inner=inner, iterations=iterations)
    return method(problem, np.zeros(len(problem.p)), start), *inner.rate(bounds, alpha)


@every_problem
def test_the_bound_on_alpha_is_sharp(problem: SaddlePoint, Q: Array) -> None:
    largest = Bounds.of(problem, Q).eigenvalues[-1]
    for part in (0.99, 1.01):
        errors, rate, weight = run(problem, Q, Exact(), part)
        alpha = part * 2 / largest
        assert rate == pytest.approx(max(abs(1 - alpha * largest), rate if part < 1 else 0), rel=1e-12)
        worst, last = measured(errors, weight)
        assert worst <= rate * (1 + ROUNDING)  # in the norm of Q no single iteration does worse
        if part > 1:
            assert last == pytest.approx(1.02, rel=1e-6)  # |1 - 1.01 * 2|
            assert errors[-1, 1] > 1e6 * errors[0, 1]
        else:
            assert last == pytest.approx(rate, rel=1e-3)
            assert errors[-1, 1] < 1e-6 * errors[0, 1]


@every_problem
@pytest.mark.parametrize("part", [0.2, 0.5, 0.8])
def test_the_factor_is_that_of_the_eigenvalue_farthest_from_one(problem: SaddlePoint, Q: Array, part: float) -> None:
    errors, rate, weight = run(problem, Q, Exact(), part)
    assert measured(errors, weight)[1] == pytest.approx(rate, rel=2e-2)  # the slowest part prevails slowly


@every_problem
@pytest.mark.parametrize("inner", [*RULES, *map(Worst, RULES)], ids=str)
def test_no_inexact_iteration_does_worse_than_its_rate(problem: SaddlePoint, Q: Array, inner: Inner) -> None:
    for part in (0.3, 0.5, 0.8, 0.99):
        errors, rate, weight = run(problem, Q, inner, part, iterations=60)
        assert measured(errors, weight)[0] <= rate * (1 + ROUNDING)
        assert rate > Bounds.of(problem, Q).factor(part * Bounds.of(problem, Q).limit)  # there is a price


@every_problem
@pytest.mark.parametrize("inner", [Reducing(0.02), Reducing(0.2)], ids=str)
def test_the_rate_of_reducing_the_inner_residual_is_reached(problem: SaddlePoint, Q: Array, inner: Inner) -> None:
    """Near the limit the largest eigenvalue decides everywhere, and the residual that does most harm finds it."""
    errors, rate, weight = run(problem, Q, Worst(inner), 0.99)
    assert rate > 1
    assert measured(errors, weight)[1] == pytest.approx(rate, rel=1e-3)


@pytest.mark.parametrize("delta", [0.01, 0.1, 0.3])
def test_the_rate_is_the_published_one_where_that_holds(delta: float) -> None:
    """Bramble, Pasciak & Vassilev: S <= Q / alpha, C = 0; it is below 1 exactly if delta < (1 - gamma)/(3 - gamma)."""
    for name in ("membrane", "random"):
        problem, Q = PROBLEMS[name]
        bounds = Bounds.of(problem, Q)
        alpha = 1 / bounds.eigenvalues[-1]
        gamma = bounds.factor(alpha)
        published = (2 * delta + gamma + np.sqrt((2 * delta + gamma) ** 2 + 4 * delta * (1 - gamma))) / 2
        rate, weight = Reducing(delta).rate(bounds, alpha)
        assert rate == pytest.approx(published, rel=1e-12)
        assert weight == pytest.approx(alpha * delta / (1 + delta), rel=1e-12)  # their norm has Q / alpha for Q
        assert (rate < 1) == (delta < (1 - gamma) / (3 - gamma))


def test_exact_solves_are_the_limit_of_inexact_ones() -> None:
    problem, Q = PROBLEMS["soft membrane"]
    bounds = Bounds.of(problem, Q)
    exact, weight = Exact().rate(bounds, 0.5 * bounds.limit)
    assert (exact, weight) == (pytest.approx(bounds.factor(0.5 * bounds.limit), rel=1e-12), 0.0)
    for rule in (Reducing, Tied):
        rates = [rule(small).rate(bounds, 0.5 * bounds.limit)[0] - exact for small in (1e-3, 1e-4)]
        assert 0 < rates[1] < rates[0] / 9  # proportional to what is allowed


def test_conjugate_gradients_stop_where_they_are_told() -> None:
    problem, _ = PROBLEMS["membrane"]
    b, start = problem.p, np.ones(len(problem.p))
    for allowed in (1.0, 1e-3, 1e-9):
        x = conjugate_gradients(problem.A, b, start, allowed)
        assert dual(b - problem.A @ x, problem.A) <= allowed
    assert_allclose(conjugate_gradients(problem.A, b, start, 1e9), start)  # nothing to do


def test_taking_c_explicitly_costs_step_size() -> None:
    """Below 2 / lambda_max(B A^-1 B^T), which is enough for C = 0, it diverges, as fast as theory says."""
    problem, Q = PROBLEMS["soft membrane"]
    bounds = Bounds.of(problem, Q)
    part = 0.99 * 2 / bounds.s**2 / bounds.limit
    assert part > 1
    errors, rate, weight = run(problem, Q, Exact(), part)
    assert measured(errors, weight)[1] == pytest.approx(
        rate, rel=1e-3
    )  # few iterations until it is 1e12 times as large
    assert rate == pytest.approx(2 * part - 1, rel=1e-9)


def test_the_study_has_a_row_for_each_case(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "STEPS", (0.5, 1.1))
    monkeypatch.setattr(study, "NODES", 4)
    rows = list(study.table())
    assert len(rows) == 2 * 2 * len(study.RULES)
    exact = [row[3:] for row in rows if row[1] == "exact"]
    assert [row[2] == "diverges" for row in exact] == [False, True, False, True]
    assert exact[1][:2] == exact[3][:2] == ("1.2000", "1.2000")


# the contact problem itself: surface problem, metric W


def pressed(scene_of: SceneOf, normal: dict[str, Any], friction: dict[str, Any] | None, **tables: Any) -> Scene:
    """A coarse block, pressed and dragged in one step."""
    base: dict[str, Any] = {"surface": "block.bottom", "against": "foundation", "normal": normal}
    made = {
        "contacts": {"base": base | ({"friction": friction} if friction else {})},
        "supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.06, "y": -0.1}}},
    }
    return scene_of(2, **(made | tables))


def largest_eigenvalue(problem: SurfaceProblem) -> float:
    """Of W^-1 B K_B^-1 B^T [m/Pa], dense."""
    surface = problem.surface
    assert isinstance(surface, CondensedSurface)
    B = np.diag(surface.W) @ surface.N.toarray()
    return float(eigvalsh(B @ surface.flexibility @ B.T, np.diag(surface.W))[-1])


def distances(problem: SurfaceProblem, exact: Array, p: Array, alpha: float, iterations: int) -> Array:
    """||p_k - exact||_W of projected Uzawa."""
    found = []
    for _ in range(iterations):
        found.append(np.sqrt(problem.surface.W @ (p - exact) ** 2))
        w = problem.relative_displacement(problem.contact_displacement(p))
        p = problem.project(p + alpha * (w - problem.gap), alpha)
    return np.array(found)


def exactly(problem: SurfaceProblem) -> Array:
    solution = CondensedNewton(rtol=1e-12)(problem, np.zeros(problem.cone.size))
    assert solution.status is Status.CONVERGED
    return solution.p


UNILATERAL, BILATERAL = {"law": "unilateral"}, {"law": "bilateral"}
STICK, TRESCA = {"law": "stick"}, {"law": "tresca", "bound": 0.02}
ROUND = {"foundation": {"shape": "cylinder", "point": [1.0, -4.0], "radius": 4.0}}


def test_without_projection_the_bound_is_sharp_for_contact_too(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    problem = surface_problem(simulation_of(pressed(scene_of, BILATERAL, STICK)))
    largest, exact = largest_eigenvalue(problem), exactly(problem)
    assert largest <= problem.surface.lambda_max < largest * (1 + 1e-3)
    start = exact + np.random.default_rng(2).normal(size=len(exact))
    inside, outside = (distances(problem, exact, start, part * 2 / largest, 900) for part in (0.99, 1.01))
    assert inside[-1] < 1e-6 * inside[0]  # .98^900 = 1e-8
    assert inside[-1] / inside[-2] == pytest.approx(0.98, rel=1e-3)
    assert outside[-1] / outside[-2] == pytest.approx(1.02, rel=1e-6)  # |1 - alpha lambda_max|


@pytest.mark.parametrize(
    ("normal", "friction"), [(BILATERAL, TRESCA), (UNILATERAL, None)], ids=["bilateral, Tresca", "unilateral"]
)
def test_with_a_fixed_convex_set_the_bound_suffices(
    normal: dict[str, Any], friction: dict[str, Any] | None, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """Projection in the metric W is a contraction: the distance to the answer falls in every single iteration."""
    problem = surface_problem(simulation_of(pressed(scene_of, normal, friction, obstacles=ROUND)))
    largest, exact = largest_eigenvalue(problem), exactly(problem)
    start = problem.project(np.random.default_rng(2).normal(size=len(exact)), 1.0)
    found = distances(problem, exact, start, 0.99 * 2 / largest, 1500)
    assert np.all(found[1:] <= found[:-1] * (1 + 1e-12) + 1e-11 * found[0])
    assert found[-1] < 1e-6 * found[0]


def test_given_friction_that_pressure_switches_on_converges_below_the_bound(
    scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    problem = surface_problem(simulation_of(pressed(scene_of, UNILATERAL, TRESCA)))
    exact = exactly(problem)
    solution = Uzawa(relaxation=1.98, rtol=1e-10)(problem, np.zeros(len(exact)))
    assert solution.status is Status.CONVERGED
    assert_allclose(solution.p, exact, atol=1e-6 * problem.p_ref)
    n = problem.surface.normal_rows
    t, s = np.abs(exact[n:]), 0.02
    assert np.any(np.isclose(t, s, rtol=1e-9))  # some slip,
    assert np.any((t > 0) & (t < 0.9 * s))  # others stick


def test_the_bound_is_not_necessary_where_points_are_open(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """What is open does not take part: the points in contact alone have a smaller eigenvalue."""
    problem = surface_problem(simulation_of(pressed(scene_of, UNILATERAL, None, obstacles=ROUND)))
    exact = exactly(problem)
    assert np.mean(exact[: problem.surface.normal_rows] > 0) < 0.8
    found = distances(problem, exact, exact, 1.01 * 2 / largest_eigenvalue(problem), 1)
    assert found[0] == 0
    nearby = problem.project(exact * (1 + 1e-3 * np.random.default_rng(2).normal(size=len(exact))), 1.0)
    found = distances(problem, exact, nearby, 1.01 * 2 / largest_eigenvalue(problem), 2000)
    assert found[-1] < 1e-6 * found[0]


def test_compliance_taken_implicitly_costs_no_step_size(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """C != 0 within the projection: B K_B^-1 B^T alone bounds alpha, though S = B K_B^-1 B^T + C is far larger."""
    soft = {"law": "compliance", "c_n": 0.1}, {"law": "stick", "k_T": 0.1}
    problem = surface_problem(simulation_of(pressed(scene_of, *soft)))
    largest = largest_eigenvalue(problem)
    assert 2 * largest < 1 / 0.1  # C in the metric W
    exact = exactly(problem)
    start = np.abs(np.random.default_rng(2).normal(size=len(exact)))
    found = distances(problem, exact, start, 0.99 * 2 / largest, 300)
    assert np.all(found[1:] <= found[:-1] * (1 + 1e-12) + 1e-11 * found[0])
    assert found[-1] < 1e-6 * found[0]
