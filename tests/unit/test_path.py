"""Where Newton's method fails: paths through kinks, and several solutions."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from shared.problems import SceneOf, SimulationOf
from stickslip.geometry.arrays import CLOSE, SLIGHT, Array
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.limit_analysis import Mechanism
from stickslip.solvers.interface.prepare import condensed
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Solution, Status
from stickslip.solvers.laws.friction import CoulombByPoint
from stickslip.solvers.laws.normal import Compliance
from stickslip.solvers.methods.condensed_newton import CondensedNewton
from stickslip.solvers.newton import condensed_system, path, semismooth, uniqueness
from stickslip.solvers.newton.attempts import FIRM, Start, closed
from stickslip.solvers.newton.semismooth import SemismoothNewton
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.stepping.stepper import Accepted
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

FLAT = {"foundation": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}}
DRIVEN = {"top": {"boundary": "block.top", "displacement": {"x": 0.06, "y": -0.1}}}
TILTED = {"top": {"boundary": "block.top", "displacement": {"x": 0.06, "y": "0.1*(x - 1)"}}}  # pressed, and pulled off
COULOMB = {"law": "coulomb", "mu": 0.4}
ENOUGH = 400  # kinks: more than any of these paths has


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
    "bilateral, pulled": lambda: block({"law": "bilateral"}, COULOMB, supports=TILTED),
    "floating": floating,
}
HELD = [name for name in SCENES if name not in ("bilateral", "bilateral, pulled", "floating")]
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
    check(name, list(path.path_from(problem, p, u_c, ENOUGH)))


@pytest.mark.parametrize("name", SCENES)
def test_it_arrives_from_all_closed(name: str) -> None:
    problem = problem_of(name)
    check(name, list(path.path_from(problem, closed(problem), np.zeros(problem.surface.size), ENOUGH)))


@pytest.mark.parametrize("name", HELD)
def test_it_arrives_from_all_open(name: str) -> None:
    check(name, list(path.path_from_open(problem_of(name), ENOUGH)))


def test_no_path_begins_open_where_contact_cannot_open() -> None:
    assert not list(path.path_from_open(problem_of("bilateral"), ENOUGH))


@pytest.mark.parametrize("refresh", [1, 10**6])
def test_rounding_does_not_lead_it_away(refresh: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(path, "REFRESH", refresh)
    for name in ("coulomb", "floating"):
        problem = problem_of(name)
        check(name, list(path.path_from(problem, closed(problem), np.zeros(problem.surface.size), ENOUGH)))
    check("coulomb", list(path.path_from_open(problem_of("coulomb"), ENOUGH)))


def test_it_gives_up_when_its_kinks_are_used_up(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = problem_of("coulomb")
    passed, change = [], path._Path._change
    monkeypatch.setattr(path._Path, "_change", lambda self, row, to: passed.append(row) or change(self, row, to))
    check("coulomb", list(path.path_from_open(problem, ENOUGH)))
    needed = len(passed) + 1  # the last piece has no kink at its end
    assert needed > problem.surface.normal_rows / 2  # each row that closes in the end is a kink
    assert not list(path.path_from_open(problem, needed - 1))
    check("coulomb", list(path.path_from_open(problem, needed)))


def test_a_start_that_holds_no_body_is_skipped() -> None:
    problem = problem_of("floating")
    off = np.zeros(len(problem.gap))
    far_above = problem.surface.R @ (problem.surface.R.T @ np.tile([0.0, 5.0], problem.surface.size // 2))
    assert not list(path.path_from(problem, off, far_above, ENOUGH))


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
        for end in path.path_from(problem, p, np.zeros(problem.surface.size), ENOUGH):
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
    assert not list(path.path_from_open(problem, ENOUGH))


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
    (end,) = path.path_from(problem, closed(problem) + problem.p_ref / 10, np.zeros(problem.surface.size), ENOUGH)
    assert end.p[left_out] == 0.0
    assert problem.natural_residual(end.p, problem.relative_displacement(end.u_c)) < 1e-11


def test_the_same_path_is_followed_again() -> None:
    problem = problem_of("gaps")
    for paths in (
        lambda: path.path_from(problem, closed(problem), np.zeros(problem.surface.size), ENOUGH),
        lambda: path.path_from_open(problem, ENOUGH),
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
    problem = stepper.posed(stepper.start(), 1.0)[0]
    assert path.applies(problem) is expected
    best = CondensedNewton(rtol=1e-12)(problem, np.zeros(len(problem.gap)))
    assert bool(list(path.ends(problem, best.p, best))) is expected


def test_the_bodies_have_to_be_condensed() -> None:
    stepper = prepare(block(friction=COULOMB, solver={"surface": "matrix-free", "method": "surface-uzawa"})).stepper
    assert not path.applies(stepper.posed(stepper.start(), 1.0)[0])


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
        (end,) = path.path_from_open(problem, ENOUGH, soft)
        far.append(np.abs(end.p - exact).max() / np.abs(exact).max())
    assert far[0] > 10 * far[1] > 10 * far[2]
    assert far[2] < 1e-5  # the gaps are perturbed by some of that


CAPPED = {"law": "capped_coulomb", "mu": 0.4, "s_max": 0.06}


@pytest.fixture
def problem_of_block(scene_of: SceneOf, simulation_of: SimulationOf) -> Callable[..., SurfaceProblem]:
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
        return stepper.posed(stepper.start(), 1.0)[0]

    return make


def newton(problem: SurfaceProblem, p: Array) -> Solution:
    return SemismoothNewton(rtol=1e-12, max_it=200, linear=condensed_system.solve)(problem, p)


@pytest.mark.parametrize("name", ["coulomb", "gaps"])
def test_branches_from_a_state_from_all_open_and_from_all_closed_end_at_the_solution(name: str) -> None:
    """A state without tractions fulfils all laws, but balances nothing; from the solution itself it is near."""
    problem, expected = problem_of(name), solved(name)
    for found in semismooth.branches(problem, 0 * expected.p, 0 * expected.w, 1e-10, 50):
        assert_allclose(found.p, expected.p, atol=1e-9 * np.abs(expected.p).max())
    near, opened, _ = semismooth.branches(problem, expected.p, expected.w, 1e-10, 50)
    assert len(near.history) == 2 < len(opened.history)


def test_newton_tells_each_step_and_asks_where_points_touch() -> None:
    problem, steps, asked = problem_of("coulomb"), list[Any](), list[Any]()
    touch = lambda p, w, gap: asked.append(p) or gap  # noqa: E731
    found = METHOD(replace(problem, touch=touch), np.zeros(len(problem.gap)), steps.append)
    assert tuple(steps) == found.history
    assert asked


@pytest.mark.parametrize("name", ["coulomb", "compliance", "bound by penetration"])
def test_starts_follow_each_other_where_attempts_are_short(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stickslip.solvers.newton.attempts.ATTEMPT", 1)
    problem, expected = problem_of(name), solved(name)
    method = SemismoothNewton(rtol=1e-10, max_it=1000, linear=condensed_system.solve)
    found = method(problem, np.zeros(len(problem.gap)))
    assert found.status is Status.CONVERGED
    assert_allclose(found.p, expected.p, atol=1e-8 * np.abs(expected.p).max())


@pytest.fixture
def order(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[Any]]:
    """Starts of a chain whose attempts have failed; each start is the name and the arguments of what found it."""
    names = "resting_start first_starts way soft_starts on_softer_springs other_starts"
    for name in names.split():
        monkeypatch.setattr(semismooth, name, lambda *given, name=name: iter([(name, *given)]))
    monkeypatch.setattr(path, "ends", lambda *given: iter([("ends", *given)]))
    monkeypatch.setattr(semismooth, "at_rest", lambda tried: tried.rest)
    monkeypatch.setattr(semismooth, "settled", lambda tried, start: iter([("settled", tried, start)]))
    monkeypatch.setattr(semismooth, "again", lambda *given: ("again", *given))

    def make(p: Array, **state: Any) -> list[Any]:
        made = dict.fromkeys(("collapse", "problem", "rest")) | {"stalled": False, "over": False, "follows": True}
        tried: Any = SimpleNamespace(**made | {"best": SimpleNamespace(p=2 * p, residual=1.0)} | state)
        return [tried, *METHOD._chain(cast("Any", PROBLEM), p, tried)]

    return make


def into_contact(tried: Any) -> list[Any]:
    """An interior point from where rigid bodies would rest, where bodies settle from there, and a damped attempt."""
    start = tried.rest or ("soft_starts", tried)
    inner: list[Any] = [(("way", tried, tried.rest), None)] if tried.rest else []
    return [*inner, (("settled", tried, start), None), (start, FIRM[0])]


METHOD, PROBLEM = SemismoothNewton(rtol=1e-10, max_it=100, linear=condensed_system.solve), object()


@pytest.mark.parametrize("rest", [None, ("rest",)])
def test_starts_come_in_their_order(rest: Any, order: Callable[..., list[Any]]) -> None:
    p = np.ones(1)
    tried, *found = order(p, rest=rest)
    first: list[Any] = [(("resting_start", PROBLEM, p, METHOD), None), (("first_starts", PROBLEM, p), None)]
    others: list[Any] = [
        (("on_softer_springs", PROBLEM, p, METHOD._on_springs), None),
        (("other_starts", PROBLEM, p), None),
        (("ends", PROBLEM, p, tried.best), None),
    ]
    assert found == [*first, *into_contact(tried), *others]
    assert (tried.problem, tried.follows) == (PROBLEM, False)
    tried, *found = order(p, over=True, rest=rest)
    assert found == [*first, *into_contact(tried)[:-2]]
    tried, *found = order(p, stalled=True, rest=rest)
    damped = (("again", PROBLEM, tried.best), FIRM[0])
    assert found[:4] == [first[0], damped, first[1], damped]
    assert len(order(p, stalled=True, best=None, over=True)) == 3


def test_where_the_way_is_long_a_damped_attempt_comes_first(
    order: Callable[..., list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    zero, tries = np.zeros(1), list[Any]()
    rest = Start(p=zero, u_c=zero, p_hat=zero)

    def way(tried: Any, rest: Start) -> Iterator[Any]:
        tried.problem = "way"
        yield None
        tries.append(tried.problem)
        yield "start"

    monkeypatch.setattr(semismooth, "way", way)
    found = order(np.ones(1), rest=rest)[1:]
    assert found[2:4] == [(replace(rest, brief=True), FIRM[0]), ("start", None)]
    assert tries == [None]  # the attempt does not know where points touched on the way
    monkeypatch.setattr(semismooth, "again", lambda *given: replace(rest, factor=2.0))
    best = SimpleNamespace(p=zero, residual=1e-4)
    again = order(np.ones(1), rest=rest, best=best)[5]
    assert again == (replace(rest, factor=2.0, near=True, brief=True), FIRM[0])  # the way led nearly there
    assert len(found) == len(order(np.ones(1), rest=None)[1:]) + 2


@pytest.mark.parametrize("pressed", [0.0, 1.0])
def test_a_mechanism_ends_the_chain_of_what_has_tractions(
    pressed: float, order: Callable[..., list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    gives_way = Mechanism(np.ones(1), 1.0)
    monkeypatch.setattr(semismooth, "on_softer_springs", lambda *given: iter(["begin", gives_way, "start"]))
    tried, *found = order(np.full(1, pressed))
    assert tried.collapse is gives_way
    assert found[4] == ("begin", None)
    assert found[5:6] == [("start", None)] if not pressed else len(found) == 5


def test_linear_laws_stand_in_where_a_law_is_a_power(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, expected, posed = problem_of("gaps"), solved("gaps"), list[SurfaceProblem]()
    monkeypatch.setattr(SurfaceProblem, "idle", True)
    low, right = problem.cone.contacts
    low = replace(low, normal=Compliance(c_n=1.0, m_n=2.0))
    problem = replace(problem, cone=replace(problem.cone, contacts=(low, right)))
    (start,) = semismooth.resting_start(problem, expected.p, lambda other, p: posed.append(other) or expected)
    assert start.p is expected.p
    spring, rigid = (rows.normal for rows in posed[0].cone.contacts)
    assert_array_equal(spring.stiffness(np.ones(1), np.ones(1)), problem.gamma[problem.cone.places[0].normal])
    assert rigid is right.normal
    assert (posed[0].cone.time, posed[0].cone.end) == (problem.cone.time, problem.cone.end)


def test_what_is_on_springs_is_solved_from_its_start_and_then_from_others(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, expected, seen = problem_of("coulomb"), solved("coulomb"), list[Any]()
    near, far = Start.at(problem, expected.p, expected.u_c), Start.as_if(problem, 0 * expected.p, closed(problem))
    for most, others, start, arrives in (
        (60, [], far, True), (1, [], near, True), (1, [], far, False), (1, [(near, None)], far, True),
    ):  # fmt: skip
        monkeypatch.setattr("stickslip.solvers.newton.attempts.ATTEMPT", most)
        monkeypatch.setattr(SemismoothNewton, "_chain", lambda *given, to=others: seen.append(given[1:]) or iter(to))
        assert (METHOD._on_springs(problem, start).status is Status.CONVERGED) == arrives
        assert seen[-1][0] is problem
        assert seen[-1][1] is start.p
        assert seen[-1][2].problem is problem


def test_a_tangent_is_a_spring_that_only_presses() -> None:
    """Its resolvent solves p + gamma p / k = p_hat where that is positive."""
    k, gamma, p_hat = np.array([2.0, 3.0, 4.0]), np.array([1.0, 5.0, 0.5]), np.array([-1.0, 0.3, 2.0])
    law = semismooth.Tangent(k=k)
    p = law.resolvent(p_hat, gamma)
    assert_allclose(p + gamma * law.penetration(p), [0.0, 0.3, 2.0])
    assert_allclose(law.penetration(p), p / k)
    assert_allclose(law.stiffness(p, p_hat), [0.0, 3.0, 4.0])


MUCH = {"law": "coulomb", "mu": 2.0}
DRAWN = {"supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.06, "y": -0.1}}}}
PULLED = {"loads": {"pull": {"boundary": "block.top", "traction": [0.02, -0.1]}}}
SOFT = {"normal": {"law": "compliance", "c_n": 20.0}}


WEDGED = {"x": [[1.0, 0.05], [2.0, 0.12]], "y": [[1.0, -0.036], [2.0, 0.0013]]}  # and lifted off, but for friction
LIFTED = {"x": 0.1, "y": 0.02}


@pytest.fixture
def reached(scene_of: SceneOf, simulation_of: SimulationOf) -> Callable[..., Accepted]:
    """The last step of a block with friction that weakens from mu_s."""

    def make(mu_s: float, mu_k: float, slip_length: float, top: dict[str, Any], count: int) -> Accepted:
        law = {"law": "static_kinetic", "mu_s": mu_s, "mu_k": mu_k, "slip_length": slip_length}
        stepper = simulation_of(
            scene_of(
                contacts={"base": {"surface": "block.bottom", "against": "foundation", "friction": law}},
                supports={"top": {"boundary": "block.top", "displacement": top}},
                steps={"end": float(count), "count": count},
            )
        ).stepper
        state = stepper.start()
        for time in range(1, count + 1):
            accepted = stepper.reach(state, float(time), lambda row: None)
            state = accepted.state
        return accepted

    return make


@pytest.fixture
def problem_of_several(scene_of: SceneOf, simulation_of: SimulationOf) -> Callable[..., SurfaceProblem]:
    """A block pressed and dragged in one step."""

    def make(
        friction: dict[str, Any] | None, normal: dict[str, Any] | None = None, tables: dict[str, Any] = DRAWN
    ) -> SurfaceProblem:
        base = {"surface": "block.bottom", "against": "foundation"} | (normal or {})
        base |= {"friction": friction} if friction else {}
        stepper = simulation_of(scene_of(contacts={"base": base}, **tables)).stepper
        return stepper.posed(stepper.start(), 1.0)[0]

    return make


def test_a_state_stands_where_its_points_have_come_to() -> None:
    """w - gap: springs stay as they are, open points lie apart, what has no friction slips from where it counted."""
    problem = problem_of("compliance")
    random, n = np.random.default_rng(3), problem.surface.normal_rows
    p, w = random.uniform(0.1, 1.0, len(problem.gap)), random.normal(size=len(problem.gap))
    p[: n // 2] = 0.0
    problem = replace(problem, gap=random.normal(size=len(p)))
    away, (place,) = w - problem.gap, problem.cone.places
    assert {*np.sign(away[: n // 2])} == {-1.0, 1.0}
    expected = [min(x, 0.0) if k < n // 2 else p[k] / 5.0 for k, x in enumerate(away[:n])]
    pressed = place.rows.average @ p[:n] > 0
    expected += np.where(pressed, p[n:] / 4.0, away[n:]).tolist()
    assert 0 < np.count_nonzero(pressed) < len(pressed)
    assert_allclose(path.standing(problem, p, w), expected)


@pytest.mark.parametrize("size", [1.0, 1e-9])
def test_a_body_falls_that_what_has_tractions_cannot_hold(size: float) -> None:
    problem = problem_of("floating")
    problem = replace(problem, load=replace(problem.load, resultant=size * problem.load.resultant))
    pressed = np.ones(len(problem.gap))
    one = np.where(np.arange(len(pressed)) == 0, 1.0, 0.0)
    assert [path._falls(problem, p) for p in (pressed, 0 * pressed, one)] == [False, True, True]
    assert path._falls(problem_of("coulomb"), np.zeros(len(problem_of("coulomb").gap))) is False


@pytest.mark.parametrize("name", ["coulomb", "compliance"])
def test_a_path_from_a_state_begins_where_it_stands(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Gaps are as much wider there as leaves the w - gap of the state under its tractions, however they are now."""
    whole, random, begun = problem_of(name), np.random.default_rng(3), list[Any]()
    (rows,), n, count = whole.cone.contacts, whole.surface.normal_rows, len(whole.gap)
    free = np.arange(rows.free.size).reshape(rows.free.shape) != 3
    cone = AdmissibleSet((replace(rows, free=free),), whole.cone.time, whole.cone.end)
    problem = replace(whole, cone=cone, gap=random.normal(size=count))
    p, w = random.uniform(0.1, 1.0, count), random.normal(size=count)
    same, other = (SimpleNamespace(p=sign * solved(name).p) for sign in (1, -1))
    monkeypatch.setattr(path, "proved", lambda problem: False)
    for ends, led_to in (([], None), ([same], None), ([other], other)):
        followed = SimpleNamespace(turned=True, solutions=lambda kinks, ends=ends: iter(ends))
        monkeypatch.setattr(path, "_Path", lambda *given, it=followed: begun.append(given) or it)
        assert path.continued(problem, p, w, solved(name)) == (led_to, True)
    maps, at, b, wider = begun[0]
    assert_allclose(at, np.where(np.arange(count) == n + 3, 0.0, p), atol=10 * CLOSE)
    assert not b.any()
    r = maps.w_0 - maps.G @ at - problem.gap - wider
    assert_allclose(r, path.standing(problem, p, w), atol=1e-12)
    monkeypatch.setattr(path, "_Path", lambda *given: np.linalg.inv(np.zeros((1, 1))))
    assert path.continued(problem, p, w, solved(name)) == (None, False)


