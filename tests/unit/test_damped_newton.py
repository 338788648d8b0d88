"""Attempts of Newton's method: cycles, the line search, proximal terms, trial tractions that hold no body."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import sparse

from shared.discrete import random_problem
from shared.problems import surface_problem
from stickslip.geometry.arrays import CLOSE, EXACT, Array
from stickslip.solvers.interface.discrete import DiscreteProblem, discrete_problem
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Iterate, Solution, Status, Step
from stickslip.solvers.methods.condensed_newton import CondensedNewton, solve_given
from stickslip.solvers.newton import attempts, condensed_system
from stickslip.solvers.newton.active_set import ActiveSet, linearise
from stickslip.solvers.newton.attempts import (
    ATTEMPT,
    DECREASE,
    HALVINGS,
    MEMORY,
    Attempts,
    LineSearch,
    Start,
    again,
    closed,
    first_starts,
    other_starts,
)
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict, read

DRIVEN = {"supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.06, "y": -0.1}}}}
PULLED = {"loads": {"pull": {"boundary": "block.top", "traction": [0.02, -0.1]}}}


def problem_of(tables: dict[str, Any], normal: dict[str, Any] | None = None, mu: float = 0.4) -> SurfaceProblem:
    """A block pressed and dragged in one step."""
    laws = {"normal": normal or {"law": "unilateral"}, "friction": {"law": "coulomb", "mu": mu}}
    scene = {
        "model": "plane strain",
        "geometry": {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.25},
        "bodies": {"block": {"E": 3.0, "nu": 0.3}},
        "obstacles": {"foundation": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
        "contacts": {"base": {"surface": "block.bottom", "against": "foundation", "gap_offset": -0.01} | laws},
    }
    return surface_problem(prepare(from_dict(scene | tables)))


@pytest.fixture(scope="module")
def held() -> SurfaceProblem:
    return problem_of(DRIVEN)


@pytest.fixture(scope="module")
def floating() -> SurfaceProblem:
    return problem_of(PULLED)


def given(seed: int = 0) -> DiscreteProblem:
    """A discrete problem of full rank."""
    W, q, mu = random_problem(seed, contacts=4, dim=2, bodies=12)
    return discrete_problem(sparse.csr_matrix(W), q, mu)


class Bodies:
    """Exact bodies; what was asked for is remembered."""

    def __init__(self, problem: SurfaceProblem, linear: Any = condensed_system.solve) -> None:
        self.problem, self.linear, self.asked = problem, linear, list[ActiveSet]()
        self.answers: list[tuple[Array, Array]] = []

    def solve(self, laws: ActiveSet, p: Array, u: Array) -> tuple[Array, Array]:
        self.asked.append(laws)
        self.answers.append(self.linear(laws, u))
        return self.answers[-1]

    def relative(self, p: Array, u: Array) -> Array:
        return self.problem.relative_displacement(u)


class Scripted:
    """Bodies that answer with given tractions in turn, in their own unknowns."""

    def __init__(self, problem: SurfaceProblem, answers: Iterator[Array]) -> None:
        self.problem, self.answers = problem, answers

    def solve(self, laws: ActiveSet, p: Array, u: Array) -> tuple[Array, Array]:
        p = next(self.answers)
        return p, p

    def relative(self, p: Array, u: Array) -> Array:
        return self.problem.relative_displacement(self.problem.surface.displacement(-self.problem.surface.forces(p)))


def start_of(problem: SurfaceProblem) -> Start:
    p = np.zeros(len(problem.gap))
    return Start.at(problem, p, problem.contact_displacement(p))


def judged(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Array, Array, Array]]:
    """The iterates p, w, u of all attempts from now on."""
    seen: list[tuple[Array, Array, Array]] = []
    ending = Attempts._ending

    def watched(self: Attempts, x: Iterate) -> Status | None:
        seen.append((x.p, x.w, x.u_c))
        return ending(self, x)

    monkeypatch.setattr(Attempts, "_ending", watched)
    return seen


def test_plain_newton_arrives_and_says_so(held: SurfaceProblem) -> None:
    seen: list[Step] = []
    bodies = Bodies(held)
    attempt = Attempts(held, bodies, 1e-12, 100, seen.append)
    assert not attempt.over
    attempt(start_of(held))
    assert attempt.over
    best = attempt.best
    assert best is not None
    assert best.status is Status.CONVERGED
    assert best.residual <= 1e-12
    assert [step.iteration for step in attempt.history] == list(range(len(seen)))
    assert best.residual == attempt.history[-1].residual == min(step.residual for step in seen)
    assert attempt.history[-1].volume_solves == held.volume_solves > 0
    assert {laws.weight for laws in bodies.asked} == {0.0}
    attempt(start_of(held))  # another attempt counts on
    assert [step.iteration for step in attempt.history] == list(range(len(attempt.history)))


@pytest.mark.parametrize("factor", [1.0, 0.2])
def test_laws_are_linearised_at_the_trial_tractions_of_each_iterate(factor: float, held: SurfaceProblem) -> None:
    bodies, gamma = Bodies(held), factor * held.gamma
    zero = np.zeros(len(held.gap))
    Attempts(held, bodies, 1e-12, 100)(Start.at(held, zero, held.contact_displacement(zero), factor))
    assert len(bodies.asked) > 2
    for laws, (p, u) in zip(bodies.asked[1:], bodies.answers[:-1], strict=True):
        expected = linearise(held, p + gamma * (held.relative_displacement(u) - held.gap), gamma)
        assert_allclose(laws.rhs, expected.rhs, atol=1e-15)
        assert_allclose(laws.A_w.toarray(), expected.A_w.toarray())


def test_a_cycle_ends_an_attempt_at_its_first_repetition() -> None:
    problem = given()
    random = np.random.default_rng(1)
    a, b, c = (random.random(len(problem.gap)) for _ in range(3))
    cycle = iter([a, b, c, b, a])
    attempt = Attempts(problem, Scripted(problem, cycle), 1e-12, 100)
    attempt(replace(start_of(problem), in_equilibrium=False))
    assert len(attempt.history) == 4  # a, b, c and b again
    assert [step.iteration for step in attempt.history] == [1, 2, 3, 4]  # the start was not judged
    assert attempt.best is not None
    assert attempt.best.status is Status.STALLED
    assert attempt.best.residual == min(step.residual for step in attempt.history)


def test_tractions_that_repeat_with_another_motion_are_no_cycle() -> None:
    x, y = np.array([1.0, -2.0]), np.array([3.0, 4.0])

    def repeats(iterate: tuple[Array, Array], visited: list[tuple[Array, Array]]) -> bool:
        return Iterate(1, 1.0, *iterate).repeats([Iterate(0, 1.0, *before) for before in visited])

    assert repeats((x, y), [(y, x), (x * (1 + EXACT / 2), y)])
    assert not repeats((x, y), [(x, y + 1e-6), (x + 1e-6, y)])
    assert not repeats((x, y), [])
    assert repeats((1e3 * x, y), [(1e3 * x + 1e-10, y)])  # the change is relative
    assert not repeats((1e-12 * x, y), [(2e-12 * x, y)])
    assert repeats((0 * x, y), [(0 * x, y)])
    assert repeats((x[:0], y[:0]), [(x[:0], y[:0])])


def test_a_start_that_comes_back_at_once_is_a_cycle() -> None:
    problem = given()
    p = np.random.default_rng(1).random(len(problem.gap))
    attempt = Attempts(problem, Scripted(problem, iter([p] * 3)), 1e-12, 100)
    attempt(Start.at(problem, p, problem.contact_displacement(p)))
    assert len(attempt.history) == 2


def test_a_damped_attempt_may_repeat_itself_but_not_stop_falling(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = given()
    p = np.random.default_rng(1).random(len(problem.gap))
    falling = (0.99**k for k in range(100))  # it halves in 69 iterations
    monkeypatch.setattr(SurfaceProblem, "imbalance", lambda self, p: 1e3 * next(falling))
    attempt = Attempts(problem, Scripted(problem, iter([p] * 100)), 1e-12, 100)
    attempt(Start.at(problem, p, problem.contact_displacement(p)), 0.1)
    assert len(attempt.history) == 1 + attempts.STALL_WINDOW + 2  # the start, the first iterate, and the window past it


def test_a_shortened_step_goes_part_of_the_way(held: SurfaceProblem, monkeypatch: pytest.MonkeyPatch) -> None:
    shares = iter([0.25, 1.0, 0.5, 0.125])
    monkeypatch.setattr(LineSearch, "__call__", lambda self, *step: next(shares))
    seen, bodies = judged(monkeypatch), Bodies(held)
    Attempts(held, bodies, 1e-300, 4)(start_of(held), 1e-2)
    assert len(seen) == 5
    for t, before, after, (p, u) in zip((0.25, 1.0, 0.5, 0.125), seen, seen[1:], bodies.answers, strict=False):
        assert_allclose(after[0], (1 - t) * before[0] + t * p, atol=1e-14)
        assert_allclose(after[2], (1 - t) * before[2] + t * u, atol=1e-14)
        assert_allclose(after[1], held.relative_displacement(after[2]), atol=1e-14)  # w is affine in u
    for laws, (p, w, _) in zip(bodies.asked, seen, strict=False):
        expected = linearise(held, p + held.gamma * (w - held.gap), held.gamma).proximal(p, laws.weight)
        assert_allclose(laws.rhs, expected.rhs, atol=1e-14)


@pytest.mark.parametrize(("factor", "most"), [(0.8, ATTEMPT - 1), (0.99, 2 + attempts.STALL_WINDOW)])
def test_an_attempt_that_never_repeats_has_an_end(factor: float, most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Plain Newton goes on while the residual halves within its window; where it does not, it hops."""
    problem, random = given(), np.random.default_rng(1)
    answers = iter([random.random(len(problem.gap)) for _ in range(200)])
    falling = (factor**k for k in range(100))
    monkeypatch.setattr(SurfaceProblem, "imbalance", lambda self, p: 1e9 * next(falling))
    attempt = Attempts(problem, Scripted(problem, answers), 1e-12, 1000)
    attempt(replace(start_of(problem), in_equilibrium=False))
    assert (len(attempt.history), attempt.stalled) == (most, factor == 0.99)


