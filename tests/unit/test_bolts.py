"""Bolts are tightened to forces and lengths and then held, with the errors that are stated."""

from __future__ import annotations

import itertools
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_allclose

from shared.audited import audit
from shared.cases import every_nth
from shared.histories import Stop
from shared.problems import followed as estimating
from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.solvers.accuracy import two_level
from stickslip.solvers.accuracy.bubbles import Bubbles
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import OnStep, Solution, Status
from stickslip.solvers.methods.method import Solve
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.results.step_result import Quantity, StepResult, quantities, values
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.history import HistoryRow
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.stepper import StepError
from stickslip.solvers.stepping.tightening import BoltsAndSprings
from stickslip.solvers.system.system import assemble
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import from_dict, read

E, K, SHORTER, MU = 1000.0, 400.0, 0.01, 0.2
BY_FORCE = {"shortening": None}
AREA = {"plane strain": 2.0, "3d": 1.0, "axisymmetric": np.pi * 4.0}


def given(bolt: dict[str, Any]) -> dict[str, Any]:
    """Its keys that are not None."""
    return {key: value for key, value in bolt.items() if value is not None}


def plates(model: str, nu: float, order: int = 1, size: float = 0.5, **tables: Any) -> Scene:
    """Two plates 2 x 1 (x 0.5), one on the other."""
    shape = {"builder": "two_blocks", "length": 2.0, "height": 1.0, "mesh_size": size, "order": order}
    width = {"width": 0.5} if model == "3d" else {}
    bodies = {name: {"E": E, "nu": nu} for name in ("upper", "lower")}
    return from_dict({"model": model, "geometry": shape | width, "bodies": bodies} | tables)


def guided(model: str) -> dict[str, Any]:
    """Supports of both plates in the planes of symmetry along the bolt."""
    across = {"3d": {"left": "x", "front": "y"}, "plane strain": {"left": "x"}, "axisymmetric": {}}[model]
    return {
        f"{body}_{side}": {"boundary": f"{body}.{side}", "displacement": {axis: 0.0}}
        for body in ("lower", "upper")
        for side, axis in across.items()
    }


def joint(
    model: str = "plane strain",
    order: int = 1,
    bolt: dict[str, Any] | None = None,
    bolts: dict[str, dict[str, Any]] | None = None,
    **tables: Any,
) -> Scene:
    """Two plates, nu = 0, on a foot that carries no force along the bolt while it is tightened."""
    up = [0.0, 0.0, 1.0] if model == "3d" else [0.0, 1.0]
    own = {"head": "upper.top", "nut": "lower.bottom", "axis": up, "stiffness": K, "shortening": [[1.0, SHORTER]]}
    foot = {"boundary": "lower.bottom", "displacement": {"z" if model == "3d" else "y": 0.0}}
    made = {
        "supports": guided(model) | {"foot": foot},
        "contacts": {"joint": {"surface": "upper.bottom", "against": "lower.top"}},
        "bolts": {name: given(own | keys) for name, keys in {"b": bolt or {}, **(bolts or {})}.items()},
    }
    return plates(model, 0.0, order, **made | tables)


@pytest.mark.parametrize(("model", "order"), every_nth(2, AREA, [1, 2]))
def test_bolt_and_plates_share_a_load_until_the_joint_opens(model: str, order: int) -> None:
    """F0 = k s c / (k + c); a load A adds A k / (k + c) to the bolt up to A = F0 (1 + k / c), from there all."""
    plates = E * AREA[model] / 2
    preload = K * SHORTER * plates / (K + plates)
    opens = preload * (1 + K / plates)
    pull = [0.0] * (model == "3d") + [0.0, [[1.0, 0.0], [2.0, 2.1 * opens / AREA[model]]]]
    loads = {"pull": {"boundary": "upper.top", "traction": pull}}
    simulation = prepare(joint(model, order, loads=loads, steps={"end": 2.0, "count": 8}))
    for step in simulation.steps():
        tightened, load = min(step.time, 1.0), 2.1 * opens * max(step.time - 1.0, 0.0)
        tension = max(tightened * preload + load * K / (K + plates), load)
        assert_allclose(step.bolts["b"], (tension, tightened * SHORTER), rtol=1e-8)
        assert_allclose(values(step)["bolt.b.tension"], tension, rtol=1e-8)
        assert_allclose(step.contacts["joint"].normal_force, tension - load, atol=1e-8 * preload)
        energy = step.energy
        assert energy.external == pytest.approx(energy.stored + energy.contact, abs=1e-10 * preload * SHORTER)
        assert max(audit(simulation, step).values()) < 1e-8