MU, LITTLE = 0.4, 1e-3
PIECES = [  # trial tractions of one row before and after, in Pa, and whether the map is linear between; others stay
    ("normal", -1.0, 1.0, False), ("normal", -1.0, 0.5, False), ("normal", 1.0, -1.0, False),
    ("normal", -1.0, -1.0, True),
    ("normal", -LITTLE / 2, 1.0, True), ("normal", -2 * LITTLE, 1.0, False), ("normal", LITTLE / 2, -1.0, True),
    ("normal", 2 * LITTLE, -1.0, False), ("normal", -1.0, 0.0, True),
    ("tangential", 0.5, 0.6, True), ("tangential", -0.5, -0.6, True), ("tangential", -0.5, 0.6, False),
    ("tangential", 0.5, -0.6, False), ("tangential", 0.0, 0.5, False), ("tangential", 0.5, 0.0, False),
    ("tangential", -0.5, 0.0, False), ("tangential", MU / 2 - LITTLE / 2, 0.5, True),
    ("tangential", MU / 2 - 2 * LITTLE, 0.5, False), ("tangential", MU / 2 + LITTLE / 2, 0.0, True),
    ("tangential", MU / 2 - LITTLE / 2, 0.0, True), ("tangential", MU / 2 + 2 * LITTLE, 0.0, False),
    ("tangential", 0.0, MU / 2, True),
]  # fmt: skip


