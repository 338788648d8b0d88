"""What laws remember of a substep, and the turns in which it is solved with the mu of its own slip."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any, cast

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from shared.problems import plane, scene_of, surface_problem
from stickslip.geometry.arrays import Array
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import QUICK, Solution, Status
from stickslip.solvers.laws.friction import CoulombByPoint
from stickslip.solvers.laws.rate_dependent import RateDependent
from stickslip.solvers.laws.wear import PRESSED, REPEAT, SLID, WORN
from stickslip.solvers.newton import path
from stickslip.solvers.stepping.law_memory import LawMemory, Memory, no_memory, repeats, with_memory, worn_depth
from stickslip.workflows.lab.verification.prepared import prepare

MU_S, MU_K, LENGTH = 0.4, 0.2, 0.5
FALL = (MU_S - MU_K) / LENGTH  # of mu by slip [1/m]
WEAKENS = {"law": "static_kinetic", "mu_s": MU_S, "mu_k": MU_K, "slip_length": LENGTH}
K, GROWTH, SPEED = 0.1, 0.05, 2.5  # k = K + GROWTH by slip [m] or pressure [Pa]; speed out of the plane [m/s]
BY = {"k": [[0.0, K], [40.0, K + 40.0 * GROWTH]]}


def rate(name: str, slid: Array, p_n: Array) -> Array:
    """k at t = 1."""
    return K + GROWTH * {"slip": slid, "pressure": p_n, "time": 0 * slid}[name]


@cache
def posed(name: str) -> tuple[AdmissibleSet, SurfaceProblem]:
    """Laws that remember, at t = 1, and the problem of a step from 0.

    A block in 3D on a floor where friction weakens and wears, k by slip, pressure or time, under a soft lid with
    friction that weakens; or one in the plane, which slides out of it, k a number or by slip, without friction or with
    friction that turns; or one whose friction remembers nothing, on a floor that wears.
    """
    if name in ("slip", "pressure", "time"):
        wear = {"k": f"{K / 2}*(1 + t)"} if name == "time" else BY | {"by": name}
        lid = {"shape": "plane", "point": [0.0, 0.0, 1.0], "normal": [0.0, 0.0, -1.0]}
        soft = {"normal": {"law": "compliance", "c_n": 20.0}, "friction": WEAKENS | {"k_T": 3.0}}
        contacts = {
            "base": {"surface": "block.bottom", "against": "floor", "friction": WEAKENS, "wear": wear},
            "lid": {"surface": "block.top", "against": "lid"} | soft,
        }
        held = {
            "left": {"boundary": "block.left", "displacement": {"x": 0.06, "y": 0.02, "z": 0.01}},
            "front": {"boundary": "block.front", "displacement": {"y": 0.02}},
        }
        tables, dim = {"obstacles": {"floor": plane(3), "lid": lid}, "contacts": contacts, "supports": held}, 3
    else:
        wear = BY | {"by": "slip"} if name == "aside by slip" else {"k": K}
        base = {"surface": "block.bottom", "against": "foundation", "wear": wear}
        base |= {} if name == "plain" else {"slide": [[0.0, 0.0], [2.0, 5.0]]}
        base |= {"friction": {"law": "coulomb", "mu": 0.3}} if name in ("turned", "plain") else {}
        top, dim = {"boundary": "block.left", "displacement": {"x": 0.0, "y": -0.1}}, 2
        tables = {"contacts": {"base": base}, "supports": {"left": top}}
    steps = {"end": 2.0, "count": 2, "seconds": True}
    simulation = prepare(scene_of(dim, {"mesh_size": 1.0}, steps=steps, **tables))
    return simulation.stepper.cone.at(1.0), surface_problem(simulation)


def some(cone: AdmissibleSet, seed: int, *others: str) -> dict[str, Array]:
    """What points may remember, by lot, and other keys."""
    random = np.random.default_rng(seed)
    return {key: random.uniform(0.1, 0.4, len(value)) for key, value in no_memory(cone).items()} | {
        key: np.array(3.0) for key in others
    }


def drawn(problem: SurfaceProblem, seed: int) -> tuple[Array, Array]:
    """Tractions of which the first normal one is none, and relative displacements."""
    p, w = np.random.default_rng(seed).uniform(0.1, 0.9, (2, len(problem.gap)))
    p[0] = 0.0
    return p, w


KEYS = {
    "slip": {"base": 4, "lid": 4, f"base{WORN}": 4, f"base{SLID}": 4},
    "pressure": {"base": 4, "lid": 4, f"base{WORN}": 4, f"base{SLID}": 4, f"base{PRESSED}": 4},
    "time": {"base": 4, "lid": 4, f"base{WORN}": 4, f"base{SLID}": 4},
    "aside": {f"base{WORN}": 2},
    "aside by slip": {f"base{WORN}": 2, f"base{SLID}": 2},
    "turned": {"base": 2, f"base{WORN}": 2, f"base{SLID}": 2},
    "plain": {f"base{WORN}": 2, f"base{SLID}": 2},
}


@pytest.mark.parametrize("name", KEYS)
def test_at_first_points_have_not_slipped_and_remember_what_their_laws_ask_for(name: str) -> None:
    cone = posed(name)[0]
    found = no_memory(cone)
    assert no_memory(replace(cone, contacts=cone.contacts[::-1])).keys() == found.keys()
    assert {key: len(value) for key, value in found.items()} == KEYS[name]
    assert not any(value.any() for value in found.values())


def test_a_step_stands_for_one_cycle_or_those_that_are_remembered() -> None:
    assert (repeats({}), repeats({REPEAT: np.array(3.0)})) == (1.0, 3.0)


@pytest.mark.parametrize("name", ["slip", "pressure", "time"])
@pytest.mark.parametrize("others", [(), (REPEAT,)])
def test_points_remember_the_length_of_their_slip_and_what_it_wears(name: str, others: tuple[str, ...]) -> None:
    """Points that do not touch do not slip, but what wears slides on; redundant directions do not count."""
    cone, problem = posed(name)
    problem = replace(problem, gap=np.random.default_rng(3).normal(size=len(problem.gap)))
    start, (p, w), (base, lid) = some(cone, 1, *others), drawn(problem, 2), problem.cone.places
    found = LawMemory(cone, start, 1.0).after(problem, p, w)
    ways = []
    for place, springs in ((base, 0.0), (lid, 1 / 3.0)):
        t = place.tangential
        slips = (w - problem.gap - springs * p)[t].reshape(-1, 2) * place.rows.free
        ways.append(np.hypot(*slips.T))
    assert not base.rows.free.all()
    average, p_n = base.average.toarray(), p[base.normal]
    assert_allclose(found["base"], start["base"] + np.where(average @ p_n > 0, ways[0], 0.0))
    assert_allclose(found["lid"], start["lid"] + ways[1])
    way = (3.0 if others else 1.0) * (average.T @ (base.rows.W_t * ways[0])) / (average.T @ base.rows.W_t)
    assert_allclose(found[f"base{SLID}"], start[f"base{SLID}"] + way)
    k = rate(name, start[f"base{SLID}"] + way, p_n)
    assert_allclose(found[f"base{WORN}"], start[f"base{WORN}"] + k * way * p_n)
    assert set(found) == set(start)
    if name == "pressure":
        assert_array_equal(found[f"base{PRESSED}"], p_n)
    assert all(found[key] is start[key] for key in others)
    assert LawMemory(cone, {}, 1.0).after(problem, p, w) == {}


@pytest.mark.parametrize("name", ["aside", "aside by slip"])
@pytest.mark.parametrize("others", [(), (REPEAT,)])
def test_what_slides_out_of_the_plane_wears_by_that_way(name: str, others: tuple[str, ...]) -> None:
    cone, problem = posed(name)
    start, (p, w) = some(cone, 1, *others), drawn(problem, 2)
    found = LawMemory(cone, start, 0.5).after(problem, p, w)
    far = 0.5 * SPEED * (3.0 if others else 1.0)
    slid = start.get(f"base{SLID}", 0.0) + far
    k = K if name == "aside" else K + GROWTH * slid
    assert_allclose(found[f"base{WORN}"], start[f"base{WORN}"] + k * far * p[:2])
    if name != "aside":
        assert_allclose(found[f"base{SLID}"], slid)
    within = with_memory(cone, start | ({} if name == "aside" else {f"base{SLID}": slid + 1.0}), 0.5, start)
    (rows,), (own,) = within.contacts, cone.contacts
    assert_allclose(rows.gap, own.gap + start[f"base{WORN}"])
    far, k = (far, K) if name == "aside" else (far + 1.0, K + GROWTH * (slid + 1.0))
    assert_allclose(rows.normal.softness, k * far)


def test_friction_that_turns_is_of_the_way_in_the_step_and_remembers_its_share() -> None:
    cone, problem = posed("turned")
    start, (p, w) = some(cone, 1), drawn(problem, 2)
    ended, within = with_memory(cone, start).contacts[0].friction, with_memory(cone, start, 0.5).contacts[0].friction
    assert_array_equal(cast("Any", ended).share, start["base"])
    assert_allclose(cast("Any", within).aside, 0.5 * SPEED)
    slips, touches = np.abs(w - problem.gap)[2:], problem.cone.places[0].average @ p[:2] > 0
    found = LawMemory(cone, start, 0.5).after(problem, p, w)["base"]
    assert_allclose(found, touches * slips / np.hypot(slips, 0.5 * SPEED))


def test_friction_that_remembers_nothing_wears() -> None:
    cone, problem = posed("plain")
    start, (p, w) = some(cone, 1), drawn(problem, 2)
    found = LawMemory(cone, start, 0.5).after(problem, p, w)
    assert set(found) == set(start)
    (place,) = problem.cone.places
    average, slips = place.average.toarray(), np.abs(w - problem.gap)[2:]
    way = (average.T @ (place.rows.W_t * slips)) / (average.T @ place.rows.W_t)
    assert_allclose(found[f"base{WORN}"], start[f"base{WORN}"] + K * way * p[:2])
    assert with_memory(cone, start, 0.5).contacts[0].friction is cone.contacts[0].friction


@pytest.mark.parametrize("name", ["slip", "pressure", "time"])
def test_laws_with_a_memory_are_coulombs_with_its_mu_and_gaps_wider_by_the_depth(name: str) -> None:
    """In a step what wears off in it is a softness: k times the way, by the slip or the pressure of the turn."""
    cone, _ = posed(name)
    start, memory = some(cone, 1), some(cone, 2)
    memory[f"base{SLID}"] = start[f"base{SLID}"] + [0.1, 0.2, 0.3, -0.1]
    assert with_memory(cone, {}) is cone
    ended, first, turned = (
        with_memory(cone, memory), with_memory(cone, start, 1.0), with_memory(cone, memory, 1.0, start)
    )  # fmt: skip
    for found, slips, worn in ((ended, memory, memory), (first, start, start), (turned, memory, start)):
        assert (found.time, found.end) == (cone.time, cone.end)
        for rows, own in zip(found.contacts, cone.contacts, strict=True):
            assert isinstance(rows.friction, CoulombByPoint)
            assert_allclose(rows.friction.mu, MU_S - FALL * slips[rows.name])
            assert rows.friction.k_T == (3.0 if rows.name == "lid" else None)
            assert_allclose(rows.gap, own.gap + (worn[f"base{WORN}"] if rows.name == "base" else 0.0))
    assert ended.contacts[0].normal is cone.contacts[0].normal
    assert not first.contacts[0].normal.softness.any()
    k = rate(name, memory[f"base{SLID}"], memory.get(f"base{PRESSED}", np.zeros(4)))
    assert_allclose(turned.contacts[0].normal.softness, k * [0.1, 0.2, 0.3, 0.0])
    assert all(found.contacts[1].normal is cone.contacts[1].normal for found in (first, turned))
    without = with_memory(cone, {"lid": memory["lid"]})
    assert without.contacts[0] is cone.contacts[0]
    depth = worn_depth(cone, memory)
    assert_array_equal(depth[:4], memory[f"base{WORN}"])
    assert not depth[4:].any()
    assert_array_equal(worn_depth(cone, {}), np.zeros(cone.size))


def test_two_memories_are_apart_by_their_bounds_and_worn_depths_beside_the_tractions() -> None:
    cone, problem = posed("slip")
    start, (p, _) = some(cone, 1), drawn(problem, 2)
    memory, (base, lid) = LawMemory(cone, start, 1.0), problem.cone.places

    def with_(own: Memory) -> SurfaceProblem:
        return replace(problem, cone=with_memory(cone, own, 1.0, start))

    for place in (base, lid):
        more = start | {place.rows.name: start[place.rows.name] + [0.003, -0.03, 0.006, 0.009]}
        off = np.abs(FALL * (more[place.rows.name] - start[place.rows.name]) * (place.average @ p[place.normal]))
        for one, other in ((start, more), (more, start)):
            assert memory._apart(with_(one), p, other) == pytest.approx(off.max() / p.max(), rel=1e-9)
    ways = np.array([[0.1, 0.2, 0.3, 0.1], [0.2, 0.1, 0.1, 0.2]])
    slid = start[f"base{SLID}"] + ways
    soft = (K + GROWTH * slid) * ways
    off = np.abs(problem.gamma[base.normal] * (soft[0] - soft[1]) * p[base.normal])
    one, other = (start | {f"base{SLID}": each} for each in slid)
    assert memory._apart(with_(one), p, other) == pytest.approx(off.max() / p.max(), rel=1e-9)
    assert memory._apart(with_(one), p, one) == memory._apart(with_(one), 0 * p, other) == 0.0
    smooth, problem = posed("aside")
    cycles = {REPEAT: np.array(3.0)}
    assert LawMemory(smooth, cycles, 1.0)._apart(replace(problem, cone=smooth), np.ones(2), cycles) == 0.0


def slipping(slip: Callable[[float], float], ends: Callable[[int], Status] = lambda turn: Status.CONVERGED) -> Any:
    """A method whose points slip by what a mu of the floor leaves them; the mu and pressures that it was asked."""
    asked, begun = list[float](), list[float]()

    def solve(problem: SurfaceProblem, p: Array) -> tuple[Solution, SurfaceProblem]:
        base = problem.cone.places[0]
        asked.append(float(base.rows.friction.mu[1]))  # type: ignore[union-attr]
        begun.append(float(p[0]))
        p = np.full(len(problem.gap), 0.5)
        w = problem.gap + problem.cone.give(p)
        w[base.tangential] += np.tile([slip(asked[-1]), 0.0], 4)
        found = Solution(p=p, w=w, u_c=np.zeros(0), status=ends(len(asked)), residual=0.0, history=())
        return found, problem

    return solve, asked, begun


def without_wear(tolerance: float = 1e-10) -> tuple[LawMemory, SurfaceProblem]:
    """Friction that weakens alone."""
    cone, problem = posed("slip")
    start = {key: value for key, value in no_memory(cone).items() if key in ("base", "lid")}
    return LawMemory(cone, start, 1.0, tolerance), replace(problem, cone=with_memory(cone, start, 1.0))


@pytest.mark.parametrize("unloads", [0.5, 2.0])
def test_turns_come_to_the_slip_of_its_own_mu(unloads: float) -> None:
    """s = b (c - mu(s)), mu(s) = mu_s - f s: linear, so that Aitken's step is right at once; b f is the weakening."""
    memory, problem = without_wear()
    ratio, c = unloads * FALL, MU_S + 0.05 / unloads
    slip = 0.05 / (1 - ratio)
    assert slip < LENGTH
    solve, asked, begun = slipping(lambda mu: unloads * (c - mu))
    found, turned = memory.around(solve)(problem, np.full(len(problem.gap), 0.3))
    assert begun == [0.3, 0.5, 0.5]  # each from the last one's
    assert found.status is Status.CONVERGED
    assert found.weakening == pytest.approx(ratio)
    assert_allclose(asked, [MU_S, MU_S - FALL * 0.05, MU_S - FALL * slip])
    assert_allclose(turned.cone.contacts[0].friction.mu[1], asked[-1])  # type: ignore[union-attr]
    assert turned.cone.contacts[1].friction.mu[1] == MU_S  # type: ignore[union-attr]


