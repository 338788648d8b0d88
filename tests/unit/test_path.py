"""Where Newton's method fails: the path through the kinks of the laws, and several solutions."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from shared.problems import scene_of, surface_problem, two_blocks
from stickslip.geometry.arrays import CLOSE, SLIGHT, Array
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Solution, Status
from stickslip.solvers.laws.friction import CoulombByPoint
from stickslip.solvers.methods.condensed_newton import CondensedNewton
from stickslip.solvers.newton import path
from stickslip.solvers.newton.attempts import Start
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.stepping.stepper import Accepted
from stickslip.workflows.lab.verification.prepared import prepare

DRIVEN = {"top": {"boundary": "block.top", "displacement": {"x": 0.06, "y": -0.1}}}
PULLED = {"pull": {"boundary": "block.top", "traction": [0.02, -0.1]}}
COULOMB = {"law": "coulomb", "mu": 0.4}


def block(normal: Any = None, friction: Any = None, dim: int = 2, **tables: Any) -> Scene:
    """A block pressed and dragged in one step."""
    laws = {"normal": normal or {"law": "unilateral"}} | ({"friction": friction} if friction else {})
    base = {"surface": "block.bottom", "against": "foundation"} | laws
    return scene_of(dim, **{"contacts": {"base": base}, "supports": DRIVEN} | tables)


def floating() -> Scene:
    """Pressed and pulled by tractions, held by the contact alone."""
    return block(friction=COULOMB, supports={}, loads=PULLED)


def gaps() -> Scene:
    """Pressed onto a hill between two symmetry planes and a wall: rows open, close, and have no friction."""
    hill = {"shape": "cylinder", "point": [0.8, -4.05], "radius": 4.0}
    wall = {"shape": "plane", "point": [2.005, 0.0], "normal": [-1.0, 0.0]}
    low, right = ({"surface": f"block.{side}", "against": to, "friction": COULOMB}
                  for side, to in (("bottom", "foundation"), ("right", "wall")))  # fmt: skip
    supports = {
        "top": {"boundary": "block.top", "displacement": {"y": -0.12}},
        "left": {"boundary": "block.left", "displacement": {"x": 0.0}},
    }
    return block(obstacles={"foundation": hill, "wall": wall}, contacts={"low": low, "right": right}, supports=supports)


SCENES: dict[str, Callable[[], Scene]] = {
    "frictionless": block,
    "coulomb": lambda: block(friction=COULOMB),
    "little friction": lambda: block(friction={"law": "coulomb", "mu": 0.05}),
    "much friction": lambda: block(friction={"law": "coulomb", "mu": 3.0}),
    "compliance": lambda: block({"law": "compliance", "c_n": 5.0}, COULOMB | {"k_T": 4.0}),
    "bound by penetration": lambda: block({"law": "compliance", "c_n": 5.0}, {"law": "compliance", "c_T": 2.0}),
    "two bodies": lambda: two_blocks(
        2,
        {"x": 0.06, "y": -0.05},
        {"friction": COULOMB},
        bodies={"upper": {"E": 1.0, "nu": 0.3}, "lower": {"E": 3.0, "nu": 0.2}},
    ),
    "gaps": gaps,
    "bilateral": lambda: block({"law": "bilateral"}, COULOMB),
    "floating": floating,
}
HELD = [name for name in SCENES if name not in ("bilateral", "floating")]


@cache
def problem_of(name: str) -> SurfaceProblem:
    """The surface problem of the only step."""
    return surface_problem(prepare(SCENES[name]()))


@cache
def solved(name: str) -> Solution:
    problem = problem_of(name)
    found = CondensedNewton(rtol=1e-12)(problem, np.zeros(len(problem.gap)))
    assert found.status is Status.CONVERGED
    return found


def check(name: str, ends: list[Start]) -> None:
    """One end, the solution; Newton has nothing left to do."""
    (end,), problem, expected = ends, problem_of(name), solved(name)
    assert problem.natural_residual(end.p, problem.relative_displacement(end.u_c)) < 1e-11
    assert problem.imbalance(end.p) < 1e-11
    assert_allclose(end.p, expected.p, atol=1e-9 * np.abs(expected.p).max())
    assert_allclose(end.u_c, expected.u_c, atol=1e-9 * np.abs(expected.u_c).max())
    r = problem.relative_displacement(end.u_c) - problem.gap
    assert_allclose(end.p_hat, end.p + problem.gamma * r, atol=1e-15)


@pytest.mark.parametrize("name", HELD)
def test_it_arrives_from_all_open(name: str) -> None:
    check(name, list(path.path_from_open(problem_of(name))))


def test_no_path_begins_open_where_contact_cannot_open() -> None:
    assert not list(path.path_from_open(problem_of("bilateral")))


@pytest.mark.parametrize("refresh", [1, 10**6])
def test_rounding_does_not_lead_it_away(refresh: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(path, "REFRESH", refresh)
    check("coulomb", list(path.path_from_open(problem_of("coulomb"), 3000)))


def test_it_gives_up_when_its_kinks_are_used_up(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = problem_of("coulomb")
    passed, change = [], path._Path._change
    monkeypatch.setattr(path._Path, "_change", lambda self, row, to: passed.append(row) or change(self, row, to))
    check("coulomb", list(path.path_from_open(problem)))
    needed = len(passed) + 1  # the last piece has no kink at its end
    assert needed > problem.surface.normal_rows / 2  # each row that closes in the end is a kink
    assert not list(path.path_from_open(problem, needed - 1))
    check("coulomb", list(path.path_from_open(problem, needed)))


def begun(name: str, kinks: int = 0) -> path._Path:
    """A path from all open that has passed so many kinks: some rows are closed then."""
    problem = problem_of(name)
    wider = np.where(np.arange(len(problem.gap)) < problem.surface.normal_rows, 1.0 + np.arange(len(problem.gap)), 0.0)
    at = path._Path(path._Map.of(problem), wider)
    assert not list(at.solutions(kinks))
    return at


def test_no_kink_ahead_is_the_end_on_the_way_to_zero_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(path._Path, "_next_kink", lambda self, dp: (np.inf, -1, -1))
    forth, back = begun("coulomb"), begun("coulomb")
    assert len(list(forth.solutions(3))) == 1
    back.direction = 1.0
    assert not list(back.solutions(3))


def test_a_singular_piece_is_no_end(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = problem_of("coulomb")
    monkeypatch.setattr(path, "EXACT", np.inf)
    assert not list(path.path_from_open(problem))


@pytest.mark.parametrize("name", ["coulomb", "gaps"])
def test_what_is_off_the_path_returns_to_it(name: str) -> None:
    at = begun(name, 3)
    at.p[at.map.rows] += 1e-6 * np.abs(at.p).max() * np.arange(len(at.map.rows))
    at._evaluate()
    assert np.abs(at.map.value(at.p, at.trial, at.state)).max() > 1e-7 * np.abs(at.p).max()
    at._correct()
    assert_allclose(at.map.value(at.p, at.trial, at.state), 0.0, atol=1e-12 * np.abs(at.p).max())


@pytest.mark.parametrize("name", ["gaps", "compliance"])
def test_the_map_is_linear_on_a_piece(name: str) -> None:
    """Its Jacobian gives the difference of any two values in the same states."""
    maps, random = path._Map.of(problem_of(name)), np.random.default_rng(7)
    p, dp, nothing = *random.normal(size=(2, len(maps.share))), np.zeros(len(maps.share))
    dp[np.setdiff1d(np.arange(len(dp)), maps.rows)] = 0.0
    trial = maps.trial(p, nothing)
    state = maps.states(trial, maps.bound @ p)
    before = maps.value(p, trial, state)
    after = maps.value(p + dp, maps.trial(p + dp, nothing), state)
    assert_allclose(after - before, maps.jacobian(state) @ dp[maps.rows], atol=1e-12 * np.abs(after).max())


def test_a_direction_without_multiplier_is_left_out() -> None:
    """The traction of its row is no unknown, and zero."""
    whole = problem_of("coulomb")
    (rows,) = whole.cone.contacts
    free = rows.free.copy()
    free[3] = False
    problem = replace(whole, cone=AdmissibleSet((replace(rows, free=free),), whole.cone.time, whole.cone.end))
    left_out = problem.surface.normal_rows + 3
    assert left_out not in path._Map.of(problem).rows
    (end,) = path.path_from_open(problem)
    assert end.p[left_out] == 0.0
    assert problem.natural_residual(end.p, problem.relative_displacement(end.u_c)) < 1e-11


def test_the_same_path_is_followed_again() -> None:
    problem = problem_of("gaps")
    (one,), (other,) = (list(path.path_from_open(problem)) for _ in range(2))
    assert_array_equal(one.p, other.p)


@pytest.mark.parametrize(
    ("normal", "friction", "dim", "expected"),
    [
        ("unilateral", COULOMB, 2, True),
        ("unilateral", None, 2, True),
        ("unilateral", COULOMB, 3, False),
        ("unilateral", {"law": "tresca", "bound": 0.02}, 2, False),
        ("unilateral", {"law": "stick"}, 2, False),
        ("m_n = 2", COULOMB, 2, False),
        ("m_n = 1", COULOMB, 2, True),
    ],
)
def test_it_is_for_piecewise_linear_problems_in_the_plane(normal: str, friction: Any, dim: int, expected: bool) -> None:
    laws = {"m_n = 2": {"law": "compliance", "c_n": 20.0, "m_n": 2.0}, "m_n = 1": {"law": "compliance", "c_n": 20.0}}
    drive = {"top": {"boundary": "block.top", "displacement": {"x": 0.01, "xyz"[dim - 1]: -0.1}}}
    scene = block(laws.get(normal), friction, dim, geometry={"mesh_size": 0.5}, supports=drive)
    problem = surface_problem(prepare(scene))
    assert path.applies(problem) is expected
    assert bool(list(path.path_from_open(problem))) is expected


def test_the_bodies_have_to_be_condensed() -> None:
    solver = {"surface": "matrix-free", "method": "surface-uzawa"}
    assert not path.applies(surface_problem(prepare(block(friction=COULOMB, solver=solver))))


def test_floating_bodies_have_no_path() -> None:
    assert not list(path.path_from_open(problem_of("floating")))


MUCH = {"law": "coulomb", "mu": 2.0}
SOFT = {"law": "compliance", "c_n": 20.0}


WEDGED = {"x": [[1.0, 0.05], [2.0, 0.12]], "y": [[1.0, -0.036], [2.0, 0.0013]]}  # and lifted off, but for friction
LIFTED = {"x": 0.1, "y": 0.02}


def reached(mu_s: float, mu_k: float, slip_length: float, top: dict[str, Any], count: int) -> Accepted:
    """The last step of a block with friction that weakens from mu_s."""
    law = {"law": "static_kinetic", "mu_s": mu_s, "mu_k": mu_k, "slip_length": slip_length}
    supports = {"top": {"boundary": "block.top", "displacement": top}}
    stepper = prepare(block(friction=law, supports=supports, steps={"end": float(count), "count": count})).stepper
    state = stepper.start()
    for time in range(1, count + 1):
        accepted = stepper.reach(state, float(time), lambda row: None)
        state = accepted.state
    return accepted


def frictional(friction: dict[str, Any] | None = MUCH, normal: Any = None, held: bool = True) -> SurfaceProblem:
    """A block pressed and dragged in one step."""
    drive: dict[str, Any] = {} if held else {"supports": {}, "loads": PULLED}
    return surface_problem(prepare(block(normal, friction, **drive)))


@pytest.mark.parametrize(
    ("friction", "normal", "most"),
    [
        (None, None, 0.0),
        ({"law": "coulomb", "mu": 0.4}, None, 0.4),
        ({"law": "coulomb", "mu": 3.0}, None, 3.0),
        ({"law": "compliance", "c_T": 50.0}, SOFT, 2.5),  # c_T d under p = c_n d
    ],
)
def test_the_most_friction_is_that_of_the_laws(friction: dict[str, Any] | None, normal: Any, most: float) -> None:
    assert path._most_friction(frictional(friction, normal)) == pytest.approx(most)


def test_points_that_have_slipped_hide_no_others() -> None:
    """One end has mu = .9, the other points 2: it is wedged, and could as well be off the ground."""
    accepted = reached(2.0, 0.9, 1e-3, WEDGED, 2)
    (contact,) = accepted.problem.cone.contacts
    assert isinstance(contact.friction, CoulombByPoint)
    assert_allclose(np.unique(contact.friction.mu), [0.9, 2.0])
    assert path._most_friction(accepted.problem) == pytest.approx(2.0)
    assert accepted.state.p.max() > 0.01
    assert_array_equal(accepted.others, [np.zeros_like(accepted.state.p)])


@pytest.mark.parametrize(
    ("friction", "held", "looked_for"),
    [
        (MUCH, True, True),
        ({"law": "coulomb", "mu": path.ENOUGH}, True, False),
        (None, True, False),
        ({"law": "stick"}, True, False),
        ({"law": "tresca", "bound": 0.1}, True, False),
        (MUCH, False, False),
        ({"law": "capped_coulomb", "mu": 2.0, "s_max": 0.1}, True, False),
        ({"law": "capped_coulomb", "mu": 2.0, "s_max": 0.1}, False, False),
    ],
)
def test_others_are_looked_for_where_there_may_be_some(
    friction: dict[str, Any] | None, held: bool, looked_for: bool,
    monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    problem, asked = frictional(friction, held=held), list[int]()
    monkeypatch.setattr(path, "path_from_open", lambda of, kinks: asked.append(kinks) or iter(()))
    assert not list(path.others(problem, np.zeros(len(problem.gap))))
    assert asked == ([path.FOLLOWED] if looked_for else [])


@pytest.mark.parametrize("size", [1e-6, 1.0])
def test_each_solution_is_said_once(size: float, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = frictional(MUCH)
    p, other = size * np.random.default_rng(0).random((2, len(problem.gap)))
    met: list[tuple[Array, float]] = [
        (p * (1 + 0.5 * SLIGHT), 0.0),  # the known one
        (2 * other, 2 * CLOSE),  # no solution
        (other, 0.5 * CLOSE),
        (other * (1 + 0.5 * SLIGHT), 0.0),
        (-p, 0.0),
        (p * (1 - 2 * SLIGHT), 0.0),
        (np.zeros_like(p), 0.0),
    ]
    nowhere = np.zeros(problem.surface.size)
    residuals = iter([residual for _, residual in met])

    def starts(of: SurfaceProblem, kinks: int) -> Iterator[Start]:
        return (Start(p=at, u_c=nowhere, p_hat=at) for at, _ in met)

    monkeypatch.setattr(path, "path_from_open", starts)
    monkeypatch.setattr(SurfaceProblem, "natural_residual", lambda self, p, w: next(residuals))
    found = list(path.others(problem, p))
    assert_array_equal(found, [other, -p, p * (1 - 2 * SLIGHT), 0 * p])


def test_solutions_are_apart_by_a_part_of_the_larger_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside a known state that is all but open: what differs from it by little is measured by what is met."""
    problem = frictional(MUCH)
    zero = np.zeros(len(problem.gap))
    one = zero + 1.0
    end = Start(p=one, u_c=np.zeros(problem.surface.size), p_hat=one)
    monkeypatch.setattr(path, "path_from_open", lambda of, kinks: iter([end]))
    monkeypatch.setattr(SurfaceProblem, "natural_residual", lambda self, p, w: 0.0)
    assert len(list(path.others(problem, zero))) == 1
    assert not list(path.others(problem, one))


def test_tractions_that_are_rounding_are_no_other_solution(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = frictional(MUCH)
    touching = np.full(len(problem.gap), 1e-16 * problem.p_ref)
    end = Start(p=0 * touching, u_c=np.zeros(problem.surface.size), p_hat=0 * touching)
    monkeypatch.setattr(path, "path_from_open", lambda of, kinks: iter([end]))
    monkeypatch.setattr(SurfaceProblem, "natural_residual", lambda self, p, w: 0.0)
    assert not list(path.others(problem, touching))


def test_others_have_the_friction_of_their_own_slip() -> None:
    """Three answers with mu = 3 everywhere: open, stick, and one that slips, which has not 3 then."""
    accepted = reached(3.0, 0.1, 0.01, LIFTED, 1)
    assert not accepted.state.p.any()
    frozen = list(path.others(accepted.problem, accepted.state.p))
    assert len(frozen) == 2
    assert_array_equal(accepted.others, frozen[1:])