@pytest.mark.parametrize("name", ["coulomb", "bilateral", "frictionless and coulomb"])
def test_the_map_is_linear_between_states_of_the_same_pieces(name: str) -> None:
    """Pressures are 0.5 Pa at all points, before and after."""
    if name in SCENES:
        problem = problem_of(name)
    else:
        scene = gaps()
        low = replace(scene.contacts["low"], friction=None)
        stepper = prepare(replace(scene, contacts={"low": low, "right": scene.contacts["right"]})).stepper
        problem = stepper.posed(stepper.start(), 1.0)[0]
    problem = replace(problem, gamma=np.ones(len(problem.gap)))
    first, last = problem.cone.places[0], problem.cone.places[-1]
    pressures = np.where(np.arange(len(problem.gap)) < problem.surface.normal_rows, 0.5, 0.0)
    rest = 2 * pressures  # closed and sticking
    for kind, start, end, linear in PIECES:
        row = first.normal.start if kind == "normal" else last.tangential.start + 2
        trials = [rest.copy(), rest.copy()]
        trials[0][row], trials[1][row] = start, end
        before, after = ((pressures, trial - pressures) for trial in trials)
        expected = linear or (kind == "normal" and name == "bilateral")
        assert path._in_one_piece(problem, before, after, LITTLE) is expected, (kind, start, end)


