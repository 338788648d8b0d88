"""Newton's method: linearised laws, damping, starts, and how attempts end."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import null_space

from shared.cases import every_nth
from shared.discrete import random_problem
from shared.problems import FRICTION, NORMAL, plane, pressed, scene_of, surface_problem
from stickslip.geometry.arrays import CLOSE, EXACT, SLIGHT, Array
from stickslip.solvers.classical.uzawa import Uzawa
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.discrete import DiscreteProblem, discrete_problem
from stickslip.solvers.interface.limit_analysis import Mechanism
from stickslip.solvers.interface.prepare import condensed
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.iteration import Iterate, Solution, Status, Step
from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.laws.normal import Compliance
from stickslip.solvers.laws.rate_and_state import RateAndState
from stickslip.solvers.laws.rate_dependent import RateDependent
from stickslip.solvers.laws.wear import Worn
from stickslip.solvers.methods.condensed_newton import CondensedNewton, solve_given
from stickslip.solvers.newton import attempts, condensed_system
from stickslip.solvers.newton.active_set import ActiveSet, linearise, sets
from stickslip.solvers.newton.attempts import (
    ATTEMPT,
    HALVINGS,
    NEAR,
    Attempts,
    LineSearch,
    Start,
    again,
    closed,
    first_starts,
    other_starts,
)
from stickslip.solvers.newton.condensed_system import by_motion, by_tractions, saddle_point, solve, unfelt
from stickslip.solvers.newton.semismooth import SemismoothNewton
from stickslip.solvers.newton.settling import OnSprings, settled
from stickslip.solvers.stepping.touch import Way
from stickslip.workflows.lab.benchmarks.price_run import Case
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict, read

TIGHT = {"tolerance": 1e-11}


def trial_away_from_kinks(cone: AdmissibleSet, gamma: Array, seed: int) -> tuple[Array, NDArray[np.str_]]:
    """Random trial tractions, none near an edge between open, stick and slip; the state of each tangential point."""
    random = np.random.default_rng(seed)
    (place,) = cone.places
    p_hat = random.uniform(0.2, 1.0, cone.size) * random.choice([-1.0, 1.0, 1.0, 1.0], cone.size)
    surface = place.rows.surface
    basis = np.abs(place.rows.N_n[:, surface.dim - 1 :: surface.dim])  # the normal is the last axis
    left = basis @ surface.points[:, 0] < 0.6  # open, so that whole facets are
    p_hat[place.normal][left] = -np.abs(p_hat[place.normal][left])
    p_n = place.rows.normal.resolvent(p_hat[place.normal], gamma[place.normal])
    s = cone.bound(place, p_n)
    assert not np.any((s > 0) & (s < 1e-6))  # else choose another seed
    t = random.normal(size=(len(s), place.components))
    slipping = random.random(len(s)) < 0.5
    t *= (np.where(np.isfinite(s), np.where(slipping, 1.6, 0.5) * s, 1.0) / np.linalg.norm(t, axis=1))[:, None]
    t *= 1 + (gamma * cone.softness)[place.tangential].reshape(t.shape)  # the disc holds what the resolvent leaves
    p_hat[place.tangential] = t.ravel()
    return p_hat, np.where(s == 0, "open", np.where(slipping & np.isfinite(s), "slip", "stick"))


def as_one_system(laws: ActiveSet) -> tuple[Array, Array]:
    """M (p, w) = r."""
    return np.hstack([laws.A_p.toarray(), laws.A_w.toarray()]), laws.rhs


COMBINATIONS = [  # of laws
    ("unilateral", "coulomb"), ("unilateral", "tresca"), ("unilateral", "stick"), ("bilateral", "coulomb"),
    ("bilateral", "tresca"), ("linear", "coulomb"), ("power", "coulomb"), ("power", "tresca"),
    ("linear", "penetration"), ("power", "penetration"), ("power", "penetration squared"),
    ("unilateral", "soft coulomb"), ("power", "soft coulomb"), ("bilateral", "soft tresca"),
    ("unilateral", "soft stick"), ("worn", "coulomb"), ("unilateral", "by rate"), ("worn", "soft coulomb"),
    ("power", "by rate"),
]  # fmt: skip


ALSO = [(("unilateral", "by rate"), 3), (("worn", "soft coulomb"), 3), (("unilateral", "rate and state"), 2)]


@pytest.mark.parametrize(("laws", "dim"), [*every_nth(2, COMBINATIONS, [2, 3]), *ALSO])
def test_linearised_laws_are_the_derivative_of_the_laws(laws: tuple[str, str], dim: int) -> None:
    """One Newton step of p - P_C(p + gamma (w - gap)) = 0, by differences, has the linearised laws' solutions."""
    normal, friction = laws
    # of what laws become in a step
    plain = {"worn": "unilateral", "by rate": "coulomb", "rate and state": "coulomb"}
    problem = surface_problem(prepare(pressed(dim, *(plain.get(law, law) for law in laws), solver=TIGHT)))
    (own,) = problem.cone.contacts
    if normal == "worn":
        own = replace(own, normal=Worn(of=own.normal, softness=np.resize([0.0, 0.3], len(own.W_n))))
    if friction == "by rate":
        own = replace(own, friction=RateDependent(mu=((0.0, 0.1), (1.0, 0.4))).within(np.zeros(len(own.W_t)), 0.5))
    if friction == "rate and state":
        aged = RateAndState(f0=0.4, a=0.05, b=0.02, Dc=1.0, V0=1.0).placed(np.zeros((len(own.W_t), dim)), 1.0, 1.0)
        own = replace(own, friction=aged.within(aged.memory(len(own.W_t)), 0.5))
    cone, gamma, rows = replace(problem.cone, contacts=(own,)), problem.gamma * 0.8, problem.cone.size
    gap = problem.gap + np.random.default_rng(6).normal(0.0, 0.1, rows)
    problem = replace(problem, gap=gap, cone=cone)
    p_hat, states = trial_away_from_kinks(cone, gamma, seed=4)
    if normal != "bilateral" and "stick" not in friction:
        assert set(states) >= {"open", "slip", "stick"}
    p = np.random.default_rng(5).normal(size=rows)
    w = problem.gap + (p_hat - p) / gamma

    def defect(x: Array) -> Array:
        return np.asarray(x[:rows] - cone.project(x[:rows] + gamma * (x[rows:] - problem.gap), gamma))

    x, h = np.concatenate([p, w]), 1e-6
    columns = [(defect(x + h * e) - defect(x - h * e)) / (2 * h) for e in np.eye(2 * rows)]
    J = np.stack(columns, axis=1)
    linear = linearise(problem, p_hat, gamma)
    for found, expected in zip(sets(problem, p_hat, gamma), (linear.sets, cone.project(p_hat, gamma)), strict=True):
        assert_array_equal(found, expected)
    (place,) = cone.places
    assert_array_equal(linear.slip[place.normal], (own.normal.give > 0) & (p_hat[place.normal] > 0))
    M, r = as_one_system(linear)
    assert np.linalg.matrix_rank(M) == np.linalg.matrix_rank(J, tol=1e-6) == rows
    solution = np.linalg.lstsq(M, r, rcond=None)[0]
    assert_allclose(M @ solution, r, atol=1e-12)
    scale = np.abs(J).max() * np.abs(solution - x).max()
    assert_allclose(defect(x) + J @ (solution - x), 0.0, atol=1e-8 * scale)  # differences: h², eps/h
    assert_allclose(J @ null_space(M), 0.0, atol=1e-8 * np.abs(J).max())