def test_weakening_is_that_of_whole_turns() -> None:
    """Not of Aitken's steps, which here lead where slip falls four times as fast."""
    memory, problem = without_wear()
    solve, asked, _ = slipping(lambda mu: 0.05 + 0.5 * (MU_S - mu) + 1.5 * max(MU_S - FALL * 0.05 - mu, 0.0))
    found, _ = memory.around(solve)(problem, np.zeros(len(problem.gap)))
    assert found.weakening == pytest.approx(0.5 * FALL)
    assert found.status is Status.CONVERGED
    assert len(asked) > 3


@pytest.mark.parametrize("name", ["slip", "pressure", "time"])
def test_what_wears_by_the_way_of_a_step_is_found_by_turns(name: str) -> None:
    """Slip is 0.05 whatever mu is; the softness is that of its way, and weakening what wear takes alone."""
    cone, problem = posed(name)
    start = some(cone, 1)
    memory, problem = LawMemory(cone, start, 1.0, 1e-12), replace(problem, cone=with_memory(cone, start, 1.0))
    solve, _, _ = slipping(lambda mu: 0.05 + 0.1 * (MU_S - mu))
    first, _ = solve(problem, np.zeros(len(problem.gap)))
    found, turned = memory.around(solve)(problem, np.zeros(len(problem.gap)))
    after = memory.after(turned, found.p, found.w)
    way = after[f"base{SLID}"] - start[f"base{SLID}"]
    assert way.min() > 0.05
    k = rate(name, after[f"base{SLID}"], found.p[:4])
    assert_allclose(turned.cone.contacts[0].normal.softness, k * way, rtol=1e-9)
    assert_allclose(turned.cone.contacts[0].friction.mu, MU_S - FALL * after["base"])  # type: ignore[union-attr]
    assert found.weakening == memory._worn_off(problem, first)