def test_a_lap_joint_slips_at_mu_times_the_tension() -> None:
    """One face of friction: n mu P, n = 1."""
    friction = {"joint": {"surface": "upper.bottom", "against": "lower.top", "friction": {"law": "coulomb", "mu": MU}}}
    supports = {
        "foot": {"boundary": "lower.bottom", "displacement": {"y": 0.0}},
        "held": {"boundary": "lower.left", "displacement": {"x": 0.0}},
        "drawn": {"boundary": "upper.right", "displacement": {"x": [[1.0, 0.0], [2.0, 0.004]]}},
    }
    simulation = prepare(joint(contacts=friction, supports=supports, steps={"end": 2.0, "count": 8}))
    *_, stuck, _, _, last = simulation.steps()
    contact = last.contacts["joint"]
    assert contact.stick_area == 0.0
    assert stuck.contacts["joint"].stick_area > 0.0
    assert_allclose(last.supports["drawn"].force[0], MU * last.bolts["b"].tension, rtol=1e-6)
    assert_allclose(contact.normal_force, last.bolts["b"].tension, rtol=1e-8)
    assert max(audit(simulation, last).values()) < 1e-8


def test_a_bolt_is_tightened_to_a_force_and_then_held() -> None:
    """The same joint diagram from the force; two bolts beside each other, one of them loosens the other."""
    plates, force = E * AREA["plane strain"] / 2, 3.0
    loads = {"pull": {"boundary": "upper.top", "traction": [0.0, [[2.0, 0.0], [3.0, 1.0]]]}}
    bolt = BY_FORCE | {"force": [[2.0, force]], "held_from": 2.0}
    simulation = prepare(joint(bolt=bolt, loads=loads, steps={"end": 3.0, "count": 6}))
    for step in simulation.steps():
        added = 2.0 * max(step.time - 2.0, 0.0) * K / (K + plates)
        tension = force * min(step.time / 2.0, 1.0)
        assert_allclose(step.bolts["b"].tension, tension + added, rtol=1e-7)
        assert_allclose(step.bolts["b"].shortening, tension * (1 / K + 1 / plates), rtol=1e-7)
        assert max(audit(simulation, step).values()) < 1e-7


def test_bolts_share_what_one_of_them_loosens() -> None:
    """A bolt that is tightened to a force beside one that was shortened before; friction carries nothing."""
    simulation = prepare(
        joint(
            bolt=BY_FORCE | {"force": [[1.0, 1.0], [2.0, 2.0]], "held_from": 1.0},
            bolts={"c": BY_FORCE | {"force": [[1.0, 0.0], [2.0, 2.0]]}},
            steps={"end": 2.0, "count": 2},
        )
    )
    plates = E * AREA["plane strain"] / 2
    one, two = simulation.steps()
    assert_allclose([one.bolts["b"].tension, one.bolts["c"].tension], [1.0, 0.0], atol=1e-7)
    # the second one compresses the plates by 2 / c of its own, and the first one gives way: k (2 - loss) / c
    loss = 2.0 * K / (K + plates)
    assert_allclose([two.bolts["b"].tension, two.bolts["c"].tension], [1.0 - loss, 2.0], rtol=1e-6)
    assert two.bolts["b"].shortening == one.bolts["b"].shortening
    assert max(audit(simulation, two).values()) < 1e-7


