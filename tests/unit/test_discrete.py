"""Discrete Coulomb problems: u = W r + q, complementary point by point."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import sparse

from shared.discrete import ONE, random_problem
from stickslip.geometry.errors import SceneError
from stickslip.solvers.classical.nsgs import colours
from stickslip.solvers.interface.discrete import DiscreteProblem, discrete_problem, project_cone, residual
from stickslip.solvers.iteration import Status
from stickslip.solvers.method_registry import METHODS
from stickslip.solvers.stepping.discrete_chain import refuse_unusable, solve, usable

METHODS_USED = ("auto", "condensed-newton", "surface-uzawa", "uzawa", "nsgs")


def problem_of(W: Any, q: Any, mu: Any) -> DiscreteProblem:
    return discrete_problem(sparse.csr_matrix(W), np.asarray(q, float), np.asarray(mu, float))


def laws(r: Any, u: Any, mu: Any, dim: int) -> Iterator[float]:
    """How far r and u are from each of Coulomb's laws, written down one by one."""
    for (r_n, *r_T), (u_n, *u_T), m in zip(r.reshape(-1, dim), u.reshape(-1, dim), mu, strict=True):
        slip, traction = np.linalg.norm(u_T), np.linalg.norm(r_T)
        yield max(-r_n, 0.0)
        yield max(-u_n, 0.0)
        yield abs(r_n * u_n)
        yield max(traction - m * r_n, 0.0)
        yield abs(np.dot(u_T, r_T) + m * r_n * slip)


@pytest.mark.parametrize("method", METHODS_USED)
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("case", ONE)
def test_one_contact_has_its_closed_form(case: str, dim: int, method: str) -> None:
    """Scaled by 4 and 10, and turned into the plane, so that nothing is 1 by chance."""
    q, r, u = (np.array(values) for values in ONE[case])
    if dim == 2:
        q, r, u = (np.array([x[0], x[1] + x[2]]) for x in (q, r, u))
        if case == "sticks":
            r[1] = -q[1]
    problem = problem_of(4 * np.eye(dim), 10 * q, [0.5])
    found = solve(problem, method, 1e-10)
    assert found.solved
    assert_allclose(problem.reactions(found.solution.p), 10 / 4 * r, atol=1e-8)
    assert_allclose(problem.velocities(found.solution.p), 10 * u, atol=1e-8)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("method", "dim"), [("auto", 2), ("auto", 3), ("nsgs", 2), ("nsgs", 3)])
def test_rank_deficient_problems_satisfy_each_law(seed: int, method: str, dim: int) -> None:
    W, q, mu = random_problem(seed, dim=dim)
    problem = problem_of(W, q, mu)
    found = solve(problem, method, 1e-11)
    assert found.solved
    r, u = problem.reactions(found.solution.p), problem.velocities(found.solution.p)
    assert_allclose(u, W @ r + q, atol=1e-12 * np.abs(W).max())
    sizes = max(np.abs(r).max(), 1.0) * max(np.abs(q).max(), 1.0)
    assert max(laws(r, u, mu, dim)) < 1e-8 * sizes


def test_each_contact_has_its_own_coefficient() -> None:
    """Two equal contacts, pulled alike: the one with less friction slips, by what is missing."""
    problem = problem_of(np.eye(4), [-1.0, -0.5, -1.0, -0.5], [0.2, 0.6])
    for method in METHODS_USED:
        found = solve(problem, method, 1e-10)
        assert_allclose(problem.reactions(found.solution.p), [1.0, 0.2, 1.0, 0.5], atol=1e-8)


def test_a_coupled_pair_moves_as_computed_by_hand() -> None:
    """u_n1 = r1 + r2/2 - 1, u_n2 = r1/2 + r2 - 1 without friction: both press with 2/3."""
    W = np.kron(np.array([[1.0, 0.5], [0.5, 1.0]]), np.diag([1.0, 1.0]))
    problem = problem_of(W, [-1.0, 0.0, -1.0, 0.0], [0.0, 0.0])
    found = solve(problem, "auto", 1e-12)
    assert_allclose(problem.reactions(found.solution.p), [2 / 3, 0.0, 2 / 3, 0.0], atol=1e-10)