def test_where_friction_weakens_faster_slip_grows_up_to_the_first_solution() -> None:
    """Kinetic friction: the turns before grow by b f > 1 each."""
    memory, problem = without_wear()
    unloads, c = 4.0, MU_S + 0.02
    solve, asked, _ = slipping(lambda mu: unloads * (c - mu))
    found, _ = memory.around(solve)(problem, np.zeros(len(problem.gap)))
    assert found.status is Status.CONVERGED
    assert found.weakening == pytest.approx(unloads * FALL)
    assert_allclose(np.diff(asked)[:2], [-FALL * 0.08, -FALL * 0.08 * unloads * FALL])
    assert asked[-1] == MU_K


def test_turns_end_where_the_method_does_and_after_200() -> None:
    memory, problem = without_wear()
    solve, asked, _ = slipping(lambda mu: 2.0 * (MU_S + 0.02 - mu), lambda turn: Status.STALLED)
    found, same = memory.around(solve)(problem, np.zeros(len(problem.gap)))
    assert (found.status, len(asked), same) == (Status.STALLED, 1, problem)
    solve, asked, _ = slipping(lambda mu: 0.1 + 0.05 * (len(asked) % 2))  # goes on whatever mu is
    found, last = memory.around(solve)(problem, np.zeros(len(problem.gap)))
    assert (found.status, len(asked)) == (Status.UNSTEADY, 201)
    assert last.cone.contacts[0].friction.mu[1] == asked[-1]  # type: ignore[union-attr]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(LawMemory, "_apart", lambda *_: 1.0)
        found, _ = memory.around(slipping(lambda mu: MU_S + 0.05 - mu)[0])(problem, np.zeros(len(problem.gap)))
    assert found.status is Status.UNSTEADY
    assert found.weakening == pytest.approx(FALL)