@pytest.mark.parametrize(
    ("unit", "forces"), every_nth(2, [1e-9, 1.0, 1e9], [(3.0, 0.0), (3.0, 1e-10), (0.0, 0.0), (1e-12, 0.0)])
)
def test_tensions_are_as_exact_in_every_unit_of_force(
    unit: float, forces: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A slack bolt beside a tight one is as exact as that, not to a part of itself or of 1 N."""
    force, idle = forces
    monkeypatch.setattr(BoltsAndSprings, "at_once", lambda _, __, problem, *words: (None, problem))
    stiff = BY_FORCE | {"stiffness": K * unit}
    made = joint(
        bolt={"force": [[1.0, force * unit]]} | stiff,
        bolts={"idle": {"force": idle * unit} | stiff},
        bodies={name: {"E": E * unit, "nu": 0.0} for name in ("upper", "lower")},
        loads={"press": {"boundary": "upper.top", "traction": [0.0, [[1.0, -unit]]]}},
        output={"error": False},
    )
    (step,) = prepare(made).steps()
    tensions = np.array([step.bolts[name].tension for name in ("b", "idle")])
    assert_allclose(tensions / unit, [force, idle], atol=3e-9)


@pytest.mark.parametrize(
    ("bolt", "message"),
    [
        ({"force": 1.0, "held_from": 0.7, "shortening": None}, r"bolts\.b\.held_from = 0\.7: no step ends there; list"),
        ({"head": "upper.tp"}, r"bolts\.b\.head = upper\.tp: no such side; did you mean upper\.top"),
        ({"nut": "lower.botom"}, r"bolts\.b\.nut = lower\.botom: no such side"),
        ({"nut": "upper.top"}, r"bolts\.b\.nut = upper\.top: a bolt has two different ends"),
        ({"axis": [0.0, 0.0]}, r"bolts\.b\.axis = \[0\.0, 0\.0\]: must not be zero"),
        ({"axis": [1.0]}, r"bolts\.b\.axis = \[1\.0\]: expected 2 components"),
        ({"stiffness": -1.0}, r"bolts\.b\.stiffness = -1\.0: must be positive, in N/m"),
        ({"shortening": "t"}, r'bolts\.b\.shortening = "t": expected a number'),
        ({"torque": 1.0}, r"bolts\.b\.torque: unknown key"),
        ({"force": 1.0}, r"bolts\.b\.shortening / force: exactly one of the two is needed"),
        ({"held_from": 1.0}, r"bolts\.b\.held_from = 1\.0: belongs to force"),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(bolt: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        joint(bolt=bolt)


def test_a_bolt_is_along_the_axis_of_symmetry() -> None:
    with pytest.raises(SceneError, match=r"bolts\.b\.axis = \[1\.0, 0\.0\]: an axisymmetric model has bolts along"):
        joint("axisymmetric", bolt={"axis": [1.0, 0.0]})


def drawn(model: str = "plane strain", order: int = 1, **bolt: Any) -> Scene:
    """Two blocks that are tied to each other between rigid walls; the upper one is the bolt, from y = .2 to .7."""
    up, deep = ("z", 2) if model == "3d" else ("y", 1)
    ends = {"roof": "upper.top", "floor": "lower.bottom"}
    walls = {name: {"boundary": side, "displacement": {up: 0.0}} for name, side in ends.items()}
    shank = [[*[0.3 * (model != "axisymmetric")] * deep, level] for level in (0.2, 0.7)]
    return plates(
        model,
        0.3,
        order,
        supports=guided(model) | walls,
        contacts={"joint": {"surface": "upper.bottom", "against": "lower.top", "normal": {"law": "tied"}}},
        bolts={"b": given({"body": "upper", "shank": shank} | bolt)},
    )


@pytest.mark.parametrize("floating", [False, True])
def test_the_tension_is_found_with_the_step(
    floating: bool, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """In one solution; the same as by trying shortenings, one solution each. The joint is dragged until it slips."""
    shared: dict[str, Any] = {
        "contacts": {
            "joint": {"surface": "upper.bottom", "against": "lower.top", "friction": {"law": "coulomb", "mu": MU}}
        },
        "steps": {"end": 2.0, "count": 4},
        "loads": {"drag": {"boundary": "upper.top", "traction": [[[1.0, 0.0], [2.0, 0.1]], 0.0]}},
    }
    foot = {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0}}
    if floating:  # only the joint holds the upper plate
        shared["supports"] = {"foot": foot}
    made = joint(bolt=BY_FORCE | {"force": [[1.0, 3.0]], "held_from": 1.0}, **shared)
    caplog.set_level(logging.INFO, "stickslip.solvers.stepping.tightening")

    def solved() -> tuple[list[tuple[float, ...]], int]:
        caplog.clear()
        steps = list(prepare(made).steps())
        numbers = [(*step.bolts["b"], *step.contacts["joint"].force, step.energy.stored) for step in steps]
        return numbers, sum("tension of bolts" in record.message for record in caplog.records)

    at_once, few = solved()
    monkeypatch.setattr(BoltsAndSprings, "at_once", lambda _, __, problem, *words: (None, problem))
    by_trying, many = solved()
    assert few == len(at_once) == 4 < many
    assert_allclose(at_once, by_trying, rtol=1e-7, atol=1e-9)
    assert [tension for tension, *_ in at_once[:2]] == pytest.approx([1.5, 3.0], rel=1e-12)


LEGS = """SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 0.2, 1}; Rectangle(2) = {0.6, 0, 0, 0.4, 2};
Physical Surface("legs") = {1, 2};
Physical Curve("legs.bottom") = {1, 5};
Physical Curve("legs.top") = {3, 7};
"""


def test_legs_that_are_lengthened_as_one_share_a_force_by_their_stiffness(tmp_path: Path) -> None:
    """Both legs press c_n deep by as much as they are longer, less what they give: p (1 / c_n + L / E) = longer."""
    (tmp_path / "legs.geo").write_text(LEGS)
    c_n, force = 500.0, 3.0
    simulation = prepare(
        from_dict(
            {
                "model": "plane strain",
                "geometry": {"file": str(tmp_path / "legs.geo"), "mesh_size": 0.5},
                "bodies": {"legs": {"E": E, "nu": 0.0}},
                "obstacles": {"floor": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
                "contacts": {
                    "feet": {"surface": "legs.bottom", "against": "floor", "normal": {"law": "compliance", "c_n": c_n}}
                },
                "supports": {"top": {"boundary": "legs.top", "displacement": {"x": 0.0, "y": 0.0}}},
                "bolts": {"b": {"body": "legs", "shank": [[0.0, 0.3], [0.0, 0.7]], "force": [[1.0, -force]]}},
            }
        )
    )
    (step,) = simulation.steps()
    gives = np.array([1 / c_n + 1 / E, 1 / c_n + 2 / E])
    longer = force / (np.array([0.2, 0.4]) / gives).sum()
    assert_allclose(step.bolts["b"], (-force, -longer), rtol=1e-8)
    assert_allclose(np.unique(step.contacts["feet"].pressure.round(9)), np.sort(longer / gives), rtol=1e-8)
    assert max(audit(simulation, step).values()) < 1e-8


@pytest.mark.parametrize(("model", "order"), every_nth(2, AREA, [2, 1]))
def test_a_drawn_bolt_pulls_as_hooke_says(model: str, order: int) -> None:
    """Of a column of length 2 between walls: E A shortening / 2, uniform, wherever the planes cut cells."""
    stiffness = E * AREA[model] / 2 / (1 - 0.3**2 if model == "plane strain" else 1)
    for bolt in ({"shortening": [[1.0, SHORTER]]}, {"force": [[1.0, stiffness * SHORTER]], "held_from": 1.0}):
        simulation = prepare(drawn(model, order, **bolt))
        *_, step = simulation.steps()
        assert_allclose(step.bolts["b"], (stiffness * SHORTER, SHORTER), rtol=1e-8)
        assert_allclose(step.stress[:, *[2 if model == "3d" else 1] * 2], stiffness * SHORTER / AREA[model], rtol=1e-8)
        assert_allclose(np.abs(step.supports["floor"].force).max(), stiffness * SHORTER, rtol=1e-8)
        energy = stiffness * SHORTER**2 / 2
        assert_allclose([step.energy.external, step.energy.stored], energy, rtol=1e-8)
        assert max(audit(simulation, step).values()) < 1e-8


@pytest.mark.parametrize(
    ("bolt", "message"),
    [
        ({"body": "uper"}, r"bolts\.b\.body = uper: did you mean upper"),
        ({"shank": [[0.0, 1.2], [0.0, 1.2]]}, r"bolts\.b\.shank = .*: two different points are needed"),
        ({"shank": [[0.0, 1.2], [0.0]]}, r"bolts\.b\.shank = \[0\.0\]: expected 2 components"),
        ({"shank": None}, r"bolts\.b\.shank = missing: a bolt has body and shank"),
        ({"stiffness": 1.0}, r"bolts\.b\.stiffness = 1\.0: belongs to a bolt that is a spring; remove it"),
        ({"body": None}, r"bolts\.b\.shank = .*: belongs to a bolt that is a body; remove it"),
    ],
)
def test_a_drawn_bolt_has_a_body_and_a_shank(bolt: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        drawn("plane strain", 1, **{"shortening": SHORTER} | bolt)


@pytest.mark.parametrize("levels", [(1.2, 1.4), (-0.4, -0.1)])
def test_a_shank_beside_its_body_is_refused(levels: tuple[float, float]) -> None:
    with pytest.raises(SceneError, match=r"bolts\.b\.shank: no part of upper lies between the two planes"):
        prepare(drawn("plane strain", 1, shortening=SHORTER, shank=[[0.1, y] for y in levels]))


def test_a_script_steps_to_a_time_before_a_bolt_is_held() -> None:
    coarse = ["geometry.mesh_size=0.005", "output.error=false"]
    script = prepare(read("lap_joint", coarse)).script()
    tensions = [script.step(to=to).bolts["bolt"].tension for to in (0.5, 1.0)]
    assert_allclose(tensions, [1.5e6, 3e6], rtol=1e-4)


def test_a_given_tension_is_found_though_the_bodies_are_condensed_anew() -> None:
    """Without friction they are condensed onto the pressed dofs, and onto all once another method takes over."""
    force = BY_FORCE | {"force": [[1.0, 2.0], [2.0, 3.0]]}
    held = {"foot": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0}}}
    held["left"] = {"boundary": "upper.left", "displacement": {"x": 0.0, "y": 0.0}}
    simulation = prepare(joint(bolt=force, supports=held, steps={"end": 2.0, "count": 2}))
    stepper, chain = simulation.stepper, simulation.stepper.chain
    before = stepper.start()
    accepted = stepper.reach(before, 1.0, lambda row: None)
    few = len(chain.volume.contact.rows)
    lost = Solution(p=before.p, w=before.w, u_c=np.zeros(0), status=Status.STALLED, residual=1.0, history=())
    assert chain.advance(simulation.system, 1.0, lost)
    stepper.follow()
    assert len(chain.volume.contact.rows) > few
    accepted = stepper.reach(accepted.state, 2.0, lambda row: None)
    assert_allclose(-accepted.state.initial_work, 3.0, rtol=1e-6)


@pytest.mark.parametrize(("begins", "good"), [(0.0, None), (1.0, 1.5)])
def test_a_step_that_fails_has_all_tries_and_no_state_with_another_tension(
    begins: float, good: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While the tension is sought, and the third try fails on its way; and once the bolt is held."""
    monkeypatch.setattr(BoltsAndSprings, "at_once", lambda _, __, problem, *words: (None, problem))
    base = {"joint": {"surface": "upper.bottom", "against": "lower.top", "gap_offset": 1e-6}}
    force = BY_FORCE | {"force": [[1.0, 3.0]], "held_from": 1.0}
    tables = {"steps": {"end": 2.0, "count": 2}, "solver": {"method": "condensed-newton"}}
    simulation = prepare(joint(bolt=force, contacts=base, **tables))
    stepper, rows, tries = simulation.stepper, list[HistoryRow](), itertools.count(1)
    state, whole = stepper.start(), stepper.method_after
    if begins:
        state = stepper.reach(state, begins, lambda row: None).state

    def after(state: State) -> Solve:
        def solve(problem: SurfaceProblem, p: Array, on_step: OnStep) -> Solution:
            found, first = whole(state)(problem, p, on_step), next(tries) < 3 and not begins
            length = problem.cone.time - state.time
            fails = not first and (state.time >= begins + 0.5 or length > 0.5)
            return replace(found, status=Status.STALLED) if fails else found

        return solve

    stepper.method_after = after
    with pytest.raises(StepError, match="the residual stopped falling") as failed:
        stepper.reach(state, begins + 1.0, rows.append)
    assert failed.value.history == tuple(rows)
    last = failed.value.last_good
    assert (last and last.state.time) == good
    assert last is None or last.history == tuple(rows[: len(last.history)])