def test_trial_tractions_that_hold_no_body_are_halved_towards_those_that_do(floating: SurfaceProblem) -> None:
    start = Start.as_if(floating, closed(floating), closed(floating))
    attempt = Attempts(floating, Bodies(floating), 1e-12, 100)
    lifted = -8.5 * start.p_hat  # all rows open; 8.5, 3.75, 1.375, .1875: the third halving closes them
    found = attempt._solve(lifted, start.p_hat, floating.gamma, (start.p, start.u_c), 0.0)
    assert found is not None
    assert_allclose(found[2], lifted / 16 + start.p_hat * 15 / 16)
    assert len(attempt.bodies.asked) == 5  # type: ignore[attr-defined]
    assert attempt._solve(lifted, lifted, floating.gamma, (start.p, start.u_c), 0.0) is None
    assert len(attempt.bodies.asked) == 5 + attempts.RETREATS  # type: ignore[attr-defined]
    attempt(replace(start, p_hat=lifted))
    best = attempt.best
    assert best is not None
    assert (best.status, best.residual, best.history) == (Status.NO_HOLD, np.inf, ())
    assert best.p is start.p
    assert best.u_c is start.u_c
    assert_allclose(best.w, floating.relative_displacement(start.u_c))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("proximal", [1e-3, 0.1])