def test_the_residual_is_that_of_the_cone() -> None:
    """Nearest points of the cone, against a search over its boundary."""
    random = np.random.default_rng(2)
    x, mu = random.normal(size=(40, 3)), random.uniform(0.1, 2.0, 40)
    found = project_cone(x, mu)
    angle, height = np.meshgrid(np.linspace(0, 2 * np.pi, 721), np.linspace(0, 4, 401))
    for point, near, m in zip(x, found, mu, strict=True):
        assert np.linalg.norm(near[1:]) <= m * near[0] + 1e-12
        edge = np.stack([height, m * height * np.cos(angle), m * height * np.sin(angle)], axis=-1)
        nearest = np.linalg.norm(edge - point, axis=-1).min()
        inside = np.linalg.norm(point[1:]) <= m * point[0]
        assert np.linalg.norm(near - point) == pytest.approx(0.0 if inside else nearest, abs=2e-3)
    r, u = np.array([1.0, 0.3, 0.0]), np.array([0.0, -0.5, 0.0])  # slips although below its bound
    assert residual(r, u, np.array([0.5])) > 0.1


def test_the_scaled_problem_is_the_same_problem() -> None:
    W, q, mu = random_problem(1)
    problem = problem_of(W, q, mu)
    assert problem.surface.matrix.diagonal().max() == pytest.approx(1.0)
    assert np.linalg.norm(problem.q) == pytest.approx(1.0)
    p = np.random.default_rng(0).normal(size=len(q))
    assert_allclose(problem.velocities(p), W @ problem.reactions(p) + q, rtol=1e-10)
    w = problem.relative_displacement(problem.contact_displacement(p))
    N = problem.surface.N
    assert_allclose(-(N.T @ w) * problem.units[1], problem.velocities(p), rtol=1e-10)
    assert_array_equal((N @ np.arange(18.0))[:6], np.arange(0.0, 18.0, 3.0))  # normal rows first


def test_only_the_symmetric_part_counts() -> None:
    W, q, mu = random_problem(3)
    skew = np.triu(np.full_like(W, 1e-3), 1)
    one, other = problem_of(W + skew - skew.T, q, mu), problem_of(W, q, mu)
    assert_allclose(one.surface.flexibility, other.surface.flexibility, atol=1e-14)


@pytest.mark.parametrize("W", [np.zeros((4, 4)), np.diag([1.0, 1.0, 0.0, 0.0])])
def test_contacts_that_move_nothing_are_no_trap(W: Any) -> None:
    problem = problem_of(W, [0.5, 0.1, 0.5, 0.0], [0.3, 0.3])
    found = solve(problem, "auto", 1e-10)
    assert found.solved
    assert_allclose(problem.velocities(found.solution.p), [0.5, 0.1, 0.5, 0.0], atol=1e-10)


def test_without_q_there_is_nothing_to_do() -> None:
    problem = problem_of(np.eye(4), np.zeros(4), [0.3, 0.3])
    assert_array_equal(problem.reactions(solve(problem, "auto", 1e-10).solution.p), np.zeros(4))