FORCE = 5.0
BLOCKS = {"builder": "two_blocks", "length": 2.0, "height": 1.0}
FINE: dict[str, Any] = {"geometry": BLOCKS | {"mesh_size": 0.0625, "order": 2}, "output": {"error": False}}


def jack(model: str = "plane strain", bolts: dict[str, Any] | None = None, **tables: Any) -> Scene:
    """Two blocks between rigid walls; the upper one is a bolt that is driven apart until t = 1, then dragged."""
    solid = model == "3d"
    up, still = ("z", {"x": 0.0, "y": 0.0, "z": 0.0}) if solid else ("y", {"x": 0.0, "y": 0.0})
    drag = {up: 0.0, "x": [[1.0, 0.0], [2.0, 0.005]]} | ({"y": 0.0} if solid else {})
    shank = [[*[0.3] * (2 if solid else 1), level] for level in (0.2, 0.7)]
    bolt = {"body": "upper", "shank": shank, "force": [[1.0, -FORCE]], "held_from": 1.0}
    made = {
        "supports": {
            "roof": {"boundary": "upper.top", "displacement": drag},
            "floor": {"boundary": "lower.bottom", "displacement": still},
        },
        "contacts": {
            "joint": {"surface": "upper.bottom", "against": "lower.top", "friction": {"law": "coulomb", "mu": 0.2}}
        },
        "bolts": {"b": bolt, **(bolts or {})},
        "steps": {"end": 2.0, "count": 2},
    }
    return plates(model, 0.3, size=0.5 if solid else 0.25, **made | tables)