def test_a_damped_attempt_arrives_too(proximal: float, seed: int) -> None:
    problem = given(seed)
    bodies = Bodies(problem, solve_given)
    attempt = Attempts(problem, bodies, 1e-10, 200)
    far = np.full(len(problem.gap), 10.0)  # residuals above 1
    attempt(Start.at(problem, far, problem.contact_displacement(far)), proximal)
    assert attempt.best is not None
    assert attempt.best.status is Status.CONVERGED
    weights = [laws.weight for laws in bodies.asked]
    residuals = [step.residual for step in attempt.history]
    assert residuals[0] > 2
    assert_allclose(weights, [proximal * min(1.0, residual) for residual in residuals[:-1]])  # it fades out


def test_a_damped_attempt_arrives_where_bodies_float(floating: SurfaceProblem) -> None:
    """An active set with a single closed point is held near to the iterate."""
    attempt = Attempts(floating, Bodies(floating), 1e-12, 200)
    attempt(Start.as_if(floating, closed(floating), closed(floating)), 1e-2)
    exact = CondensedNewton(rtol=1e-13)(floating, np.zeros(len(floating.gap)))
    assert attempt.best is not None
    assert attempt.best.status is Status.CONVERGED
    assert_allclose(attempt.best.p, exact.p, atol=1e-10 * np.abs(exact.p).max())
    assert floating.imbalance(attempt.best.p) <= 1e-12