@pytest.mark.parametrize(
    ("friction", "normal", "most", "sure"),
    [
        (None, None, 0.0, True),
        ({"law": "coulomb", "mu": 0.4}, None, 0.4, True),
        ({"law": "coulomb", "mu": 3.0}, None, 3.0, True),
        ({"law": "compliance", "c_T": 50.0}, SOFT, 2.5, False),  # c_T d under p = c_n d
        ({"law": "tresca", "bound": 0.1}, None, 0.0, False),  # its bound jumps where surfaces part
    ],
)
def test_the_most_friction_is_that_of_the_laws(
    friction: dict[str, Any] | None,
    normal: Any,
    most: float,
    sure: bool,
    problem_of_several: Callable[..., SurfaceProblem],
) -> None:
    slopes, known = uniqueness._slopes(problem_of_several(friction, normal))
    assert slopes.max() == pytest.approx(most)
    assert known is sure


def sizes_of_difference(problem: SurfaceProblem, dp: Array) -> tuple[float, float]:
    """Energy dp^T W G dp, and sum W |dp_n| |dv| of a difference of two solutions."""
    surface, n = condensed(problem.surface), problem.surface.normal_rows
    dw = surface.N @ (surface.flexibility @ surface.forces(dp))
    return float(surface.W @ (dp * dw)), float(surface.W[:n] @ np.abs(dp[:n] * dw[n:]))