def stated(step: StepResult, key: str) -> Any:
    """Error of the mesh of a number, the part of the geometry included."""
    parts = step.errors[key]
    return parts.mesh + parts.geometry


@pytest.mark.parametrize("model", ["plane strain", "3d"])
def test_bubbles_see_the_strain_of_a_drawn_bolt_as_the_mesh_does(model: str) -> None:
    """Its forces work on a displacement of order 1 as much as those of the system: both have the same strain."""
    scene = jack(model)
    system = assemble(resolve(scene), build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF), Counters())
    bubbles, u = Bubbles(system), system.vector()
    u.array[:] = np.random.default_rng(0).random(len(u.array))
    linear, whole = dx.fem.Function(system.space), dx.fem.Function(bubbles.space)
    dx.fill(linear, u.array)
    whole.interpolate(linear)
    x = bubbles.zero()
    x.array[:] = whole.x.array[: len(x.array)]
    assert_allclose(bubbles.initial_work(x), [force.dot(u) for force in system.initial.forces], rtol=1e-10)


def test_errors_follow_the_force_and_then_the_length() -> None:
    tightened, held = estimating(jack()).steps()
    fine = estimating(jack(**FINE))
    truths = [{str(key): value for key, value in quantities(step).items()} for step in fine.steps()]
    assert stated(tightened, "bolts.b.tension") <= 1e-5 * FORCE
    assert tightened.corrected["bolts.b.tension"] == pytest.approx(-FORCE, rel=1e-5)
    assert tightened.corrected["contacts.joint.normal_force"] == pytest.approx(FORCE, rel=1e-3)
    assert stated(tightened, "contacts.joint.normal_force") < 0.01 * FORCE  # equilibrium fixes it
    for step, truth, keys in (
        (tightened, truths[0], ("energy.stored", "energy.external")),
        (held, truths[1], ("bolts.b.tension", "contacts.joint.normal_force", "energy.stored")),
    ):
        numbers = {str(key): value for key, value in quantities(step).items()}
        for key in keys:
            true = abs(numbers[key] - truth[key])
            assert 0.5 < stated(step, key) / true < 5.0, key
            assert abs(step.corrected[key] - truth[key]) < 0.7 * true, key