@pytest.mark.parametrize("method", ["auto", "nsgs", "condensed-newton"])
def test_what_has_no_solution_is_not_called_solved(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """u_n = -1 whatever r is."""
    monkeypatch.setattr("stickslip.solvers.stepping.discrete_chain.MAX_IT", 200)
    monkeypatch.setattr(
        "stickslip.solvers.stepping.discrete_chain.TURNS", (("nsgs", 50, "x"), ("condensed-newton", 50, "x"))
    )
    found = solve(problem_of(np.diag([0.0, 1.0]), [-1.0, 0.0], [0.3]), method, 1e-8)
    assert not found.solved
    assert found.solution.residual > 0.1


def test_a_later_method_goes_on_from_the_best_point(monkeypatch: pytest.MonkeyPatch) -> None:
    W, q, mu = random_problem(5)
    turns = (("nsgs", 3, "best"), ("nsgs", 100000, "best"))
    monkeypatch.setattr("stickslip.solvers.stepping.discrete_chain.TURNS", turns)
    monkeypatch.setattr("stickslip.solvers.stepping.discrete_chain.BEST", "best")
    together = solve(problem_of(W, q, mu), "auto", 1e-8)
    alone = solve(problem_of(W, q, mu), "nsgs", 1e-8)
    assert together.solved
    assert abs(together.iterations - alone.iterations) <= 10  # the residual is measured every few sweeps


def test_contacts_of_one_colour_do_not_touch() -> None:
    random = np.random.default_rng(4)
    blocks = random.random((20, 20)) < 0.15
    W = sparse.csr_matrix(np.kron(blocks | blocks.T | np.eye(20, dtype=bool), np.ones((3, 3))))
    found = colours(W, 3)
    assert sorted(np.concatenate(found)) == list(range(20))
    for members in found:
        rows = (members[:, None] * 3 + np.arange(3)).ravel()
        part = W[rows][:, rows].toarray().reshape(len(members), 3, len(members), 3)
        assert not part.any(axis=(1, 3))[~np.eye(len(members), dtype=bool)].any()


def test_sweeps_say_how_they_ended() -> None:
    W, q, mu = random_problem(5)
    problem = problem_of(W, q, mu)
    start = np.zeros(len(q))

    def sweeps(**settings: Any) -> Any:
        prepared = METHODS["nsgs"](**settings).discrete(problem.surface)
        assert prepared is not None
        return prepared(problem, start, lambda step: None)

    short = sweeps(rtol=1e-12, max_it=7)
    assert (short.status, short.iterations) == (Status.MAX_IT, 7)
    assert not start.any()
    assert short.residual == problem.natural_residual(short.p, short.w)
    assert sweeps(rtol=1e-6, max_it=10000).status is Status.CONVERGED


def proximal(problem: DiscreteProblem, **settings: Any) -> Any:
    prepared = METHODS["condensed-newton"](**settings).discrete(problem.surface)
    assert prepared is not None
    return prepared(problem, np.zeros(len(problem.q)), lambda step: None)


@pytest.mark.parametrize("seed", range(4))
def test_a_fixed_point_of_the_regular_problem_is_a_solution(seed: int) -> None:
    W, q, mu = random_problem(seed)
    problem = problem_of(W, q, mu)
    p = solve(problem, "auto", 1e-12).solution.p
    near = problem.regular(p, 0.1)
    w = near.relative_displacement(near.contact_displacement(p))
    assert near.natural_residual(p, w) < 1e-11
    assert np.linalg.eigvalsh(near.surface.flexibility).min() > 0.099
    assert np.linalg.eigvalsh(problem.surface.flexibility).min() < 1e-12
    other = near.relative_displacement(near.contact_displacement(0 * p))
    assert near.natural_residual(0 * p, other) > 0.01


@pytest.mark.parametrize("seed", range(6))
def test_newton_passes_singular_systems_by_proximal_points(seed: int) -> None:
    problem = problem_of(*random_problem(seed, contacts=12, bodies=14))
    found = proximal(problem, rtol=1e-9, max_it=2000)
    assert found.status is Status.CONVERGED
    assert found.residual <= 1e-9
    assert [step.iteration for step in found.history] == sorted(step.iteration for step in found.history)


def test_proximal_points_end_with_their_iterations() -> None:
    problem = problem_of(*random_problem(0, contacts=12, bodies=14))
    found = proximal(problem, rtol=1e-9, max_it=3)
    assert found.status is Status.STALLED
    assert found.residual == min(step.residual for step in found.history)


def test_methods_that_need_bodies_are_refused() -> None:
    assert usable() == METHODS_USED
    for name in set(METHODS) - set(METHODS_USED):
        with pytest.raises(SceneError, match=f"--method {name}: needs the bodies.*auto, condensed-newton"):
            refuse_unusable(name)
    with pytest.raises(SceneError, match=r"--method ngs: no such method; did you mean nsgs\?"):
        refuse_unusable("ngs")