def test_no_difference_of_solutions_breaks_a_proof(problem_of_several: Callable[..., SurfaceProblem]) -> None:
    """The bound is one of all differences: none met has more friction work than energy below it, by friction alone."""
    problem, random = problem_of_several({"law": "coulomb", "mu": 1e-3}), np.random.default_rng(5)
    assert uniqueness.proved(problem)
    low, high = 1e-3, 3.0
    for _ in range(12):
        middle = (low * high) ** 0.5
        low, high = (
            (middle, high) if uniqueness.proved(problem_of_several({"law": "coulomb", "mu": middle})) else (low, middle)
        )
    ratios = [np.divide(*sizes_of_difference(problem, random.standard_normal(len(problem.gap)))) for _ in range(50)]
    assert low * 0.99 < high < min(ratios)


def test_a_set_that_slips_one_way_is_singular_at_the_critical_friction(
    problem_of_several: Callable[..., SurfaceProblem],
) -> None:
    problem = problem_of_several({"law": "coulomb", "mu": 1.0})
    surface, n, least = condensed(problem.surface), problem.surface.normal_rows, uniqueness.critical(problem)
    G = surface.flexibility.between(surface.N, (surface.N.T.multiply(surface.W)).tocsr())
    sets = [some for some in uniqueness._runs(n)]
    smallest = [
        np.linalg.svd(G[np.ix_(some, some)] + sign * least * G[np.ix_(some, n + some)], compute_uv=False)[-1]
        for some in sets
        for sign in (1, -1)
    ]
    assert min(smallest) < 1e-10 * np.abs(G).max()


