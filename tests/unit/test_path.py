"""Paths through the kinks of piecewise-linear problems arrive at the solution that Newton's method finds."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from stickslip.geometry.arrays import Array
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Solution, Status
from stickslip.solvers.methods.condensed_newton import CondensedNewton
from stickslip.solvers.newton import path
from stickslip.solvers.newton.attempts import Start, closed
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

SceneOf = Callable[..., Scene]
FLAT = {"foundation": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}}
DRIVEN = {"top": {"boundary": "block.top", "displacement": {"x": 0.06, "y": -0.1}}}
COULOMB = {"law": "coulomb", "mu": 0.4}


def block(normal: Any = None, friction: Any = None, dim: int = 2, **tables: Any) -> Scene:
    """A block pressed and dragged in one step."""
    shape = {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.25} | ({"width": 1.0} if dim == 3 else {})
    obstacle = {"shape": "plane", "point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}
    laws = {"normal": normal or {"law": "unilateral"}} | ({"friction": friction} if friction else {})
    scene = {
        "model": "plane strain" if dim == 2 else "3d",
        "geometry": shape,
        "bodies": {"block": {"E": 1.0, "nu": 0.3}},
        "obstacles": {"foundation": obstacle},
        "contacts": {"base": {"surface": "block.bottom", "against": "foundation"} | laws},
        "supports": DRIVEN,
    }
    return from_dict(scene | tables)


def two_blocks() -> Scene:
    """Of different cells, the upper one pressed and dragged."""
    sizes = {"length": 2.0, "height": 0.5, "mesh_size": 0.25}
    return from_dict(
        {
            "model": "plane strain",
            "geometry": {"builder": "two_blocks", "lower_mesh_size": 0.3} | sizes,
            "bodies": {"upper": {"E": 1.0, "nu": 0.3}, "lower": {"E": 3.0, "nu": 0.2}},
            "contacts": {"joint": {"surface": "upper.bottom", "against": "lower.top", "friction": COULOMB}},
            "supports": {
                "bed": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0}},
                "top": {"boundary": "upper.top", "displacement": {"x": 0.06, "y": -0.05}},
            },
        }
    )


def floating() -> Scene:
    """Pressed and pulled by tractions, held by the contact alone."""
    loads = {"pull": {"boundary": "block.top", "traction": [0.02, -0.1]}}
    return block(friction=COULOMB, supports={}, loads=loads)


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
    "two bodies": two_blocks,
    "gaps": gaps,
    "bilateral": lambda: block({"law": "bilateral"}, COULOMB),
    "floating": floating,
}
HELD = [name for name in SCENES if name not in ("bilateral", "floating")]
SURE = [name for name in SCENES if name != "much friction"]  # from an iterate it may lead away


@cache
def problem_of(name: str) -> SurfaceProblem:
    """The surface problem of the only step."""
    stepper = prepare(SCENES[name]()).stepper
    return stepper.reach(stepper.start(), 1.0, lambda row: None).problem


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


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("name", SURE)
def test_it_arrives_at_the_solution_from_any_tractions(name: str, seed: int) -> None:
    problem, random = problem_of(name), np.random.default_rng(seed)
    p, u_c = random.normal(size=len(problem.gap)), 0.1 * random.normal(size=problem.surface.size)
    p = problem.p_ref * np.where(np.arange(len(p)) < problem.surface.normal_rows, np.abs(p), 0.3 * p)
    check(name, list(path.path_from(problem, p, u_c, 3000)))


@pytest.mark.parametrize("name", SCENES)
def test_it_arrives_from_all_closed(name: str) -> None:
    problem = problem_of(name)
    check(name, list(path.path_from(problem, closed(problem), np.zeros(problem.surface.size), 3000)))


@pytest.mark.parametrize("name", HELD)
def test_it_arrives_from_all_open(name: str) -> None:
    check(name, list(path.path_from_open(problem_of(name), path.MOST_KINKS)))


def test_no_path_begins_open_where_contact_cannot_open() -> None:
    assert not list(path.path_from_open(problem_of("bilateral"), path.MOST_KINKS))


@pytest.mark.parametrize("refresh", [1, 10**6])
def test_rounding_does_not_lead_it_away(refresh: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(path, "REFRESH", refresh)
    for name in ("coulomb", "floating"):
        problem = problem_of(name)
        check(name, list(path.path_from(problem, closed(problem), np.zeros(problem.surface.size), 3000)))
    check("coulomb", list(path.path_from_open(problem_of("coulomb"), 3000)))


def test_it_gives_up_when_its_kinks_are_used_up(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = problem_of("coulomb")
    passed, change = [], path._Path._change
    monkeypatch.setattr(path._Path, "_change", lambda self, row, to: passed.append(row) or change(self, row, to))
    check("coulomb", list(path.path_from_open(problem, path.MOST_KINKS)))
    needed = len(passed) + 1  # the last piece has no kink at its end
    assert needed > problem.surface.normal_rows / 2  # each row that closes in the end is a kink
    assert not list(path.path_from_open(problem, needed - 1))
    check("coulomb", list(path.path_from_open(problem, needed)))


def test_a_start_that_holds_no_body_is_skipped() -> None:
    problem = problem_of("floating")
    off = np.zeros(len(problem.gap))
    far_above = problem.surface.R @ (problem.surface.R.T @ np.tile([0.0, 5.0], problem.surface.size // 2))
    assert not list(path.path_from(problem, off, far_above, 3000))


def test_it_goes_through_turning_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """s grows for a while where the determinant has changed its sign."""
    seen: list[float] = []
    move = path._Path._move

    def moved(self: Any, step: float, dp: Array, db: Array) -> None:
        seen.append(self.direction)
        move(self, step, dp, db)

    monkeypatch.setattr(path._Path, "_move", moved)
    problem, random = problem_of("much friction"), np.random.default_rng(3)
    for _ in range(8):
        p = problem.p_ref * random.normal(size=len(problem.gap))
        for end in path.path_from(problem, p, np.zeros(problem.surface.size), 3000):
            check("much friction", [end])
    assert 1.0 in seen


def begun(name: str) -> path._Path:
    """A path from all closed, before its first kink."""
    problem = problem_of(name)
    maps = path._Map.of(problem)
    zero = np.zeros(len(problem.gap))
    return path._Path(maps, closed(problem) + 1e-3 * problem.p_ref, np.zeros(problem.surface.R.shape[1]), zero)


def test_no_kink_ahead_is_the_end_on_the_way_to_zero_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(path._Path, "_next_kink", lambda self, dp, db: (np.inf, -1, -1))
    forth, back = begun("coulomb"), begun("coulomb")
    assert len(list(forth.solutions(3))) == 1
    back.direction = 1.0
    assert not list(back.solutions(3))


def test_a_singular_piece_is_no_end(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = problem_of("coulomb")
    monkeypatch.setattr(path, "EXACT", np.inf)
    assert not list(path.path_from_open(problem, path.MOST_KINKS))


@pytest.mark.parametrize("name", ["coulomb", "floating"])
def test_what_is_off_the_path_returns_to_it(name: str) -> None:
    at = begun(name)
    at.s = 0.7
    at.p[at.map.rows] += 1e-3 * np.arange(len(at.map.rows))
    at.b += 0.02
    at._evaluate()
    at._correct()
    value = at.map.value(at.p, at.b, at.trial, at.state)
    assert_allclose(value, 0.7 * at.at_start, atol=1e-12)
    assert np.abs(at.at_start).max() > 1e-3


@pytest.mark.parametrize(("name", "soft"), [("gaps", 0.0), ("compliance", 0.0), ("floating", 0.0), ("floating", 0.1)])
def test_the_map_is_linear_on_a_piece(name: str, soft: float) -> None:
    """Its Jacobian gives the difference of any two values in the same states, springs included."""
    maps, random = path._Map.of(problem_of(name), soft), np.random.default_rng(7)
    count, m, r = len(maps.share), len(maps.rows), maps.C.shape[1]
    dz, p, b, nothing = random.normal(size=m + r), random.normal(size=count), random.normal(size=r), np.zeros(count)
    dp = np.zeros(count)
    dp[maps.rows] = dz[:m]
    trial = maps.trial(p, b, nothing)
    state = maps.states(trial, maps.bound @ p)
    before = maps.value(p, b, trial, state)
    after = maps.value(p + dp, b + dz[m:], maps.trial(p + dp, b + dz[m:], nothing), state)
    assert_allclose(after - before, maps.jacobian(state) @ dz, atol=1e-12 * np.abs(after).max())
    assert maps.spring == soft * problem_of(name).surface.rho


def test_a_direction_without_multiplier_is_left_out() -> None:
    """The traction of its row is no unknown, and zero."""
    whole = problem_of("coulomb")
    (rows,) = whole.cone.contacts
    free = rows.free.copy()
    free[3] = False
    problem = replace(whole, cone=AdmissibleSet((replace(rows, free=free),), whole.cone.time, whole.cone.end))
    left_out = problem.surface.normal_rows + 3
    assert left_out not in path._Map.of(problem).rows
    (end,) = path.path_from(problem, closed(problem) + problem.p_ref / 10, np.zeros(problem.surface.size), 3000)
    assert end.p[left_out] == 0.0
    assert problem.natural_residual(end.p, problem.relative_displacement(end.u_c)) < 1e-11


def test_the_same_path_is_followed_again() -> None:
    problem = problem_of("gaps")
    for paths in (
        lambda: path.path_from(problem, closed(problem), np.zeros(problem.surface.size), 3000),
        lambda: path.path_from_open(problem, path.MOST_KINKS),
    ):
        (one,), (other,) = list(paths()), list(paths())
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
    shape = {"mesh_size": 0.5, "builder": "block", "length": 2.0, "height": 1.0} | ({"width": 1.0} if dim == 3 else {})
    scene = block(laws.get(normal), friction, dim, geometry=shape, supports=drive)
    stepper = prepare(scene).stepper
    problem = stepper.reach(stepper.start(), 1.0, lambda row: None).problem
    assert path.applies(problem) is expected
    best = CondensedNewton(rtol=1e-12)(problem, np.zeros(len(problem.gap)))
    assert bool(list(path.ends(problem, best.p, best))) is expected


def test_the_bodies_have_to_be_condensed() -> None:
    stepper = prepare(block(friction=COULOMB, solver={"surface": "matrix-free", "method": "surface-uzawa"})).stepper
    assert not path.applies(stepper.reach(stepper.start(), 1.0, lambda row: None).problem)


@pytest.mark.parametrize("name", ["coulomb", "floating"])
def test_budgets_grow_and_the_path_from_all_open_is_the_last_one(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    problem, best, tried = problem_of(name), solved(name), []
    monkeypatch.setattr(path, "path_from", lambda of, p, u, kinks, seed: tried.append((p, u, kinks, seed)) or iter(()))
    found = ["first"] * len(path.SOFT) if name == "floating" else ["first", "second"]

    def path_from_open(of: SurfaceProblem, *how: Any) -> Any:
        assert of is problem
        tried.append(("open", *how))
        return iter(["first", "second"])

    monkeypatch.setattr(path, "path_from_open", path_from_open)
    last = best.p / 2
    assert list(path.ends(problem, last, best)) == found  # on springs the first solution is enough
    rounds, rest = [tried[k : k + 3] for k in range(0, 9, 3)], tried[9:]
    for seed, (kinks, starts) in enumerate(zip(path.KINKS, rounds, strict=True)):
        assert [(budget, number) for _, _, budget, number in starts] == [(kinks, seed)] * 3
        for (p, u_c, *_), expected in zip(starts, (best.p, last, closed(problem)), strict=True):
            assert_allclose(p, expected)
            assert_allclose(u_c, 0.0 if expected is closed else u_c)
        assert not starts[2][1].any()
        assert starts[0][1] is starts[1][1] is best.u_c
    on_springs = [("open", path.KINKS[-1], soft) for soft in path.SOFT]
    assert rest == ([("open", path.MOST_KINKS)] if name == "coulomb" else on_springs)


def test_floating_bodies_on_soft_springs_are_nearly_where_they_rest() -> None:
    problem, exact = problem_of("floating"), solved("floating").p
    far = []
    for soft in (1e-2, 1e-4, 1e-6):
        (end,) = path.path_from_open(problem, 3000, soft)
        far.append(np.abs(end.p - exact).max() / np.abs(exact).max())
    assert far[0] > 10 * far[1] > 10 * far[2]
    assert far[2] < 1e-5  # the gaps are perturbed by some of that