@pytest.mark.parametrize("dim", [2, 3])
def test_the_condensed_system_is_solved_with_its_laws(dim: int) -> None:
    problem = surface_problem(prepare(pressed(dim, "power", "coulomb", solver=TIGHT)))
    p_hat, _ = trial_away_from_kinks(problem.cone, problem.gamma, seed=4)
    laws = linearise(problem, p_hat, problem.gamma)
    p, u_c = solve(laws, np.zeros(laws.problem.surface.size))
    surface = problem.surface
    w = surface.N @ u_c + problem.offset
    M, r = as_one_system(laws)
    size = np.abs(M).max() * max(np.abs(p).max(), np.abs(w).max())
    assert_allclose(M @ np.concatenate([p, w]), r, atol=1e-11 * size)
    balance = surface.S @ u_c + surface.forces(p) - problem.load.f_c
    assert_allclose(balance, 0.0, atol=1e-11 * np.abs(surface.S @ u_c).max())


@pytest.mark.parametrize("c_n", [1e-2, 1e2, 1e8])
def test_springs_are_solved_as_rows_too_however_stiff(c_n: float) -> None:
    base = {"surface": "block.bottom", "against": "foundation", "friction": FRICTION["coulomb"]}
    base |= {"normal": {"law": "compliance", "c_n": c_n}}
    problem = surface_problem(prepare(scene_of(3, contacts={"base": base}, bodies={"block": {"E": 3.0, "nu": 0.3}})))
    p_hat, _ = trial_away_from_kinks(problem.cone, problem.gamma, seed=4)
    laws, normal = linearise(problem, p_hat, problem.gamma), problem.cone.places[0].normal
    assert_array_equal(sets(problem, p_hat, problem.gamma)[0][1, normal], p_hat[normal] > 0)
    assert isinstance(problem.surface, CondensedSurface)
    rows = laws.without_springs()
    assert_allclose((rows.A_p - rows.A_w @ sparse.diags(1 / problem.gamma)).diagonal()[laws.k > 0], 1.0)
    M, r = as_one_system(laws)
    for system in (rows, laws)[: 1 + (c_n < 1e3)]:  # as they are, very stiff ones drown the bodies
        p, u_c = by_tractions(system, problem.surface)
        x, size = np.concatenate([p, problem.relative_displacement(u_c)]), np.abs(M).max(axis=1)
        assert_allclose((M @ x - r) / size, 0.0, atol=1e-12 * np.abs(x).max())  # each row has its own size
        balance = problem.surface.S @ u_c + problem.surface.forces(p) - problem.load.f_c
        assert_allclose(balance, 0.0, atol=1e-11 * problem.surface.total * np.abs(u_c).max())


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("normal", "friction"), [
    ("unilateral", "coulomb"), ("unilateral", "soft coulomb"), ("soft", "soft coulomb"), ("power", "coulomb"),
])  # fmt: skip
def test_it_is_solved_with_floating_bodies_too(normal: str, friction: str, dim: int) -> None:
    laws: dict[str, Any] = {"normal": (NORMAL | {"soft": {"law": "compliance", "c_n": 0.5}})[normal]}
    laws |= {"friction": FRICTION[friction], "gap_offset": -0.01}
    drag = [0.005, -0.1] if dim == 2 else [0.005, 0.003, -0.1]
    problem = surface_problem(prepare(scene_of(
        dim,
        bodies={"block": {"E": 3.0, "nu": 0.3}},
        contacts={"base": {"surface": "block.bottom", "against": "foundation"} | laws},
        loads={"pull": {"boundary": "block.top", "traction": drag}},
    )))  # fmt: skip
    surface = problem.surface
    assert isinstance(surface, CondensedSurface)
    assert surface.floating
    linear = linearise(problem, trial_away_from_kinks(problem.cone, problem.gamma, seed=4)[0], problem.gamma)
    assert linear.slip.any()
    M, r = as_one_system(linear)
    bodies = surface.row_stiffness(problem.cone.carrying)
    for p, u_c in [by_tractions(linear, surface), *([by_motion(linear, bodies)] if bodies is not None else [])]:
        w = surface.N @ u_c + problem.offset
        size = np.abs(M).max() * max(np.abs(p).max(), np.abs(w).max())
        assert_allclose(M @ np.concatenate([p, w]), r, atol=1e-11 * size)
        balance = surface.S @ u_c + surface.forces(p) - problem.load.f_c
        assert_allclose(balance, 0.0, atol=1e-10 * surface.total * np.abs(u_c).max())
        resultant = surface.R.T @ (problem.load.f_c - surface.forces(p))
        assert_allclose(resultant, 0.0, atol=1e-10 * np.abs(surface.forces(p)).sum())


def test_a_saddle_point_is_solved_alike_whatever_is_called_a_metre() -> None:
    rng, metre = np.random.default_rng(5), 2.0**40
    A, B, C, D = (rng.normal(size=size) for size in ((8, 8), (8, 3), (3, 8), (3, 3)))
    f, g = rng.normal(size=8), rng.normal(size=3)
    x, y = saddle_point(A, B, C, D, f, g)
    assert_allclose(np.concatenate([A @ x + B @ y, C @ x + D @ y]), np.concatenate([f, g]), atol=1e-12)
    for pascal in (1.0, 2.0**-40):
        longer, farther = saddle_point(A * pascal, B * pascal / metre, C * metre, D, f * pascal, g * metre)
        assert_array_equal(longer, x)
        assert_array_equal(farther, y * metre)


def test_a_saddle_point_keeps_its_digits_where_rounding_stands_beside_springs() -> None:
    """Of a stiff body on soft springs, tractions in balance push its motion by their last digits alone."""
    rng = np.random.default_rng(6)
    A, B, C = (rng.normal(size=size) for size in ((8, 8), (8, 1), (1, 8)))
    x = rng.normal(size=8)
    found, y = saddle_point(A, B, 1e-14 * C, np.full((1, 1), 1e7), A @ x + B[:, 0] * 1e-7, np.ones(1))
    assert_allclose(y, 1e-7, rtol=1e-12)
    assert_allclose(found, x, rtol=1e-11)


def test_rows_that_slip_are_known() -> None:
    problem = surface_problem(prepare(pressed(2, "unilateral", "coulomb", solver=TIGHT)))
    p_hat, states = trial_away_from_kinks(problem.cone, problem.gamma, seed=4)
    laws, (place,) = linearise(problem, p_hat, problem.gamma), problem.cone.places
    assert laws.slip.dtype == laws.held.dtype == bool
    assert laws.slip[place.tangential].tolist() == ((states == "slip") & place.rows.free[:, 0]).tolist()
    assert not laws.slip[place.normal].any()