def refined(simulation: Simulation) -> list[tuple[float, float]]:
    """Tension and shortening of the bolt b of each step with bubbles."""
    found = []
    for _ in simulation.steps():
        state = simulation.reported.state.refined
        found.append((-state.initial_work[0], state.initial[0]))
    return found


def test_a_bolt_with_bubbles_is_held_at_a_length_of_its_own() -> None:
    """Softer bodies take more shortening for the same tension; from there on it stays."""
    simulation = estimating(jack(steps={"end": 2.0, "count": 4}))
    half, whole, *held = refined(simulation)
    assert_allclose([half[0], whole[0]], [-FORCE / 2, -FORCE], rtol=1e-5)
    assert [length for _, length in held] == [whole[1]] * 2
    ours = simulation.reported.state.initial[0]
    assert 1.002 < whole[1] / ours < 1.1


def test_tensions_of_several_bolts_are_followed() -> None:
    """Two springs beside the drawn one; they loosen each other."""
    spring = {"head": "upper.top", "nut": "lower.bottom", "axis": [0.0, 1.0], "stiffness": 400.0}
    free = {"supports": {"floor": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0}}}}
    beside = {
        "b": spring | {"force": [[1.0, 3.0]], "held_from": 1.0},
        "c": spring | {"head": "upper.right", "nut": "lower.right", "force": [[1.0, 0.0], [2.0, 2.0]]},
    }
    simulation = estimating(jack(bolts=beside, **free))
    tightened, both = simulation.steps()
    assert [step.errors["bolts.c.tension"].mesh for step in (tightened, both)] == pytest.approx([0, 0], abs=1e-5)
    assert tightened.errors["bolts.b.tension"].mesh == pytest.approx(0, abs=1e-5)
    assert 1e-5 < stated(both, "bolts.b.tension") < 0.1