def test_forces_out_of_balance_count_in_the_residual(floating: SurfaceProblem) -> None:
    exact = CondensedNewton(rtol=1e-13)(floating, np.zeros(len(floating.gap)))
    attempt = Attempts(floating, Bodies(floating), 1e-8, 100)
    p = exact.p * (1 + 1e-5)  # laws of a unilateral contact without motion hold for any multiple
    attempt(Start.at(floating, p, exact.u_c))
    assert attempt.history[0].residual == pytest.approx(floating.imbalance(p))
    assert floating.natural_residual(p, exact.w) < 1e-8 < floating.imbalance(p)
    assert len(attempt.history) > 1


@pytest.mark.parametrize("weight", [1e-3, 0.5])
def test_a_single_closed_point_holds_a_body_by_the_proximal_term(weight: float, floating: SurfaceProblem) -> None:
    """Without it nothing hinders the body from turning about that point."""
    p_hat = np.full(len(floating.gap), -floating.p_ref)
    p_hat[0] = floating.p_ref
    p_hat[floating.surface.normal_rows :] = 0.0
    laws = linearise(floating, p_hat, floating.gamma)
    before = 0.01 * np.random.default_rng(0).normal(size=floating.surface.size)
    with pytest.raises(np.linalg.LinAlgError, match=r"[Ss]ingular"):  # numpy says so of a pivot that is exactly zero
        condensed_system.solve(laws, before)
    near = laws.proximal(np.zeros(len(p_hat)), weight)
    p, u_c = condensed_system.solve(near, before)
    w = floating.relative_displacement(u_c)
    assert_allclose(near.A_p @ p + near.A_w @ w, near.rhs, atol=1e-9 * np.abs(p).max())
    # balance, but for soft springs, in series with the augmentation, that hold the motion near to that of the iterate
    off = floating.load.resultant - floating.surface.R.T @ floating.surface.forces(p)
    spring = weight / (1 + weight) * floating.surface.rho * (floating.surface.R.T @ (u_c - before))
    assert_allclose(off, spring, atol=1e-9 * np.abs(floating.load.resultant).max())
    further, _ = condensed_system.solve(near, u_c)
    assert np.abs(further - p).max() > 0.01 * np.abs(p).max()  # the springs have moved with the iterate


@pytest.mark.parametrize("normal", [{"law": "unilateral"}, {"law": "compliance", "c_n": 20.0}])
def test_the_solution_is_a_fixed_point_with_the_proximal_term_too(normal: dict[str, Any]) -> None:
    problem = problem_of(DRIVEN, normal)
    exact = CondensedNewton(rtol=1e-13)(problem, np.zeros(len(problem.gap)))
    laws = linearise(problem, exact.p + problem.gamma * (exact.w - problem.gap), problem.gamma)
    near = laws.proximal(exact.p, 0.3)
    assert near.weight == 0.3
    assert near.fixed.any() == laws.weight == 0
    assert laws.fixed.sum() == laws.held.sum()
    assert_allclose(condensed_system.solve(near, exact.u_c)[0], exact.p, atol=1e-10 * np.abs(exact.p).max())
    # w - weight (p_new - p) / gamma in place of w, but in springs
    p, w = np.random.default_rng(0).normal(size=(2, len(exact.p)))
    shifted = w - np.where(laws.k == 0, 0.3 * (p - exact.p) / problem.gamma, 0.0)
    assert_allclose(near.A_p @ p + near.A_w @ w - near.rhs, laws.A_p @ p + laws.A_w @ shifted - laws.rhs, atol=1e-12)
    springs = laws.k > 0
    assert springs.any() == (normal["law"] == "compliance")
    assert_array_equal((near.A_p - laws.A_p)[springs].toarray(), 0.0)