def test_turns_about_a_steep_change_of_slip_come_to_it_in_shorter_steps() -> None:
    """Slip changes by 0.2 where mu does by 0.002: Aitken's steps alone go to and fro across it."""
    memory, problem = without_wear()
    solve, asked, _ = slipping(lambda mu: 0.15 + 0.1 * np.tanh((mu - 0.345) * 1e3))
    found, _ = memory.around(solve)(problem, np.zeros(len(problem.gap)))
    assert found.status is Status.CONVERGED
    assert QUICK < len(asked) < 2 * QUICK
    assert asked[-1] == pytest.approx(MU_S - FALL * (0.15 + 0.1 * np.tanh((asked[-1] - 0.345) * 1e3)), abs=1e-9)


def test_laws_that_need_no_turns_are_solved_once() -> None:
    """Those that remember no slip; depths alone; and other contacts' laws."""
    for name, start, turns in (
        ("aside", some(posed("aside")[0], 1), False),
        ("aside by slip", some(posed("aside by slip")[0], 1), True),
        ("slip", {REPEAT: np.array(2.0), f"base{WORN}": np.zeros(4)}, False),
        ("slip", {"base": np.zeros(4)}, True),
        ("pressure", {f"base{PRESSED}": np.zeros(4)}, True),
    ):
        cone, _ = posed(name)
        around: Any = LawMemory(cone, start, 1.0).around
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(LawMemory, "_by_turns", lambda self, problem, p, *how: (problem, p, "by turns"))
            assert around(lambda problem, p: (problem, p, "once"))(1, 2) == (1, 2, "by turns" if turns else "once")
        drags = replace(cone.contacts[0], friction=RateDependent(mu="0.3 + V"))
        dragged = LawMemory(replace(cone, contacts=(drags, *cone.contacts[1:])), {"base": np.zeros(4)}, 1.0)
        assert cast("Any", dragged.around(lambda problem, p: (problem, p)))(1, 2) == (1, 2)