def test_energy_of_a_bolt_with_bubbles_is_in_balance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of its shortening alone is work done: its forces on bubbles are inner ones."""
    monkeypatch.setattr(two_level, "STEPS", 25)
    simulation = estimating(jack())
    next(simulation.steps())
    state = simulation.reported.state.refined
    energy = state.energy
    assert energy.external - energy.contact == pytest.approx(energy.stored, rel=1e-4)


def test_the_stress_of_a_shank_is_corrected() -> None:
    """With order 2 it is shortened by another length, which is no stress."""
    probes = {"shank": {"point": [0.9, 0.45]}}
    simulation = prepare(jack(probes=probes))
    found, _ = simulation.errors(list(simulation.steps()))
    exact, _ = prepare(jack(probes=probes, **FINE)).steps()
    stress = exact.probes["shank"].stress[1, 1]
    assert found[Quantity("probes", "shank", "stress")].corrected[1] == pytest.approx(stress, rel=0.01)


@pytest.mark.parametrize("model", ["plane strain", "3d"])
def test_a_shank_that_ends_within_a_body_is_no_error_of_the_mesh(model: str) -> None:
    """A column between walls, whose stress is uniform: that of the shank's shortening jumps at its ends."""
    simulation = estimating(drawn(model, force=[[1.0, -FORCE]]))
    (step,) = simulation.steps()
    assert step.mesh_error < 1e-7
    assert_allclose(step.stress_error, 0.0, atol=1e-7 * FORCE)
    assert stated(step, "contacts.joint.normal_force") < 1e-7 * FORCE


def test_iterative_volume_solves_follow_the_force() -> None:
    sets = ["geometry.mesh_size=0.005", "solver.surface=matrix-free", "solver.method=surface-uzawa", "steps.count=2"]
    tightened, held = estimating(read("lap_joint", sets)).steps()
    direct = [*estimating(read("lap_joint", [sets[0], sets[3]])).steps()][1]
    assert stated(tightened, "bolts.bolt.tension") < 10.0  # of 3e6 N
    for step in (held, direct):  # order 2 has 677 N less
        assert 10 < stated(step, "bolts.bolt.tension") < 1000


def test_a_resumed_run_states_the_same_errors_to_the_last_bit(tmp_path: Path) -> None:
    scene = jack(steps={"end": 2.0, "count": 4}, output={"pictures": False})
    _, whole = run(scene, tmp_path / "whole")
    outcome, _ = run(scene, tmp_path / "out", Watch(on_step=Stop(3)))
    assert outcome.status == "interrupted"
    _, resumed = run(scene, tmp_path / "out", resume=True)
    for key in ("contacts", "bolts", "energy", "supports"):
        assert [step[key] for step in resumed["steps"]] == [step[key] for step in whole["steps"]]