def test_points_that_have_slipped_hide_no_others(reached: Callable[..., Accepted]) -> None:
    """One end has mu = .9, the other points 2: it is wedged, and could as well be off the ground."""
    accepted = reached(2.0, 0.9, 1e-3, WEDGED, 2)
    (contact,) = accepted.problem.cone.contacts
    assert isinstance(contact.friction, CoulombByPoint)
    assert_allclose(np.unique(contact.friction.mu), [0.9, 2.0])
    assert uniqueness._slopes(accepted.problem)[0].max() == pytest.approx(2.0)
    assert not uniqueness.proved(accepted.problem)
    assert accepted.state.p.max() > 0.01
    assert_array_equal(accepted.others, [np.zeros_like(accepted.state.p)])


@pytest.mark.parametrize(
    ("friction", "tables", "looked_for"),
    [
        (MUCH, DRAWN, True),
        ({"law": "coulomb", "mu": 1.5}, DRAWN, False),  # 1.556 is critical
        (None, DRAWN, False),
        ({"law": "stick"}, DRAWN, False),
        ({"law": "tresca", "bound": 0.1}, DRAWN, False),
        (MUCH, PULLED, False),
        ({"law": "capped_coulomb", "mu": 2.0, "s_max": 0.1}, DRAWN, False),
        ({"law": "capped_coulomb", "mu": 2.0, "s_max": 0.1}, PULLED, False),
    ],
)
def test_others_are_looked_for_where_there_may_be_some(
    friction: dict[str, Any] | None, tables: dict[str, Any], looked_for: bool,
    problem_of_several: Callable[..., SurfaceProblem], monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    problem, asked = problem_of_several(friction, tables=tables), list[int]()
    monkeypatch.setattr(path, "path_from_open", lambda of, kinks: asked.append(kinks) or iter(()))
    assert not list(path.others(problem, np.zeros(len(problem.gap))))
    assert asked == ([path.FOLLOWED] if looked_for else [])


@pytest.mark.parametrize("size", [1e-6, 1.0])
def test_each_solution_is_said_once(
    size: float, problem_of_several: Callable[..., SurfaceProblem], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = problem_of_several(MUCH)
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


def test_solutions_are_apart_by_a_part_of_the_larger_one(
    problem_of_several: Callable[..., SurfaceProblem], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside a known state that is all but open: what differs from it by little is measured by what is met."""
    problem = problem_of_several(MUCH)
    zero = np.zeros(len(problem.gap))
    one = zero + 1.0
    end = Start(p=one, u_c=np.zeros(problem.surface.size), p_hat=one)
    monkeypatch.setattr(path, "path_from_open", lambda of, kinks: iter([end]))
    monkeypatch.setattr(SurfaceProblem, "natural_residual", lambda self, p, w: 0.0)
    assert len(list(path.others(problem, zero))) == 1
    assert not list(path.others(problem, one))


def test_tractions_that_are_rounding_are_no_other_solution(
    problem_of_several: Callable[..., SurfaceProblem], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = problem_of_several(MUCH)
    touching = np.full(len(problem.gap), 1e-16 * problem.p_ref)
    end = Start(p=0 * touching, u_c=np.zeros(problem.surface.size), p_hat=0 * touching)
    monkeypatch.setattr(path, "path_from_open", lambda of, kinks: iter([end]))
    monkeypatch.setattr(SurfaceProblem, "natural_residual", lambda self, p, w: 0.0)
    assert not list(path.others(problem, touching))


def test_others_have_the_friction_of_their_own_slip(reached: Callable[..., Accepted]) -> None:
    """Three answers with mu = 3 everywhere: open, stick, and one that slips, which has not 3 then."""
    accepted = reached(3.0, 0.1, 0.01, LIFTED, 1)
    assert not accepted.state.p.any()
    frozen = list(path.others(accepted.problem, accepted.state.p))
    assert len(frozen) == 2
    assert_array_equal(accepted.others, frozen[1:])