def test_each_contact_has_rows_of_its_own() -> None:
    sides = {"base": ("bottom", "foundation"), "side": ("right", "wall")}
    contacts = {key: {"surface": f"block.{on}", "against": to} for key, (on, to) in sides.items()}
    wall = {"shape": "plane", "point": [2.0, 0.0], "normal": [-1.0, 0.0]}
    problem = surface_problem(
        prepare(
            scene_of(contacts=contacts, obstacles={"foundation": plane(), "wall": wall}, top={"x": 0.01, "y": -0.1})
        )
    )
    for place in problem.cone.places:
        laws = linearise(problem, np.where(np.arange(len(problem.gap)) < place.normal.stop, 1.0, -1.0), problem.gamma)
        assert_array_equal(np.flatnonzero(laws.held), np.arange(place.normal.stop))


def test_a_direction_without_multiplier_has_no_law() -> None:
    """A point that slips in 3D, one of whose directions a support has taken: its row is p = 0."""
    problem = surface_problem(prepare(pressed(3, "unilateral", "coulomb", solver=TIGHT)))
    p_hat, states = trial_away_from_kinks(problem.cone, problem.gamma, seed=4)
    (rows,), point = problem.cone.contacts, int(np.flatnonzero(states == "slip")[0])
    free = rows.free.copy()
    free[point, 1] = False
    cone = AdmissibleSet((replace(rows, free=free),), problem.cone.time, problem.cone.end)
    row = problem.surface.normal_rows + 2 * point + 1
    p_hat[row - 1] = 10.0  # it slips along the other one
    laws = linearise(replace(problem, cone=cone), p_hat, problem.gamma)
    assert np.isfinite(laws.A_p.toarray()).all()
    assert np.isfinite(laws.A_w.toarray()).all()
    assert not laws.A_w.toarray()[row].any()
    assert laws.slip[row - 1]
    assert not laws.slip[row]


def test_nan_goes_through_the_system() -> None:
    """It ends as Status.NOT_FINITE, not as an error."""
    problem = surface_problem(prepare(pressed(3, "linear", "coulomb", solver=TIGHT)))
    p_hat, _ = trial_away_from_kinks(problem.cone, problem.gamma, seed=4)
    laws = linearise(problem, p_hat, problem.gamma)
    surface = problem.surface
    assert isinstance(surface, CondensedSurface)
    p, u_c = by_tractions(replace(laws, rhs=laws.rhs * np.nan), surface)
    assert np.isnan(p).any()
    assert np.isnan(u_c).any()


@pytest.mark.parametrize(
    ("friction", "dim", "seed"), every_nth(3, ["coulomb", "tresca", "soft coulomb"], [2, 3], [4, 5, 6])
)
def test_unknown_tractions_and_unknown_motions_give_the_same_answer(friction: str, dim: int, seed: int) -> None:
    problem = surface_problem(prepare(pressed(dim, "unilateral", friction, solver=TIGHT)))
    surface = problem.surface
    assert isinstance(surface, CondensedSurface)
    bodies = surface.row_stiffness(problem.cone.carrying)
    assert bodies is not None
    laws = linearise(problem, trial_away_from_kinks(problem.cone, problem.gamma, seed)[0], problem.gamma)
    (p, u), (q, v) = by_motion(laws, bodies), by_tractions(laws, surface)
    assert np.abs(p).max() > 0
    assert_allclose(p, q, atol=1e-10 * np.abs(p).max())  # rounding, condition some 1e3
    assert_allclose(u, v, atol=1e-10 * np.abs(u).max())


@pytest.mark.parametrize(("dim", "normal", "friction"), [
    (2, "unilateral", "coulomb"), (2, "linear", "tresca"), (2, "bilateral", "tresca"),
    (3, "power", "coulomb"), (2, "power", "penetration squared"), (3, "linear", "penetration"),
    (2, "unilateral", "soft coulomb"), (2, "bilateral", "soft tresca"),
    pytest.param(2, "power", "coulomb", marks=pytest.mark.slow),
    pytest.param(3, "power", "soft coulomb", marks=pytest.mark.slow),
])  # fmt: skip
def test_uzawa_and_newton_find_the_same_answer(dim: int, normal: str, friction: str) -> None:
    steps, problems = [], []
    for method in ("uzawa", "condensed-newton"):
        simulation = prepare(pressed(dim, normal, friction, solver=TIGHT | {"method": method}))
        steps += list(simulation.steps())
        problems.append(simulation.stepper.surface)
    one, other = steps
    assert 0 < other.iterations < one.iterations
    size = np.abs(one.displacement).max()
    assert_allclose(one.displacement, other.displacement, atol=1e-9 * size)  # tolerance 1e-11, condition some 100
    forces = [surface.forces(step.p) for surface, step in zip(problems, steps, strict=True)]
    assert_allclose(forces[0], forces[1], atol=1e-9 * np.abs(forces[0]).max())
    contact = other.contacts["base"]
    assert contact.slip_area > 0
    assert contact.tangential_force > 0.01
    assert contact.dissipation > 0


def test_friction_is_what_the_methods_see_of_mu() -> None:
    scene = pressed(2, "power", "coulomb", solver=TIGHT)
    smooth = scene_of(
        contacts={"base": {"surface": "block.bottom", "against": "foundation", "normal": NORMAL["power"],
                           "friction": {"law": "coulomb", "mu": 0.0}}},
        supports={"top": {"boundary": "block.top", "displacement": {"x": 0.06, "y": -0.1}}},
    )  # fmt: skip
    (rough,), (slippery,) = (list(prepare(s).steps()) for s in (scene, smooth))
    assert slippery.contacts["base"].tangential_force == 0.0
    assert rough.contacts["base"].tangential_force <= 0.4 * rough.contacts["base"].normal_force * (1 + 1e-9)


@pytest.mark.parametrize(("relaxation", "converges"), [(0.2, True), (1.99, True), (2.02, False)])
def test_uzawa_converges_up_to_two_over_lambda_max_and_no_further(relaxation: float, converges: bool) -> None:
    """All points closed and sticking: Richardson's iteration, whose bound is sharp."""
    problem = surface_problem(prepare(pressed(2, "bilateral", "stick", solver=TIGHT)))
    method = Uzawa(alpha=relaxation / problem.surface.lambda_max, rtol=1e-8, max_it=20000)
    solution = method(problem, np.zeros(problem.cone.size))
    if converges:
        assert solution.status is Status.CONVERGED
        newton = CondensedNewton(rtol=1e-10)(problem, np.zeros(problem.cone.size))
        assert_allclose(solution.w, newton.w, atol=1e-7 * problem.u_ref)
    else:
        assert solution.status is Status.STALLED
        assert np.abs(solution.p).max() > 1e3 * problem.p_ref  # (2.02 - 1)^500 = 2e4, started at rounding or above