def merit(problem: SurfaceProblem, p: Array, w: Array) -> float:
    residual = problem.cone.natural_residual(p, w - problem.gap, problem.gamma)
    return float(np.sqrt(np.sum(residual**2 / problem.gamma)))


def test_a_step_that_goes_too_far_is_shortened_and_a_good_one_is_not() -> None:
    problem = given()
    exact = CondensedNewton(rtol=1e-12).discrete(problem.surface)(problem, np.zeros(len(problem.gap)), lambda s: None)  # type: ignore[misc, arg-type]
    p = exact.p + np.random.default_rng(2).random(len(exact.p))
    w = problem.relative_displacement(problem.contact_displacement(p))
    search = LineSearch(problem, problem.gamma)
    assert search(p, w, exact.p, exact.w) == 1.0
    far = 5.3
    t = LineSearch(problem, problem.gamma)(p, w, p + far * (exact.p - p), w + far * (exact.w - w))
    steps = far * 0.5 ** np.arange(HALVINGS)
    trials = [merit(problem, p + s * (exact.p - p), w + s * (exact.w - w)) for s in steps]
    small = [value <= (1 - DECREASE * 0.5**k) * merit(problem, p, w) for k, value in enumerate(trials)]
    assert t == 0.5 ** small.index(True)
    assert small.index(True) > 0


def test_a_step_is_small_enough_by_the_share_of_it_that_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, (p, w, p_new, w_new) = given(), np.random.default_rng(0).normal(size=(4, 8))
    for merits, expected in (
        ([1.0, 1 - 1.01 * DECREASE], 1.0),
        ([1.0, 1 - 0.99 * DECREASE, 1 - 0.51 * DECREASE], 0.5),
        ([1.0, 1.0, 1 - 0.49 * DECREASE, 1 - 0.26 * DECREASE], 0.25),
        ([0.0, 0.0], 1.0),  # at a solution
    ):
        values, tried = iter(merits), []
        monkeypatch.setattr(LineSearch, "_merit", lambda self, *at, v=values, seen=tried: seen.append(at) or next(v))
        assert LineSearch(problem, problem.gamma)(p, w, p_new, w_new) == expected
        for t, (p_t, w_t) in zip((0.0, *0.5 ** np.arange(9)), tried, strict=False):
            assert_allclose(p_t, (1 - t) * p + t * p_new)
            assert_allclose(w_t, (1 - t) * w + t * w_new)


def test_the_merit_is_an_energy(held: SurfaceProblem) -> None:
    """A node that lacks the traction q, held by the stiffness gamma, has the energy q² / (2 gamma)."""
    n, gamma = held.surface.normal_rows, held.gamma * np.linspace(1, 2, len(held.gap))
    w = held.gap + np.where(np.arange(len(held.gap)) < n, 0.03, 0.0)
    lacks = gamma[:n] * 0.03  # of no traction, at 0.03 of penetration
    assert LineSearch(held, gamma)._merit(np.zeros(len(w)), w) == pytest.approx(np.sqrt(np.sum(lacks**2 / gamma[:n])))


def test_the_merit_may_rise_for_some_iterations() -> None:
    problem = given()
    p, w = np.ones(len(problem.gap)), problem.offset
    here = merit(problem, p, w)
    search = LineSearch(problem, problem.gamma)
    search.recent.append(100 * here)
    for _ in range(MEMORY - 1):  # none of these steps would do otherwise: the merit only rises on them
        assert search(p, w, 2 * p, w - 1e-3) == 1.0
    t = search(p, w, 4 * p, w)  # what was so large is forgotten
    assert search.recent.maxlen == len(search.recent) == MEMORY
    assert t == 0.5 ** (HALVINGS - 1)  # none is small enough: the one of least merit


def starts(held: SurfaceProblem, p: Array) -> list[tuple[Array, float, bool]]:
    return [(start.p, start.factor, start.in_equilibrium) for start in other_starts(held, p)]


