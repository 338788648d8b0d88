"""The interior point: steps keep to the equations of its way, which leads to the solution."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from shared.cases import every_nth
from shared.problems import pressed, scene_of, surface_problem
from stickslip.geometry.arrays import SLIGHT, Array
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import QUICK, Iterate, Status
from stickslip.solvers.laws.law import Trial
from stickslip.solvers.laws.wear import Worn
from stickslip.solvers.methods.condensed_newton import CondensedNewton
from stickslip.solvers.newton import condensed_system, interior_point
from stickslip.solvers.newton.active_set import linearise
from stickslip.solvers.newton.attempts import Attempts, Start, closed
from stickslip.solvers.newton.interior_point import BORDER, Point, Rounded, first, on_the_way, way
from stickslip.solvers.newton.rigid_bodies import RigidBodies, coming_to_rest
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

TIGHT = {"tolerance": 1e-11}
LAWS = [
    ("unilateral", "coulomb"), ("unilateral", "tresca"), ("unilateral", "stick"), ("bilateral", "coulomb"),
    ("linear", "coulomb"), ("power", "tresca"), ("power", "penetration"), ("unilateral", "soft coulomb"),
    ("worn", "coulomb"), ("worn power", "soft coulomb"),
]  # fmt: skip
PULLED = {"pull": {"boundary": "block.top", "traction": [0.02, -0.1]}}

BASE = {"gap_offset": 0.3, "friction": {"law": "coulomb", "mu": 0.4}}
RING = {"builder": "ring", "inner_radius": 0.65, "outer_radius": 1.0, "mesh_size": 0.2, "order": 2}
BLOCK = {"builder": "block", "length": 2.0, "width": 1.0, "height": 1.0, "mesh_size": 0.5, "order": 2}
SQUEEZED = {
    "plane stress": (RING, ("ring.outer", "ring.outer"), [0.0, 1.0]),
    "3d": (BLOCK, ("block.bottom", "block.top"), [0.0, 0.0, 1.0]),
}


class Bodies:
    """Exact bodies."""

    def __init__(self, problem: SurfaceProblem) -> None:
        self.problem = problem

    def solve(self, laws: Any, p: Array, u: Array) -> tuple[Array, Array]:
        assert (len(p), len(u)) == (self.problem.cone.size, self.problem.surface.size)
        return condensed_system.solve(laws, u)

    def relative(self, p: Array, u: Array) -> Array:
        assert len(p) == self.problem.cone.size
        return self.problem.relative_displacement(u)


@cache
def problem_of(dim: int, normal: str, friction: str | None) -> SurfaceProblem:
    worn, law = normal.startswith("worn"), normal.split()[-1].replace("worn", "unilateral")
    problem = surface_problem(prepare(pressed(dim, law, friction, solver=TIGHT)))
    (own,) = problem.cone.contacts
    if worn:
        own = replace(own, normal=Worn(of=own.normal, softness=np.resize([0.1, 0.3], len(own.W_n))))
    return replace(problem, cone=replace(problem.cone, contacts=(own,)))


@cache
def floating() -> SurfaceProblem:
    return surface_problem(prepare(scene_of(base=BASE, loads=PULLED)))


def resting(problem: SurfaceProblem) -> Start:
    """Where rigid bodies would rest, held ones too."""
    model = Attempts(replace(problem, touch=None), RigidBodies(problem), 1e-8, 500)
    found = model.follow(coming_to_rest(model))
    assert found.status is Status.CONVERGED
    return Start.at(problem, found.p, found.u_c)


def far(problem: SurfaceProblem) -> Start:
    """The bodies where they stood, under even pressures."""
    return Start.at(problem, closed(problem), problem.u_before)


@cache
def squeezed(model: str) -> SurfaceProblem:
    """A body between planes that close."""
    shape, sides, up = SQUEEZED[model]
    rough = {"friction": {"law": "coulomb", "mu": 0.35}}
    floor = {"shape": "plane", "point": [-x for x in up] if shape is RING else [0.0] * len(up), "normal": up}
    close = {"xyz"[len(up) - 1]: -0.02}
    lid = {"shape": "plane", "point": up, "normal": [-x for x in up], "displacement": close}
    scene = {
        "model": model,
        "geometry": shape,
        "bodies": {sides[0].split(".")[0]: {"E": 80.0, "nu": 0.3}},
        "obstacles": {"floor": floor, "lid": lid},
        "contacts": {
            name: {"surface": s, "against": name} | rough for s, name in zip(sides, ("floor", "lid"), strict=True)
        },
    }
    return surface_problem(prepare(from_dict(scene)))


@pytest.mark.parametrize(("laws", "dim"), every_nth(2, LAWS, [2, 3]))
def test_a_point_of_the_way_stays_and_its_tangent_is_that_of_the_way(laws: tuple[str, str], dim: int) -> None:
    """Tractions and gaps that satisfy the equations satisfy the linear ones, and so do small changes along the way."""
    problem, tau, random = problem_of(dim, *laws), 1e-3, np.random.default_rng(3)
    (place,), rows, n = problem.cone.places, problem.cone.size, problem.surface.normal_rows
    free, friction = place.rows.free, place.rows.friction
    p = random.uniform(0.1, 0.4, rows)
    direction = random.normal(size=free.shape) * free
    share = random.uniform(0.2, 0.8, len(free))[:, None] / np.linalg.norm(direction, axis=1, keepdims=True)
    both = place.rows.normal.sides == 2

    def point(p_n: Array, part: float) -> tuple[Array, Array, Array]:
        """p, w and y by pressures, and by the part of the friction bound."""
        p = np.concatenate([p_n, np.zeros(rows - n)])
        s = np.minimum(problem.cone.bound(place, p_n), 1.0)[:, None]
        t = part * share * s * direction
        stuck = np.isinf(problem.cone.bound(place, p_n))[:, None]
        slip = np.where(stuck, 0.0, 2 * tau * t / (s**2 - np.sum(t**2, axis=1, keepdims=True)))
        p[n:] = t.ravel()
        w, y = problem.gap + problem.cone.give(p), tau / p_n
        w[n:] += slip.ravel()
        w[:n] -= 0 if both else y
        return p, w, y

    p, w, y = point(p[:n], 1.0)
    posed, trial = on_the_way(problem, Point(p, w, np.zeros(0), y), tau)
    system = linearise(posed, trial, problem.gamma)

    def defect(p: Array, w: Array) -> Array:
        return np.asarray(system.A_p @ p + system.A_w @ w - system.rhs)

    assert_allclose(defect(p, w), 0.0, atol=1e-6)
    h = 1e-5
    ahead, behind = (point(p[:n] + s * h * random.uniform(0.5, 1.0), 1.0 + s * h)[:2] for s in (1.0, -1.0))
    change = (defect(*ahead) - defect(*behind)) / (2 * h)
    assert_allclose(change, 0.0, atol=1e-4 * np.abs(problem.gamma).max())
    assert friction is not None


@pytest.mark.parametrize("soft", [None, 5.0])
def test_rounded_friction_slips_before_it_reaches_the_bound(soft: float | None) -> None:
    problem, tau, gamma = problem_of(3, "unilateral", "coulomb"), 0.02, 3.0
    (place,) = problem.cone.places
    law = Rounded(cone=problem.cone, place=place, tau=tau, k_T=soft)
    p, size = np.full(problem.surface.normal_rows, 0.5), np.geomspace(1e-3, 10.0, len(place.rows.free))
    s, h = problem.cone.bound(place, p), 1e-6

    def found(size: Array, p: Array) -> Array:
        return law.dragged(p, place.average, Trial(size, np.full_like(size, gamma))).bound

    t = found(size, p)
    assert np.all((t > 0) & (t < s))
    assert_allclose(t * (1 + gamma * law.softness) + gamma * 2 * tau * t / (s**2 - t**2), size, rtol=1e-9)
    known = law.dragged(p, place.average, Trial(size, np.full_like(size, gamma)))
    assert_allclose(known.by_trial, (found(size + h, p) - found(size - h, p)) / (2 * h), atol=1e-6)
    by_pressure = (found(size, p + h) - found(size, p - h)) / (2 * h)
    assert_allclose(known.by_pressure @ np.ones_like(p), by_pressure, atol=1e-6)


@pytest.mark.parametrize("laws", [*(each for each in LAWS if each[0] != "bilateral"), ("unilateral", None)])
def test_the_way_leads_to_the_solution(laws: tuple[str, str | None]) -> None:
    problem = problem_of(2, *laws)
    check(problem)


def test_the_way_leads_floating_bodies_into_contact() -> None:
    """Without tractions to begin with, and with a gap that the block has to travel through."""
    check(floating())


@pytest.mark.parametrize("model", SQUEEZED)
def test_bodies_that_nothing_presses_on_the_way_are_not_solved(model: str) -> None:
    """No traction is the law's where the way has left them, but it is not the bodies'."""
    check(squeezed(model))


def check(problem: SurfaceProblem) -> None:
    """The way ends near the solution, and no iterate says that it is nearer than it is."""
    attempt, zero, met = Attempts(problem, Bodies(problem), 0.0, 500), np.zeros(problem.cone.size), list[Iterate]()
    run = attempt.run
    attempt.run = lambda iterates, *args: run((met.append(x) or x for x in iterates), *args)
    (start,) = way(attempt, resting(problem))
    exact = CondensedNewton(rtol=1e-12)(problem, zero)
    assert exact.status is Status.CONVERGED
    assert len(attempt.history) <= 25
    assert all(np.abs(x.p - exact.p).max() < 5 * x.residual * np.abs(exact.p).max() for x in met)
    assert_allclose(start.p, exact.p, atol=10 * SLIGHT * np.abs(exact.p).max())
    assert problem.natural_residual(start.p, problem.relative_displacement(start.u_c)) <= SLIGHT
    assert (start.near, start.in_equilibrium) == (True, False)


def test_the_way_goes_on_as_long_as_tau_falls(monkeypatch: pytest.MonkeyPatch) -> None:
    """Residuals are no measure of it: one that happened to be small would end it."""
    problem = problem_of(2, "unilateral", "coulomb")
    attempt, judged = Attempts(problem, Bodies(problem), 0.0, 500), Attempts.judged
    monkeypatch.setattr(Attempts, "judged", lambda *args: replace(judged(*args), residual=2 * SLIGHT))
    assert list(way(attempt, far(problem)))
    assert len(attempt.history) > QUICK


def test_what_follows_does_not_know_where_points_touched_on_the_way() -> None:
    class Asked:
        times = 0

        def __call__(self, p: Array, w: Array, gap: Array) -> Array:
            self.times += 1
            return gap

    problem = replace(problem_of(2, "unilateral", "coulomb"), touch=Asked())
    attempt = Attempts(problem, Bodies(problem), 1e-8, 100)
    attempt.follows = True
    assert list(way(attempt, resting(problem)))
    assert [x.touch.times > 0 for x in (problem, attempt.problem)] == [False, True]


def test_nothing_follows_where_iterations_run_out_on_the_way() -> None:
    problem = floating()
    found = CondensedNewton(rtol=1e-12, max_it=3)(problem, np.zeros(problem.cone.size))
    assert (found.status, found.iterations) == (Status.MAX_IT, 3)


def test_a_step_ends_nearly_where_the_first_gap_is_zero_or_is_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    towards, steps = Point.towards, list[tuple[Point, float, Point]]()

    def moved(at: Point, *to: Any) -> Point:
        steps.append((at, to[-1], towards(at, *to)))
        return steps[-1][-1]

    monkeypatch.setattr(Point, "towards", moved)
    assert list(way(Attempts(floating(), Bodies(floating()), 0.0, 500), far(floating())))
    shares = [share for _, share, _ in steps[::2]]  # behind each comes what its line search leaves
    left = [min((y.y / x.y).min(), (y.p[: len(x.y)] / x.p[: len(x.y)]).min()) for x, _, y in steps[::2]]
    short = np.array(shares) < 1
    assert short.any()
    assert_allclose(np.array(shares)[~short], 1.0)
    assert_allclose(np.array(left)[short], 1 - interior_point.NEARLY)
    assert min(left) > 1 - interior_point.NEARLY - 1e-9


def test_a_way_goes_on_counting_and_is_no_longer_than_an_attempt(monkeypatch: pytest.MonkeyPatch) -> None:
    attempt, short = (Attempts(floating(), Bodies(floating()), 0.0, 500) for _ in range(2))
    rest = far(floating())
    assert len([*way(attempt, rest), *way(attempt, rest)]) == 2
    assert [step.iteration for step in attempt.history] == [*range(1, len(attempt.history) + 1)]
    assert len(attempt.history) % 2 == 0
    monkeypatch.setattr(interior_point, "ATTEMPT", 4)
    assert list(way(short, rest)) == [None]
    assert [step.iteration for step in short.history] == [1, 2, 3, 4]


def test_a_long_way_waits_for_what_may_come_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """Then it goes on from where it was, however many iterations there were in between."""
    whole, attempt = (Attempts(floating(), Bodies(floating()), 0.0, 500) for _ in range(2))
    rest, (end,) = far(floating()), way(whole, far(floating()))
    monkeypatch.setattr(interior_point, "ATTEMPT", 12)
    points, problem = way(attempt, rest), attempt.problem
    assert next(points) is None
    assert attempt.last == 3
    attempt.problem = problem
    attempt.run(iter([Iterate(9, 1.0, rest.p, rest.p, rest.u_c)]))
    (start,) = points
    assert end is not None
    assert start is not None
    assert_array_equal(start.p, end.p)
    assert attempt.last == whole.last + 6
    assert [step.iteration for step in attempt.history[:5]] == [1, 2, 3, 9, 10]


def test_there_is_no_way_where_no_point_only_presses() -> None:
    problem = problem_of(2, "bilateral", "coulomb")
    attempt = Attempts(problem, Bodies(problem), 1e-8, 100)
    assert not list(way(attempt, resting(problem)))
    assert not attempt.history


def test_the_first_point_is_that_of_rigid_bodies_but_between_open_and_closed() -> None:
    problem, n = floating(), floating().surface.normal_rows
    rest, presses = resting(problem), np.ones(n, bool)
    x, give = first(problem, rest, presses), np.asarray(problem.give)[:n]
    border = BORDER * rest.p[:n].max()
    assert_allclose(x.p[:n] * x.y, border**2 * give)
    left = (problem.gap - x.w)[:n]
    assert_allclose(x.p[:n] - x.y / give, np.where(rest.p[:n] > 0, rest.p[:n], -np.maximum(left, 0.0) / give))
    assert_allclose(x.p[n:], rest.p[n:])
    far_off = replace(problem, gap=np.where(rest.p > 0, problem.gap, 1e9 * np.abs(problem.gap).max()))
    x = first(far_off, rest, presses)
    assert_allclose((x.p[:n] * x.y), border**2 * give)
    opened = rest.p[:n] == 0
    assert_allclose(x.y[opened], (far_off.gap - x.w)[:n][opened], rtol=1e-6)