def test_a_method_says_when_it_ran_out_of_iterations() -> None:
    problem = surface_problem(prepare(pressed(2, "unilateral", "coulomb", solver=TIGHT)))
    nothing = np.zeros(problem.cone.size)
    solution = Uzawa(rtol=1e-12, max_it=3)(problem, nothing)
    assert (solution.status, solution.iterations, len(solution.history)) == (Status.MAX_IT, 3, 4)
    # what is returned is what was measured
    w = problem.relative_displacement(problem.contact_displacement(solution.p))
    assert solution.residual == problem.natural_residual(solution.p, w)
    assert CondensedNewton(rtol=1e-12, max_it=1)(problem, nothing).status is not Status.CONVERGED


@pytest.mark.parametrize("mu", [1e-4, 0.3, 1.0])
def test_a_surface_that_looks_every_way_has_a_scale_too(mu: float) -> None:
    # the mean normal of a bore is 0: trial tractions scaled by it sent the point at the bottom from side to side
    ring = {"builder": "ring", "inner_radius": 1.0, "outer_radius": 1.5, "mesh_size": 0.1, "cells": "tensor"}
    shaft = {"shape": "cylinder", "point": [0.0, 0.0], "radius": 0.98, "displacement": {"y": -0.04}}
    friction = {"law": "coulomb", "mu": mu}
    scene = from_dict(
        {
            "model": "plane strain",
            "geometry": ring,
            "bodies": {"ring": {"E": 1.0, "nu": 0.3}},
            "obstacles": {"shaft": shaft},
            "contacts": {"bore": {"surface": "ring.inner", "against": "shaft", "friction": friction}},
            "supports": {"housing": {"boundary": "ring.outer", "displacement": {"x": 0.0, "y": 0.0}}},
        }
    )
    (step,) = prepare(scene).steps()
    assert (step.substeps, step.contacts["bore"].normal_force > 0.05) == (1, True)
    assert step.iterations <= 8