@pytest.mark.parametrize("name", ["slip", "pressure", "time"])
def test_what_slip_wears_off_takes_friction_by_mu_k_p_and_the_flexibilities(name: str) -> None:
    cone, problem = posed(name)
    start, (p, w) = some(cone, 1), drawn(problem, 2)
    memory = LawMemory(cone, start, 1.0)
    problem = replace(problem, cone=with_memory(cone, start, 1.0))
    without = Solution(p=p, w=w, u_c=np.zeros(0), status=Status.CONVERGED, residual=0.0, history=())
    place, f = problem.cone.places[0], problem.give
    assert f is not None
    lost = rate(name, start[f"base{SLID}"], p[place.normal]) * p[place.normal] / f[place.normal]
    fall = place.rows.friction.mu * (place.average @ lost) * f[place.tangential][::2]  # type: ignore[union-attr]
    assert memory._worn_off(problem, without) == pytest.approx(fall.max())
    assert LawMemory(cone, {"base": start["base"]}, 1.0)._worn_off(problem, without) == 0.0


def test_the_exact_solution_has_the_mu_of_its_own_slip() -> None:
    """Sizes of all turns add up; where one is not found, it is not known."""
    memory, problem = without_wear(1.0)  # the method's turns end at once
    unloads, place = 2.0, problem.cone.places[0]
    solve = slipping(lambda mu: unloads * (MU_S + 0.025 - mu))[0]
    found, _ = solve(problem, np.zeros(len(problem.gap)))

    def by_turns(*sizes: float) -> tuple[Solution, float, dict[str, Array]]:
        turns = iter(sizes)
        return memory.exact(problem, found, lambda problem, near: (solve(problem, near.p)[0], next(turns)))

    at, size, after = by_turns(1.0, 0.25, 0.5, 1.0)
    slip = 0.05 / (1 - unloads * FALL)
    assert_allclose(after["base"], slip)
    assert_allclose((at.w - problem.gap)[place.tangential][::2], slip)
    assert size == 1.0 + 0.25 + 0.5
    for sizes in ([np.nan], [1.0, np.nan], [1.0, 1.0, np.nan]):
        assert np.isnan(by_turns(*sizes)[1])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(LawMemory, "_apart", lambda *_: 1.0)
        assert np.isnan(by_turns(*[1.0] * 300)[1])  # turns do not end
    nothing = LawMemory(memory.cone, {}, 1.0)
    assert nothing.exact(problem, found, lambda problem, near: (near, 2.0)) == (found, 2.0, {})


@pytest.mark.parametrize("start", [True, False])
def test_other_solutions_have_the_mu_of_their_own_slip(start: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    memory, problem = without_wear()
    memory = memory if start else LawMemory(memory.cone, {}, 1.0)
    p, met = np.full(len(problem.gap), 0.5), list[Any]()
    rest = problem.gap + problem.cone.give(p)
    slips = rest.copy()
    slips[problem.cone.places[0].tangential] += 0.1

    def others(of: SurfaceProblem, p: Array, keeps: Any = None) -> list[Array]:
        assert of is problem
        met.append((keeps(p, rest), keeps(p, slips)) if keeps else None)
        return [2 * p]

    monkeypatch.setattr(path, "others", others)
    (found,) = memory.others(problem, p)
    assert_array_equal(found, 2 * p)
    assert met == [(True, False) if start else None]