def test_starts_of_bodies_that_supports_hold(held: SurfaceProblem) -> None:
    p = np.ones(len(held.gap))
    (first,) = first_starts(held, p)
    u_c = held.contact_displacement(p)
    assert_array_equal(first.p, p)
    assert_allclose(first.u_c, u_c)
    assert_allclose(first.p_hat, p + held.gamma * (held.relative_displacement(u_c) - held.gap))
    assert first.in_equilibrium
    for start in other_starts(held, p):
        r = held.relative_displacement(start.u_c) - held.gap if start.in_equilibrium else 0.0
        at = start.p if start.in_equilibrium else closed(held)
        assert_allclose(start.p_hat, at + start.factor * held.gamma * r)
    found = starts(held, p)
    known = [(float(start[0]), factor, at) for start, factor, at in found]
    assert known == [(0, 1, True), (1, 1, False), (1, 0.1, True), (0, 0.1, True), (1, 0.1, False),
                     (1, 10, True), (0, 10, True), (1, 10, False)]  # fmt: skip
    assert len(starts(held, 0 * p)) == 5  # the first start was zero already


def test_starts_of_floating_bodies(floating: SurfaceProblem) -> None:
    p = np.ones(len(floating.gap))
    last, shut, rigid = first_starts(floating, p)
    assert_allclose(last.p_hat, p, rtol=2 * CLOSE)
    assert_allclose(shut.p_hat, closed(floating))
    assert rigid.p.any()
    assert_allclose(rigid.p_hat, rigid.p, rtol=2 * CLOSE)
    assert not any(start.in_equilibrium for start in (last, shut, rigid))
    assert {start.factor for start in (last, shut, rigid)} == {1.0}
    assert last.p is p
    assert shut.p is p
    assert len(list(first_starts(floating, 0 * p))) == 2
    assert [start.factor for start in other_starts(floating, p)] == [0.1, 0.1, 10.0, 10.0]
    still_there = replace(floating, load=nothing(floating), force=0.0, gap=0 * floating.gap)
    (still,) = first_starts(still_there, p)
    assert_array_equal(np.concatenate([still.p, still.u_c]), 0.0)


@pytest.mark.parametrize("factor", [1.0, 0.1])
def test_trial_tractions_of_an_answer_are_projected_onto_it(factor: float) -> None:
    problem = problem_of(DRIVEN, {"law": "compliance", "c_n": 20.0})
    answer = np.where(np.arange(len(problem.gap)) < problem.surface.normal_rows, 0.3, 0.05)
    answer[problem.surface.normal_rows :] *= problem.cone.carrying[problem.surface.normal_rows :]
    start = Start.as_if(problem, 0 * answer, answer, factor)
    assert_allclose(problem.project(start.p_hat, factor * problem.gamma), answer, rtol=2 * CLOSE)
    assert Start.as_if(problem, 0 * answer, answer).factor == 1.0


def test_what_goes_on_to_slip_is_solved_at_once() -> None:
    """The tractions of the start are the answer, at the friction bound to rounding, which may not decide."""
    words = ["steps={ end = 1.0, count = 3 }", "geometry.mesh_size=0.05"]
    for scale in (1.0, 1 / 3):  # other roundings
        more = [f"bodies.block.E={scale * 1e9!r}", "output.pictures=false"]
        simulation = prepare(read("sledge", [*words, *more]))
        first, *later = [step.iterations for step in simulation.steps()]
        assert first > 1
        assert later == [1, 1]


def nothing(problem: SurfaceProblem) -> Any:
    load = problem.load
    f_q = load.f_q.copy()
    f_q.scale(0.0)
    return replace(load, f_q=f_q, f_c=0 * load.f_c, resultant=0 * load.resultant, free=0 * load.free)


def test_all_closed_presses_on_normal_rows_alone(held: SurfaceProblem) -> None:
    n = held.surface.normal_rows
    assert_allclose(closed(held)[:n], held.p_ref)
    assert_array_equal(closed(held)[n:], 0.0)


def test_again_is_the_best_iterate(held: SurfaceProblem) -> None:
    p, w = np.random.default_rng(0).normal(size=(2, len(held.gap)))
    best = Solution(p, w, np.ones(held.surface.size), Status.STALLED, 1.0, ())
    start = again(held, best)
    assert_allclose(start.p_hat, p + held.gamma * (w - held.gap))
    assert start.p is p
    assert start.u_c is best.u_c
    assert start.in_equilibrium