DRIVEN = {"supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.06, "y": -0.1}}}}
PULLED = {"loads": {"pull": {"boundary": "block.top", "traction": [0.02, -0.1]}}}


def problem_of(tables: dict[str, Any], normal: dict[str, Any] | None = None, mu: float = 0.4) -> SurfaceProblem:
    """A block pressed and dragged in one step."""
    laws = {"normal": normal or {"law": "unilateral"}, "friction": {"law": "coulomb", "mu": mu}}
    base = {"surface": "block.bottom", "against": "foundation", "gap_offset": -0.01} | laws
    return surface_problem(
        prepare(scene_of(bodies={"block": {"E": 3.0, "nu": 0.3}}, contacts={"base": base}, **tables))
    )


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
        assert len(p) == len(self.problem.gap)
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
    assert best.status is Status.CONVERGED
    assert best.residual <= 1e-12
    assert best.gap is None  # that of the problem
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
    assert not repeats((1e-15 * x, y), [(2e-15 * x, y)])
    assert not repeats((x, 4 * y), [(x, y), (x, 2 * y), (x, 3 * y)])  # nor do these go to and fro
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
    assert len(attempt.history) == 1 + attempts.QUICK + 2  # the start, the first iterate, and the window past it


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
        expected = linearise(held, p + held.gamma * (w - held.gap), held.gamma)
        expected = expected.proximal(p, laws.weight, held.gamma, laws.weight)
        assert_allclose(laws.rhs, expected.rhs, atol=1e-14)


@pytest.mark.parametrize(("factor", "most"), [(0.8, ATTEMPT - 1), (0.99, 2 + attempts.QUICK // 2)])
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
    assert_allclose(found[2], lifted / 16 + start.p_hat * 15 / 16)
    assert len(attempt.bodies.asked) == 5
    assert attempt._solve(lifted, lifted, floating.gamma, (start.p, start.u_c), 0.0) is None
    assert len(attempt.bodies.asked) == 5 + attempts.RETREATS
    attempt(replace(start, p_hat=lifted))
    best = attempt.best
    assert (best.status, best.residual, best.history) == (Status.NO_HOLD, np.inf, ())
    assert best.p is start.p
    assert best.u_c is start.u_c
    assert_allclose(best.w, floating.relative_displacement(start.u_c))
    attempt.best = better = replace(best, residual=1.0)
    attempt(replace(start, p_hat=lifted))
    assert attempt.best is better


def test_tractions_that_leave_more_than_rounding_of_a_load_are_refused(floating: SurfaceProblem) -> None:
    p = np.zeros(len(floating.gap))
    laws, left = linearise(floating, p, floating.gamma), float(np.abs(floating.load.resultant).sum())
    for rounding in ((), (0.9 * left,)):
        with pytest.raises(np.linalg.LinAlgError, match=r"^the system is singular: some rigid motion is not held$"):
            laws.refuse_unbalanced(p, *rounding)
    laws.refuse_unbalanced(p, 1.1 * left)


def test_rounding_of_a_common_motion_is_no_force(floating: SurfaceProblem, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[float] = []
    monkeypatch.setattr(ActiveSet, "refuse_unbalanced", lambda self, p, rounding=0.0: told.append(rounding))
    gap = np.full(len(floating.gap), 0.125)
    problem = replace(floating, gap=gap, offset=-gap)
    solve(linearise(problem, closed(problem), problem.gamma), np.zeros(problem.surface.size))
    assert told == [pytest.approx(EXACT * condensed(floating.surface).total * 0.25)]


@pytest.mark.parametrize("c_n", [1.0, 1e-12])
def test_however_soft_springs_resist_a_motion(c_n: float, floating: SurfaceProblem) -> None:
    """Without friction they hold a body but for one motion, along the floor."""
    (rows,) = floating.cone.contacts
    rows = replace(rows, normal=Compliance(c_n=c_n), friction=None)
    problem = replace(floating, cone=replace(floating.cone, contacts=(rows,)))
    free = unfelt(linearise(problem, closed(problem), problem.gamma), condensed(problem.surface))
    assert_allclose(np.linalg.eigvalsh(free), [0.0, 0.0, 1.0], atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("proximal", [1e-3, 0.1])
def test_a_damped_attempt_arrives_too(proximal: float, seed: int) -> None:
    problem = given(seed)
    bodies = Bodies(problem, solve_given)
    attempt = Attempts(problem, bodies, 1e-10, 200)
    far = np.full(len(problem.gap), 10.0)  # residuals above 1
    attempt(Start.at(problem, far, problem.contact_displacement(far)), proximal)
    assert attempt.best.status is Status.CONVERGED
    weights = [laws.weight for laws in bodies.asked]
    residuals = [step.residual for step in attempt.history]
    assert residuals[0] > 2
    # it fades out, with the residual and after each full step
    assert_allclose(weights, [proximal * min(1.0, x) / 10.0**k for k, x in enumerate(residuals[:-1])])


def test_a_damped_attempt_arrives_where_bodies_float(floating: SurfaceProblem) -> None:
    """An active set with a single closed point is held near to the iterate."""
    attempt = Attempts(floating, Bodies(floating), 1e-12, 200)
    attempt.follow(iter([(Start.as_if(floating, closed(floating), closed(floating)), 1e-2)]))
    assert attempt.bodies.asked[1].weight > 0
    exact = CondensedNewton(rtol=1e-13)(floating, np.zeros(len(floating.gap)))
    assert attempt.best.status is Status.CONVERGED
    assert_allclose(attempt.best.p, exact.p, atol=1e-10 * np.abs(exact.p).max())
    assert floating.imbalance(attempt.best.p) <= 1e-12


@pytest.mark.parametrize("level", [1e-2, 1e-6])
def test_springs_carry_what_contact_lacks(level: float, floating: SurfaceProblem) -> None:
    surface, zero = floating.surface, np.zeros(len(floating.gap))
    held = OnSprings(Attempts(floating, Bodies(floating), 1e-12, 100), level, floating.u_before)
    judged = list(held.settling(Start.at(floating, zero, floating.u_before), 0))
    x = held.settled
    assert x is not None
    own, lacks = floating.natural_residual(x.p, x.w), floating.imbalance(x.p)
    assert own <= SLIGHT
    assert judged[-1].residual == max(own, lacks)
    lacking = surface.R.T @ (floating.load.f_c - surface.forces(x.p))
    moved = surface.R.T @ (x.u_c - floating.u_before)
    assert_allclose(lacking, level / (1 + level) * surface.rho * moved, atol=1e-10 * np.abs(floating.load.f_c).sum())


def test_bodies_settle_where_contact_holds_them(floating: SurfaceProblem) -> None:
    attempt, zero = Attempts(floating, Bodies(floating), 0.0, 500), np.zeros(len(floating.gap))
    attempt(Start.as_if(floating, closed(floating), closed(floating)))
    assert attempt.best is not None
    attempt.best = replace(attempt.best, residual=1.0)
    first, *_, last = settled(attempt, Start.at(floating, zero, floating.u_before))
    exact = CondensedNewton(rtol=1e-13)(floating, zero)
    assert_array_equal(first.u_c, floating.u_before)
    assert_allclose(last.p, exact.p, atol=SLIGHT * np.abs(exact.p).max())
    assert_allclose(last.u_c, exact.u_c, atol=SLIGHT * np.abs(exact.u_c).max())


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
    near = laws.proximal(np.zeros(len(p_hat)), weight, laws.problem.gamma, weight)
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
    near = laws.proximal(exact.p, 0.3, laws.problem.gamma, 0.3)
    assert near.weight == 0.3
    assert near.fixed.any() == laws.weight == 0
    assert laws.fixed.sum() == laws.held.sum()
    assert_allclose(condensed_system.solve(near, exact.u_c)[0], exact.p, atol=1e-10 * np.abs(exact.p).max())
    # w - weight (p_new - p) / gamma in place of w; in rows of springs divided such that they are softer springs
    p, w = np.random.default_rng(0).normal(size=(2, len(exact.p)))
    shifted, softer = w - 0.3 * (p - exact.p) / problem.gamma, 1 / (1 + 0.3 * laws.k / problem.gamma)
    off = softer * (laws.A_p @ p + laws.A_w @ shifted - laws.rhs)
    assert_allclose(near.A_p @ p + near.A_w @ w - near.rhs, off, atol=1e-12)
    assert_allclose(near.k, softer * laws.k)
    springs = laws.k > 0
    assert springs.any() == (normal["law"] == "compliance")
    assert_array_equal((near.A_p - laws.A_p)[springs].toarray(), 0.0)


def merit(problem: SurfaceProblem, p: Array, w: Array) -> float:
    residual = problem.cone.natural_residual(p, w - problem.gap, problem.gamma)
    return float(np.sqrt(np.sum(residual**2 / problem.gamma)))


def test_a_step_that_goes_too_far_is_shortened_and_a_good_one_is_not() -> None:
    problem = given()
    exact = CondensedNewton(rtol=1e-12).discrete(problem.surface)(problem, np.zeros(len(problem.gap)), lambda s: None)
    p = exact.p + np.random.default_rng(2).random(len(exact.p))
    w = problem.relative_displacement(problem.contact_displacement(p))
    search = LineSearch(problem, problem.gamma)
    assert search(p, w, exact.p, exact.w) == 1.0
    far = 5.3
    t = LineSearch(problem, problem.gamma)(p, w, p + far * (exact.p - p), w + far * (exact.w - w))
    steps = far * 0.5 ** np.arange(HALVINGS)
    trials = [merit(problem, p + s * (exact.p - p), w + s * (exact.w - w)) for s in steps]
    small = [value <= (1 - SLIGHT * 0.5**k) * merit(problem, p, w) for k, value in enumerate(trials)]
    assert t == 0.5 ** small.index(True)
    assert small.index(True) > 0


def test_a_step_is_small_enough_by_the_share_of_it_that_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, (p, w, p_new, w_new) = given(), np.random.default_rng(0).normal(size=(4, 8))
    for merits, expected in (
        ([1.0, 1 - 1.01 * SLIGHT], 1.0),
        ([1.0, 1 - 0.99 * SLIGHT, 1 - 0.51 * SLIGHT], 0.5),
        ([1.0, 1.0, 1 - 0.49 * SLIGHT, 1 - 0.26 * SLIGHT], 0.25),
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


def test_no_step_raises_the_merit() -> None:
    problem = given()
    p, w = np.ones(len(problem.gap)), problem.offset
    t = LineSearch(problem, problem.gamma)(p, w, 4 * p, w)
    assert t == 0.5 ** (HALVINGS - 1)  # none is small enough: the one of least merit


def test_starts_of_bodies_that_supports_hold(held: SurfaceProblem, monkeypatch: pytest.MonkeyPatch) -> None:
    p, n = np.ones(len(held.gap)), held.surface.normal_rows
    (far,) = first_starts(held, p)  # of no solution near: the active set alone
    assert_allclose(far.p_hat, p, rtol=2 * CLOSE)
    assert not far.in_equilibrium
    for lacking, near in ((0.9 * NEAR, True), (1.1 * NEAR, False)):
        monkeypatch.setattr(SurfaceProblem, "natural_residual", lambda self, p, w, lacking=lacking: lacking)
        (start,) = first_starts(held, p)
        assert (start.in_equilibrium, start.p is p) == (near, True)
        if near:
            u_c = held.contact_displacement(p)
            assert_allclose(start.u_c, u_c)
            assert_allclose(start.p_hat, p + held.gamma * (held.relative_displacement(u_c) - held.gap))
            assert next(first_starts(replace(held, turned=2 * p), p)).in_equilibrium == near
            turned = next(first_starts(replace(held, turned=p.copy()), p))
            assert_allclose(turned.p_hat[:n], start.p_hat[:n])
            assert_allclose(turned.p_hat[n:], start.p_hat[n:] - SLIGHT)  # what slipped sticks
            assert (turned.p is p, turned.in_equilibrium) == (True, False)
    zero, shut = other_starts(held, p)
    assert_array_equal(zero.p, 0.0)
    assert_allclose(zero.p_hat, held.gamma * (held.relative_displacement(held.load.free) - held.gap))
    assert zero.in_equilibrium
    assert_allclose(shut.p_hat, closed(held))
    assert not shut.in_equilibrium
    assert len([*other_starts(held, 0 * p)]) == 1  # the first start was zero already


def test_starts_of_floating_bodies(floating: SurfaceProblem) -> None:
    p = np.ones(len(floating.gap))
    (last,) = first_starts(floating, p)
    assert_allclose(last.p_hat, p, rtol=2 * CLOSE)  # no solution is near: the active set alone
    shut, rigid = other_starts(floating, p)
    assert_allclose(shut.p_hat, closed(floating))
    assert rigid.p.any()
    assert_allclose(rigid.p_hat, rigid.p, rtol=2 * CLOSE)
    assert not any(start.in_equilibrium for start in (last, shut, rigid))
    assert last.p is p
    assert shut.p is p
    (first,) = first_starts(floating, zero := 0 * p)
    assert first.p is zero
    assert_allclose(first.p_hat, closed(floating))
    apart, down = replace(floating, gap=floating.gap + 2 * floating.u_ref), np.tile([0.0, -1.0], len(first.u_c) // 2)
    assert not [*first_starts(apart, zero)]
    assert [*first_starts(replace(apart, u_before=2 * floating.u_ref * down), zero)]
    still_there = replace(floating, load=nothing(floating), force=0.0, gap=0 * floating.gap)
    (still,) = first_starts(still_there, p)
    assert_array_equal(np.concatenate([still.p, still.u_c]), 0.0)


def test_what_nothing_pushes_starts_where_it_stood(floating: SurfaceProblem) -> None:
    lifted, surface = replace(floating, load=nothing(floating), force=0.0), floating.surface
    assert lifted.idle
    lift = surface.R @ (surface.R.T @ np.tile([0.0, 0.02], surface.size // 2))
    problem = replace(lifted, u_before=lift, gap=np.full(len(lifted.gap), 0.001))
    least = problem.scales.no_traction
    p = np.zeros(len(problem.gap))
    first = next(iter(first_starts(problem, p)))
    assert (first.p is p, first.u_c is lift, first.in_equilibrium) == (True, True, False)
    r = problem.relative_displacement(lift) - problem.gap
    assert np.all(np.abs(first.p_hat[: surface.normal_rows]) > least)
    assert_allclose(first.p_hat, np.where(np.abs(problem.gamma * r) > least, problem.gamma * r, 0.0))
    squeezed = problem.p_ref * np.ones(len(p))  # then its tractions tell more of what touches, and come first
    assert next(iter(first_starts(problem, squeezed))).p_hat[0] > 0 > first.p_hat[0]
    touching = replace(problem, offset=problem.offset - r)
    assert not Start.where_it_stood(touching, p).p_hat.any()
    pushed = replace(lifted, u_before=lift, load=replace(lifted.load, resultant=np.ones(surface.R.shape[1])))
    assert not pushed.idle
    assert_allclose(next(iter(first_starts(pushed, p))).p_hat, closed(pushed))


@pytest.mark.parametrize("normal", [{"law": "unilateral"}, {"law": "compliance", "c_n": 2.5, "m_n": 2.0}])
def test_bodies_are_placed_where_tractions_near_to_a_solution_hold_them(normal: dict[str, Any]) -> None:
    problem = problem_of(PULLED, normal)
    newton = SemismoothNewton(rtol=1e-12, max_it=100, linear=condensed_system.solve)
    found = newton(problem, np.zeros(len(problem.gap)))
    start = Start.placed(problem, found.p)
    assert_allclose(start.u_c, found.u_c, atol=1e-9 * np.abs(found.u_c).max())
    assert newton(problem, found.p).iterations == 1
    # by least squares of the lengths by which laws with w are missed, where no place holds them all
    p = found.p * (1 + 0.01 * np.random.default_rng(0).normal(size=len(found.p)))
    (held, springs, _), _ = sets(problem, Start.as_if(problem, p, p).p_hat, problem.gamma)
    assert held.any()
    assert springs.any() == (normal["law"] == "compliance")
    missed = (
        problem.relative_displacement(Start.placed(problem, p).u_c)
        - problem.gap
        - np.sqrt(np.maximum(p, 0) / 2.5) * springs
    )
    moves = (problem.surface.N @ problem.surface.R)[held | springs]
    assert_allclose(moves.T @ missed[held | springs], 0.0, atol=1e-12)
    assert np.abs(missed[held | springs]).max() > 1e-6


def test_a_motion_that_no_law_holds_is_placed_where_it_was() -> None:
    problem = problem_of({"loads": {"press": {"boundary": "block.top", "traction": [0.0, -0.1]}}})
    (rows,), along = problem.cone.contacts, np.tile([1.0, 0.0], problem.surface.size // 2)
    cone = replace(problem.cone, contacts=(replace(rows, friction=Coulomb(mu=0.0)),))
    moved = replace(problem, cone=cone, u_before=0.03 * along)
    p = np.where(np.arange(len(problem.gap)) < problem.surface.normal_rows, 0.1, 0.001)  # not quite in balance
    placed = Start.placed(moved, p)
    assert placed.p is p
    assert placed.u_c is not moved.u_before
    assert along @ placed.u_c == pytest.approx(0.03 * along @ along)


def test_a_solution_of_other_pairs_is_begun_from_where_its_bodies_stand(floating: SurfaceProblem) -> None:
    """Tractions tell badly where floating bodies are; the displacement found with other pairs leaves one solve."""
    newton = SemismoothNewton(rtol=1e-12, max_it=100, linear=condensed_system.solve)
    found = newton(floating, np.zeros(len(floating.gap)))
    start = next(first_starts(replace(floating, guess=found.u_c), found.p))
    assert (start.in_equilibrium, start.u_c is found.u_c) == (True, True)
    moved = replace(floating, guess=found.u_c, gap=floating.gap + 1e-6 * floating.u_ref)
    again = newton(moved, found.p)
    assert (again.status, again.iterations) == (Status.CONVERGED, 1)
    assert newton(replace(floating, guess=found.u_c), found.p).iterations == 1  # however small the residual is


def test_what_holds_closing_points_back_has_one_energy(floating: SurfaceProblem) -> None:
    """Betti: forces a do the same work on the way that b take as b on that of a, and each does work on its own."""
    n = floating.surface.normal_rows
    p = np.where(np.arange(len(floating.gap)) < 2, floating.p_ref, 0.0)
    way = Way(replace(floating, gap=np.where(np.arange(len(p)) < n, floating.u_ref, 0.0)), p, 0 * p, 0.0)
    acting = np.zeros((2, len(p)))
    acting[0, n - 1], acting[1, n // 2] = floating.p_ref, floating.p_ref
    freed = np.array([way._freed(each, way._closes(each)) for each in acting])
    work = (acting * floating.surface.W) @ freed.T
    assert np.diag(work).min() > 0
    assert work[0, 1] == pytest.approx(work[1, 0], rel=1e-9)


def test_without_points_that_close_the_others_go_on() -> None:
    """A floating block stands on the ends of its bottom, where it sticks, until the middle of it touches."""
    problem = problem_of(PULLED, mu=9.0)
    (place,) = problem.cone.places
    middle = np.zeros(len(problem.gap), bool)
    middle[place.normal] = np.abs(place.rows.surface.points[:, 0] - 1.0) < 0.6
    newton = SemismoothNewton(rtol=1e-12, max_it=100, linear=condensed_system.solve)
    alone = newton(replace(problem, gap=np.where(middle, 10 * problem.u_ref, problem.gap)), 0 * problem.gap)
    room = float((alone.w - problem.gap)[middle].max()) / 2
    posed = replace(problem, gap=np.where(middle, problem.gap + room, problem.gap))
    whole = newton(posed, 0 * problem.gap)
    way = Way(posed, alone.p / 2, np.where(middle, problem.gap, alone.w / 2), 0.0)
    closes = way._closes(whole.p)
    assert 0 < closes[0].sum() < len(closes[0])
    assert not whole.p[middle & ~way._rows(closes)].any()
    found = way._free(whole.p, whole.w, posed.gap, closes)
    assert found is not None
    assert_allclose(found[0], alone.p, atol=1e-9 * np.abs(alone.p).max())
    assert_allclose(found[1], alone.w, atol=1e-9 * problem.u_ref)
    assert_allclose(way.holding(whole.p, whole.w, posed.gap), whole.p - found[0])
    assert way._free(whole.p, whole.w, posed.gap, [np.ones_like(closes[0])]) is None  # nothing else holds it


def test_trial_tractions_of_an_answer_are_projected_onto_it() -> None:
    problem = problem_of(DRIVEN, {"law": "compliance", "c_n": 20.0})
    answer = np.where(np.arange(len(problem.gap)) < problem.surface.normal_rows, 0.3, 0.05)
    answer[problem.surface.normal_rows :] *= problem.cone.carrying[problem.surface.normal_rows :]
    start = Start.as_if(problem, 0 * answer, answer)
    assert_allclose(problem.project(start.p_hat, problem.gamma), answer, rtol=2 * CLOSE)


def test_what_goes_on_to_slip_is_solved_at_once() -> None:
    """The tractions of the start are the answer, at the friction bound to rounding, which may not decide."""
    words = ["steps={ end = 1.0, count = 3 }", "geometry.mesh_size=0.05"]
    for scale in (1.0, 1 / 3):  # other roundings
        more = [f"bodies.block.E={scale * 1e9!r}", "output.pictures=false"]
        simulation = prepare(read("sledge", [*words, *more]))
        first, *later = [step.iterations for step in simulation.steps()]
        assert first > 1
        assert later == [1, 1]


def test_an_attempt_that_goes_to_and_fro_is_given_up_soon() -> None:
    """Dragged cubes stick: from the last tractions plain Newton hops between two states, never quite the same."""
    cubes = Case(3, 4, "condensed-newton", "condensed", 1e-8, "tensor", 2).scene()
    assert max(step.iterations for step in prepare(cubes).steps()) <= 12


def test_to_and_fro_is_there_and_back_twice() -> None:
    there, back = (Iterate(0, 0.5, np.array(p)) for p in ((1.0, 2.0), (2.0, 1.0)))
    near = Iterate(0, 0.5, there.p + 0.095)  # a little less than a tenth of the way
    assert near.repeats([back, there, back])
    assert near.repeats([Iterate(0, 0.5, 3 * there.p), back, there, back])
    assert not near.repeats([Iterate(0, 0.5, 3 * there.p), there, back])  # once only
    assert not Iterate(0, 0.5, there.p + 0.105).repeats([back, there, back])


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
    assert_allclose(again(held, replace(best, gap=p)).p_hat, p + held.gamma * (w - p))  # slip counts from its own
    assert start.p is p
    assert start.u_c is best.u_c
    assert start.in_equilibrium


def told(monkeypatch: pytest.MonkeyPatch, *residuals: float) -> list[Array]:
    """Residuals of the iterates from now on, whatever they are; the tractions of those that are judged."""
    seen, left = list[Array](), iter(residuals)

    def judged(self: Attempts, number: int, p: Array, w: Array, u: Array) -> Iterate:
        seen.append(p)
        return Iterate(number, next(left), p, w, u)

    monkeypatch.setattr(Attempts, "judged", judged)
    return seen


def test_from_near_a_solution_plain_newton_ends_where_the_residual_rises(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, random = given(), np.random.default_rng(1)
    for near, most in ((True, 4), (False, 6)):
        told(monkeypatch, 0.5, 0.4, 0.4, 0.6, 0.3, 0.0)
        answers = iter([random.random(len(problem.gap)) for _ in range(6)])
        attempt = Attempts(problem, Scripted(problem, answers), 0.0, 100)
        attempt(replace(start_of(problem), near=near))
        assert len(attempt.history) == most


@pytest.mark.parametrize(
    ("residuals", "begun", "back"),
    [
        ((0.5, 0.4, 0.4, 0.6), 0.6, False),  # a little larger: damped from there on
        ((0.5, 0.4, 0.4, 3.0), 0.4, True),  # as large as all tractions: from the iterate before
        ((0.5, 0.4, 0.4, 1.0), 1.0, False),
        ((2.0, 1.0, 1.0, 3.0), 1.0, False),
    ],
)
def test_from_near_a_solution_an_attempt_is_damped_where_the_residual_rises(
    residuals: tuple[float, ...], begun: float, back: bool, held: SurfaceProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    begins = list[Array]()

    def watched(self: LineSearch, *step: Array) -> float:
        begins.append(step[0])
        return 1.0

    monkeypatch.setattr(LineSearch, "__call__", watched)
    judged, bodies = told(monkeypatch, *residuals, 0.2, 0.3, 0.0), Bodies(held)
    Attempts(held, bodies, 0.0, 100)(replace(start_of(held), near=True), 1e-2)
    assert_allclose([laws.weight for laws in bodies.asked], [0.0, 0.0, 0.0, 1e-2 * begun, 1e-3 * 0.2, 1e-4 * 0.3])
    assert begins[0] is judged[2 if back else 3]
    (_, u), (p, _) = bodies.answers[1 if back else 2], (begins[0], 0)
    expected = linearise(held, p + held.gamma * (held.relative_displacement(u) - held.gap), held.gamma)
    assert_allclose(bodies.asked[3].rhs, expected.proximal(p, 1e-2 * begun, held.gamma, 0.0).rhs, atol=1e-14)


def test_from_near_a_solution_a_damped_attempt_is_held_where_plain_newton_is_not(held: SurfaceProblem) -> None:
    def held_by_the_term(laws: ActiveSet, u: Array) -> tuple[Array, Array]:
        tried.append(laws.weight)
        if tried.count(1e-2) < 2:  # and not at once
            raise np.linalg.LinAlgError
        return condensed_system.solve(laws, u)

    for near, proximal, weights in ((True, 1e-2, 2), (False, 1e-2, 0), (True, None, 0)):
        tried, bodies = list[float](), Bodies(held, held_by_the_term)
        attempt = Attempts(held, bodies, 0.0, 1)
        attempt(replace(start_of(held), near=near, in_equilibrium=False), proximal)
        assert [laws.weight for laws in bodies.asked] == [0.0] * attempts.RETREATS + [1e-2] * weights
        assert len(attempt.history) == weights // 2


def test_the_proximal_term_fades_with_full_steps_and_comes_back_with_short_ones(
    held: SurfaceProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    shares, firm = [1.0, 1.0, 0.5, 0.1, 0.05, 0.05, 0.05, 1.0], [1.0, 0.1, 0.01, 0.01, 0.01, 0.1, 1.0, 1.0]
    left, bodies = iter(shares), Bodies(held)
    monkeypatch.setattr(LineSearch, "__call__", lambda self, *step: next(left))
    told(monkeypatch, *[0.5] * len(shares), 0.0)
    Attempts(held, bodies, 0.0, 100)(start_of(held), 1e-2)
    assert_allclose([laws.weight for laws in bodies.asked], 0.5 * 1e-2 * np.array(firm))


def test_slip_is_counted_from_where_points_touch_in_the_best_iterate(
    held: SurfaceProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    gaps, asked = [held.gap, held.gap + 1e-3, held.gap + 2e-3], list[tuple[Array, ...]]()

    def touch(p: Array, w: Array, gap: Array) -> Array:
        asked.append((p, w, gap))
        return gaps[min(len(asked), 2)]

    bodies = Bodies(held)
    attempt = Attempts(replace(held, touch=touch), bodies, 1e-12, 100)
    start = start_of(held)
    first = attempt.judged(3, start.p, bodies.relative(start.p, start.u_c), start.u_c)
    assert (first.number, first.gap is held.gap, asked) == (3, True, [])
    attempt.follows = True
    attempt(start)
    assert [gap for _, _, gap in asked[:3]] == [gaps[0], gaps[1], gaps[2]]
    assert (asked[0][0] is start.p, asked[1][0] is bodies.answers[0][0]) == (True, True)
    assert_array_equal(asked[0][1], bodies.relative(start.p, start.u_c))
    assert attempt.best.status is Status.CONVERGED
    assert attempt.best.gap is attempt.problem.gap is gaps[2]
    exact = CondensedNewton(rtol=1e-13)(replace(held, gap=gaps[2]), np.zeros(len(held.gap)))
    assert_allclose(attempt.best.p, exact.p, atol=1e-10 * np.abs(exact.p).max())
    iterates = [(start.p, start.u_c), *bodies.answers]
    for laws, (p, u), gap in zip(bodies.asked, iterates, [gaps[1], *[gaps[2]] * 9], strict=False):
        p_hat = p + held.gamma * (held.relative_displacement(u) - gap)
        assert_allclose(laws.rhs, linearise(replace(held, gap=gap), p_hat, held.gamma).rhs, atol=1e-15)
    for p, more in ((attempt.best.p, 1), (-attempt.best.p, 0)):  # as good as the best, and worse
        count = len(asked)
        attempt.judged(9, p, attempt.best.w, attempt.best.u_c)
        assert len(asked) == count + more
    searches: list[LineSearch] = []
    monkeypatch.setattr(LineSearch, "__call__", lambda self, *step: searches.append(self) or 1.0)
    damped = Attempts(replace(held, touch=lambda *at: gaps[1]), bodies, 1e-12, 2)
    damped.follows = True
    damped(start, 1e-2)
    assert searches
    assert all(search.problem is damped.problem for search in searches)
    assert_array_equal(searches[0].gamma, held.gamma)


def test_an_iterate_is_judged_with_the_gap_that_is_told(floating: SurfaceProblem) -> None:
    moved = replace(floating, gap=floating.gap + 1e-3)
    exact = CondensedNewton(rtol=1e-13)(moved, np.zeros(len(moved.gap)))
    attempt, p = Attempts(replace(floating, touch=lambda *at: moved.gap), Bodies(floating), 0.0, 9), 1.5 * exact.p
    attempt.follows = True
    x = attempt.judged(0, p, exact.w, exact.u_c)
    assert (x.residual, x.gap is moved.gap) == (moved.imbalance(p), True)
    assert moved.natural_residual(p, exact.w) < 1e-9 < x.residual


def test_the_proximal_term_has_one_weight_in_laws_and_on_rigid_motions(floating: SurfaceProblem) -> None:
    asked, laws = list[Any](), linearise(floating, closed(floating), floating.gamma)
    p, u = closed(floating), np.ones(floating.surface.size)

    class Asked(Bodies):
        def solve(self, laws: ActiveSet, p: Array, u: Array) -> tuple[Array, Array]:
            asked.append((laws, p, u))
            return p, u

    attempt = Attempts(floating, Asked(floating), 0.0, 9)
    for weight in (0.0, 0.3):
        attempt.solved(laws, p, u, weight)
        assert (asked[-1][1] is p, asked[-1][2] is u) == (True, True)
    assert asked[0][0] is laws
    assert (asked[1][0].weight, asked[1][0].hold) == (0.3, 0.3)
    assert_allclose(asked[1][0].rhs, laws.proximal(p, 0.3, floating.gamma, 0.3).rhs)


def test_a_collapse_that_is_met_is_told_unless_a_solution_is_found(held: SurfaceProblem) -> None:
    attempt, motion = Attempts(held, Bodies(held), 1e-12, 1), np.ones(held.surface.size)
    attempt.collapse = Mechanism(motion, 0.25)
    found = attempt.follow(iter([(start_of(held), None)]))
    assert (found.status, found.residual, found.lacking, found.u_c is motion) == (Status.GIVES_WAY, np.inf, 0.25, True)
    assert_array_equal([found.p, found.w], np.zeros((2, len(held.gap))))
    assert [step.iteration for step in found.history] == [0, 1]
    attempt.max_it = 100
    assert attempt.follow(iter([(start_of(held), None)])).status is Status.CONVERGED


@pytest.mark.parametrize(("proximal", "residuals"), [(None, 2), (1e-3, 3)])
def test_a_plain_attempt_that_was_near_and_lacks_more_than_there_is_ends(
    proximal: float | None, residuals: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = given()
    zero, attempt = np.zeros(len(problem.gap)), Attempts(problem, Bodies(problem, solve_given), 1e-8, 100)
    met = [Iterate(k, x, p=k + zero, w=zero) for k, x in enumerate((0.9 * NEAR, 2.0, 1e-9), start=1)]
    monkeypatch.setattr(attempt, "iterates", lambda *given: iter(met))
    attempt(Start.at(problem, zero, problem.contact_displacement(zero)), proximal)
    assert len(attempt.history) == residuals
    assert attempt.stalled == (proximal is None)
