"""States at rest and at the end of a substep: displacement, slip, forces, work and energy are those of definitions."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from shared.problems import scene_of, surface_problem
from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Vec
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.laws.wear import REPEAT, WORN
from stickslip.solvers.stepping.law_memory import LawMemory
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.update import Surplus, at_rest, displacement, flat_rows, new_state, split
from stickslip.solvers.system.system import System
from stickslip.workflows.lab.verification.prepared import prepare

MU, C_N, K_T, SPEED, WIDENS = 0.3, 20.0, 3.0, 2.5, 0.05
FLOOR = {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
LID = {"shape": "plane", "point": [0.0, 1.0], "normal": [0.0, -1.0]}


@cache
def posed() -> tuple[System, SurfaceProblem]:
    """A block that slides out of the plane on a moving floor, which wears, under a driven lid with a gap that widens.

    It has springs to the ground, a spring that is slack, a bolt and a remote point.
    """
    on_floor = {"friction": {"law": "coulomb", "mu": MU}, "wear": {"k": 0.1}, "slide": [[0.0, 0.0], [2.0, 2 * SPEED]]}
    under_lid = {"normal": {"law": "compliance", "c_n": C_N}, "friction": {"law": "coulomb", "mu": 0.4, "k_T": K_T}}
    bolt = {"head": "block.right", "nut": "block.left", "axis": [1.0, 0.0], "stiffness": 4.0}
    loose = {"at": "block.right", "stiffness": 1.5, "direction": [0.0, 1.0], "acts": "tension", "gap": 0.3}
    scene = scene_of(
        2,
        {"mesh_size": 0.5},
        obstacles={
            "floor": FLOOR | {"displacement": {"x": [[0.0, 0.0], [2.0, 0.04]], "y": [[0.0, 0.0], [2.0, 0.06]]}},
            "lid": LID | {"force": {"y": -0.2}},
        },
        contacts={
            "base": {"surface": "block.bottom", "against": "floor"} | on_floor,
            "cover": {"surface": "block.top", "against": "lid", "gap_offset": [[0.0, 0.0], [2.0, 2 * WIDENS]]}
            | under_lid,
        },
        supports={"left": {"boundary": "block.left", "displacement": {"x": [[2.0, 0.06]], "y": -0.1}}},
        loads={"push": {"boundary": "block.right", "traction": [-0.1, 0.02]}},
        bolts={"b": bolt | {"shortening": [[2.0, 0.1]]}},
        springs={"g": {"at": "block.right", "stiffness": [2.0, 3.0]}, "loose": loose},
        elastic_support={"side": {"boundary": "block.right", "tangential": 5.0}},
        remote_points={"r": {"boundary": "block.right", "point": [3.0, 0.5], "coupling": "distributing"}},
        steps={"end": 2.0, "count": 2, "seconds": True},
    )
    simulation = prepare(scene)
    problem = surface_problem(simulation)
    slid = np.random.default_rng(0).normal(size=len(problem.gap))
    return simulation.stepper.system, replace(problem, gap=problem.gap + slid)


def drawn(system: System, random: np.random.Generator) -> Vec:
    found = system.vector()
    found.array[:] = random.normal(size=len(found.array))
    return found


def ends(seed: int, repeat: float = 1.0, **more: Any) -> tuple[State, State, dict[str, Any]]:
    """A state by lot at 0.4 s, the one at 1 s that is made from it and what is given by lot, and that."""
    (system, problem), random = posed(), np.random.default_rng(seed)
    begun = at_rest(system, replace(problem.cone, contacts=system.contacts))
    given: list[dict[str, Any]] = [
        {
            "u": (u := drawn(system, random)),
            "u_strained": u,
            "u_s": drawn(system, random),
            "load": drawn(system, random),
            "p": random.uniform(0.1, 1.0, len(problem.gap)),
            "driven": random.normal(size=1),
        }
        for _ in range(2)
    ]
    early = replace(problem, cone=problem.cone.at(0.4))
    old = new_state(system=system, old=begun, problem=early, **given[0])
    memory = old.memory | ({} if repeat == 1 else {REPEAT: np.array(repeat)})
    old = replace(old, memory=memory, searched={"base": np.zeros((3, 2))})
    return old, new_state(system=system, old=old, problem=problem, **given[1] | more), given[1]


def motions(vectors: dict[str, Array]) -> Iterator[Array]:
    """Of each contact, in their order."""
    return (vectors[c.name] for c in posed()[0].contacts)


def by_rows(vector: Vec) -> Array:
    """Normal and tangential displacement (rows,) [m] of what moves so, without obstacles."""
    system, _ = posed()
    moved = system.interface.displacement(vector)
    pairs = [*zip(system.contacts, moved, strict=True)]
    return np.concatenate([*(c.N_n @ v.ravel() for c, v in pairs), *(c.N_t @ v.ravel() for c, v in pairs)])


def surplus(seed: int) -> Surplus:
    """By lot."""
    (system, problem), random = posed(), np.random.default_rng(seed)
    return Surplus(
        inner=drawn(system, random),
        relative=random.normal(size=len(problem.gap)),
        motion={c.name: random.normal(size=c.surface.points.shape) for c in system.contacts},
        stored=0.7,
        external=0.3,
        contact=0.2,
        initial_work=random.normal(size=2),
        elongation=random.normal(size=4),
        remote=random.normal(size=3),
        ground=random.normal(size=3),
        friction={"cover": (random.normal(size=system.contacts[1].points.shape), 0.11)},
    )


def test_at_rest_nothing_has_moved_or_presses() -> None:
    system, problem = posed()
    state = at_rest(system, replace(problem.cone, contacts=system.contacts))
    assert_array_equal(state.memory["base"], np.zeros(4))
    for vector in (state.u, state.u_s, state.load, state.residual):
        assert vector.array.shape == system.vector().array.shape
        assert not vector.array.any()
    sizes = {"initial": 2, "initial_work": 2, "elongation": 4, "remote": 3, "ground": 3, "p": 20, "w": 20, "driven": 1}
    for name, size in sizes.items():
        assert_array_equal(getattr(state, name), np.zeros(size))
    for c in system.contacts:
        assert_array_equal(state.motion[c.name], np.zeros_like(c.points))
        assert_array_equal(state.forces[c.name], np.zeros_like(c.points))
        assert_array_equal(state.slip[c.name], np.zeros_like(c.surface.points))
    energy = state.energy
    assert (energy.external, energy.stored, energy.contact, energy.compliance) == (0.0, 0.0, 0.0, 0.0)
    assert_array_equal(energy.dissipation, np.zeros(2))
    assert (state.time, state.rows, state.searched) == (0.0, system.contacts, {})


def test_at_rest_there_are_the_tractions_and_forces_that_are_initial() -> None:
    """On the floor 0.2 Pa, and 0.05 Pa along it; the load is what balances them."""
    initial = {"pressure": 0.2, "traction": 0.05}
    base = {"friction": {"law": "coulomb", "mu": MU}, "initial": initial}
    stepper = prepare(scene_of(2, {"mesh_size": 0.5}, base=base, top={"x": 0.0, "y": 0.0})).stepper
    system, (contact,) = stepper.system, stepper.system.contacts
    state = at_rest(system, stepper.cone)
    assert_allclose(state.p[: len(contact.W_n)], 0.2)
    assert_allclose(np.abs(state.p[len(contact.W_n) :]), 0.05)
    assert_allclose(np.abs(state.forces["base"].sum(axis=0)), [0.05 * 2.0, 0.2 * 2.0])
    pushed = system.interface.displacement(state.load)[0]  # at the nodes
    assert_allclose(pushed, state.forces["base"])
    assert state.load is not system.prestress


def test_forces_balance_up_to_the_residual_and_rows_move_as_nodes_do() -> None:
    """v . residual = v . (K u - load - sum a f) + W p . N v, for any v."""
    (system, problem), random = posed(), np.random.default_rng(9)
    old, new, given = ends(1)
    v, initial = drawn(system, random), system.initial
    assert_array_equal(new.initial, initial.values(system.course, 1.0))
    inner = v.dot(system.K * given["u"]) - v.dot(given["load"]) + problem.surface.W @ (given["p"] * by_rows(v))
    assert new.residual.dot(v) == pytest.approx(inner - new.initial @ [f.dot(v) for f in initial.forces], rel=1e-10)
    floor, lid = new.motion["base"], new.motion["cover"]
    assert_allclose(floor, np.tile([0.02, 0.03], (len(floor), 1)))
    assert_allclose(lid, np.tile([0.0, given["driven"][0]], (len(lid), 1)))
    rows = flat_rows(system.contacts, [*motions(new.motion)])
    assert_allclose(new.w, by_rows(given["u"]) - rows, atol=1e-12)
    for (c, place), v_new, v_old in zip(
        zip(system.contacts, problem.cone.places, strict=True),
        system.interface.displacement(new.u),
        system.interface.displacement(old.u),
        strict=True,
    ):
        along = (v_new - v_old - new.motion[c.name] + old.motion[c.name])[:, 0]
        slipped = new.slip[c.name] - old.slip[c.name]
        assert_allclose(slipped, np.column_stack([along, 0 * along]), atol=1e-12)
        t = given["p"][place.tangential]
        assert_allclose(new.forces[c.name], c.nodal_forces(given["p"][place.normal], t.reshape(-1, 1)))
    assert_array_equal(new.p, given["p"])
    assert_allclose(new.elongation, system.constraints.links.elongation(given["u"]))
    assert_allclose(new.remote, system.constraints.remote.motion(given["u"]))
    assert_allclose(new.ground, system.ground.exerted(given["u"]))
    assert (new.time, new.rows) == (1.0, system.contacts)
    assert new.searched is old.searched
    for name in ("u", "u_s", "load", "driven"):
        assert getattr(new, name) is given[name]


@pytest.mark.parametrize("repeat", [1.0, 3.0])
def test_work_is_that_of_mean_forces_on_what_moves(repeat: float) -> None:
    """On rows: W (p + p_old) / 2 . (dw - dgap); what is not balanced by it and the stored energy works on the rest."""
    (system, problem), (old, new, given) = posed(), ends(2, repeat)
    W, cone, p = problem.surface.W, problem.cone, given["p"]
    widens = np.zeros(len(p))
    widens[cone.places[1].normal] = WIDENS * (1.0 - 0.4)
    moved = float(W @ ((p + old.p) / 2 * (new.w - old.w - widens)))
    rubbed = W * p * (new.w - problem.gap - cone.give(p))
    rubs = [float(rubbed[place.tangential].sum()) for place in cone.places]
    begun, lasting = old.memory, LawMemory(replace(cone, contacts=system.contacts).at(1.0), old.memory, 0.6)
    ended = lasting.after(problem, p, new.w)
    for key, value in new.memory.items():
        assert_allclose(value, ended[key])
    base = cone.places[0]
    worn = W[base.normal] * p[base.normal] @ (ended[f"base{WORN}"] - begun[f"base{WORN}"])
    share = np.sqrt(1 - ended["base"] ** 2)
    aside = repeat * float(base.rows.W_t @ (MU * (base.average @ p[base.normal]) * share)) * SPEED * 0.6
    again = (repeat - 1) * sum(rubs)
    of_slack = system.initial.external(old.initial, new.initial, old.initial_work, new.initial_work)[1]
    energy = new.energy
    assert energy.contact - old.energy.contact == pytest.approx(moved - of_slack + again + aside, rel=1e-10)
    assert_allclose(
        energy.dissipation - old.energy.dissipation, [repeat * rubs[0] + worn + aside, repeat * rubs[1]], rtol=1e-10
    )
    stored = system.initial.stored(new.initial, new.initial_work)
    assert energy.stored == pytest.approx(given["u"].dot(system.K * given["u"]) / 2 + stored, rel=1e-12)
    lid, t = p[cone.places[1].normal], p[cone.places[1].tangential]
    springs = W[cone.places[1].normal] @ lid**2 / (2 * C_N) + W[cone.places[1].tangential] @ t**2 / (2 * K_T)
    assert energy.compliance == pytest.approx(springs, rel=1e-12)
    left = (new.residual + old.residual).dot(new.u - old.u - (new.u_s - old.u_s)) / 2
    done = [getattr(energy, name) - getattr(old.energy, name) for name in ("external", "stored", "contact")]
    assert done[0] - done[1] - done[2] + left == pytest.approx(0.0, abs=1e-10 * max(map(abs, done)))


def test_a_displacement_that_is_added_moves_rubs_and_works_as_it_is_said_to() -> None:
    (system, problem), (old, without, given), more = posed(), ends(3), surplus(4)
    _, new, _ = ends(3, surplus=more)
    initial, W, cone, p = system.initial, problem.surface.W, problem.cone, given["p"]
    v = drawn(system, np.random.default_rng(5))
    assert (new.residual - without.residual).dot(v) == pytest.approx(more.inner.dot(v), rel=1e-9)
    assert_allclose(new.w, without.w + more.relative)
    assert_allclose(new.elongation, without.elongation + more.elongation)
    assert_allclose(new.remote, without.remote + more.remote)
    assert_allclose(new.ground, without.ground + more.ground)
    followed = initial.followed(without.initial, without.initial_work + more.initial_work)
    assert followed[1] != without.initial[1]  # of the spring that is slack
    assert_array_equal(new.initial, followed)
    assert_allclose(new.initial_work, initial.stress_work(followed, given["u"]) + more.initial_work)
    between, rubbed = more.friction["cover"]
    assert_allclose(new.forces["cover"], without.forces["cover"] + between)
    assert_array_equal(new.forces["base"], without.forces["base"])
    for name in ("base", "cover"):
        assert_allclose(new.slip[name] - without.slip[name], more.motion[name] * [1.0, 0.0], atol=1e-12)
    again = LawMemory(replace(cone, contacts=system.contacts).at(1.0), old.memory, 0.6)
    assert_allclose(new.memory["base"], again.after(problem, p, new.w)["base"])

    def sums(state: State) -> Array:
        """Of initial strains work, that on slacks, and stored; work aside; dissipation on the floor, under the lid."""
        worked = initial.external(old.initial, state.initial, old.initial_work, state.initial_work)
        base, lid = (place.tangential for place in cone.places)
        bound = MU * (cone.places[0].average @ p[cone.places[0].normal])
        aside = float(W[base] @ (bound * np.sqrt(1 - state.memory["base"] ** 2))) * SPEED * 0.6
        n, slipped = cone.places[0].normal, W * p * (state.w - problem.gap - cone.give(p))
        rubbed = slipped[base].sum() + aside + W[n] * p[n] @ state.memory[f"base{WORN}"], slipped[lid].sum()
        return np.array([*worked, initial.stored(state.initial, state.initial_work), aside, *rubbed])

    worked, on_slacks, stored, aside, *slipped = sums(new) - sums(without)
    above, below = (system.interface.displacement(u)[1] for u in (new.u, old.u))
    pushed = new.motion["cover"] - old.motion["cover"]
    prescribed = more.inner.dot(new.u_s - old.u_s) / 2 - float(np.sum(between * pushed)) / 2
    at_lid = float(np.sum(between * (above - below - pushed))) / 2
    for name, expected in {
        "external": more.external + prescribed + worked + aside,
        "stored": more.stored + stored,
        "contact": more.contact + at_lid - on_slacks + aside,
    }.items():
        found = getattr(new.energy, name) - getattr(without.energy, name)
        assert found == pytest.approx(expected, rel=1e-9), name
    assert_allclose(new.energy.dissipation - without.energy.dissipation, [slipped[0], slipped[1] + rubbed], rtol=1e-9)


def test_values_and_memory_that_are_given_are_taken() -> None:
    memory: dict[str, Array] = {"base": np.full(4, 0.5)}
    _, new, _ = ends(6, initial=np.array([0.3, 0.4]), memory=memory)
    assert new.memory is memory
    assert_array_equal(new.initial, [0.3, 0.4])


@pytest.mark.parametrize("rigid", [True, False])
def test_a_rigid_motion_that_is_prescribed_strains_nothing(rigid: bool) -> None:
    top = {"top": {"boundary": "block.top", "displacement": {"x": 0.1 if rigid else "0.1*x", "y": 0.2}}}
    system = prepare(scene_of(2, {"mesh_size": 0.5}, base={}, supports=top)).stepper.system
    q, u_s, random = system.T.createVecRight(), system.vector(), np.random.default_rng(0)
    q.array[:], u_s.array[:] = random.normal(size=len(q.array)), random.normal(size=len(u_s.array))
    u, strained = displacement(system, 1.0, q, u_s)
    assert_allclose(u.array, (system.T * q + u_s).array)
    assert_allclose(strained.array, (system.T * q if rigid else u).array)


def test_tractions_are_split_by_contact_and_component() -> None:
    places = [SimpleNamespace(normal=slice(0, 2), tangential=slice(3, 7), components=2)]
    places += [SimpleNamespace(normal=slice(2, 3), tangential=slice(7, 9), components=2)]
    pressures, tangential = split(cast("Any", SimpleNamespace(places=places)), np.arange(9.0))
    assert [p.tolist() for p in pressures] == [[0.0, 1.0], [2.0]]
    assert [t.tolist() for t in tangential] == [[[3.0, 4.0], [5.0, 6.0]], [[7.0, 8.0]]]


def test_without_contact_there_are_no_rows() -> None:
    assert flat_rows((), []).shape == (0,)
