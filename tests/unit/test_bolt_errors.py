"""Errors of bolted joints: while a bolt is tightened to a force, and once it is held at its length."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_allclose

from shared.histories import Stop
from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.solvers.accuracy import two_level
from stickslip.solvers.accuracy.bubbles import Bubbles
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.results.step_result import StepResult, quantities
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.simulation.simulation import Simulation, prepare
from stickslip.solvers.system.system import assemble
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import from_dict, read

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
    data = {
        "model": model,
        "geometry": BLOCKS | ({"width": 0.5, "mesh_size": 0.5} if solid else {"mesh_size": 0.25}),
        "bodies": {"upper": {"E": 1000.0, "nu": 0.3}, "lower": {"E": 1000.0, "nu": 0.3}},
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
    return from_dict(data | tables)


def stated(step: StepResult, key: str) -> Any:
    """Error of the mesh of a number, the part of the geometry included."""
    parts = step.errors[key]
    assert parts.mesh is not None
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
    tightened, held = prepare(jack(), MPI.COMM_SELF).steps()
    fine = prepare(jack(**FINE), MPI.COMM_SELF)
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
        assert simulation.reported is not None
        state = simulation.reported.state.refined
        assert state is not None
        found.append((-state.initial_work[0], state.initial[0]))
    return found


def test_a_bolt_with_bubbles_is_held_at_a_length_of_its_own() -> None:
    """Softer bodies take more shortening for the same tension; from there on it stays."""
    simulation = prepare(jack(steps={"end": 2.0, "count": 4}), MPI.COMM_SELF)
    half, whole, *held = refined(simulation)
    assert_allclose([half[0], whole[0]], [-FORCE / 2, -FORCE], rtol=1e-5)
    assert [length for _, length in held] == [whole[1]] * 2
    assert simulation.reported is not None
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
    simulation = prepare(jack(bolts=beside, **free), MPI.COMM_SELF)
    tightened, both = simulation.steps()
    assert [step.errors["bolts.c.tension"].mesh for step in (tightened, both)] == pytest.approx([0, 0], abs=1e-5)
    assert tightened.errors["bolts.b.tension"].mesh == pytest.approx(0, abs=1e-5)
    assert 1e-5 < stated(both, "bolts.b.tension") < 0.1


def test_energy_of_a_bolt_with_bubbles_is_in_balance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of its shortening alone is work done: its forces on bubbles are inner ones."""
    monkeypatch.setattr(two_level, "STEPS", 25)
    simulation = prepare(jack(), MPI.COMM_SELF)
    next(simulation.steps())
    assert simulation.reported is not None
    state = simulation.reported.state.refined
    assert state is not None
    energy = state.energy
    assert energy.external - energy.contact == pytest.approx(energy.stored, rel=1e-4)


def test_the_stress_of_a_shank_is_corrected() -> None:
    """With bubbles it is shortened by another length, which is no stress."""
    probes = {"shank": {"point": [0.9, 0.45]}}
    step, _ = prepare(jack(probes=probes), MPI.COMM_SELF).steps()
    exact, _ = prepare(jack(probes=probes, **FINE), MPI.COMM_SELF).steps()
    stress = exact.probes["shank"].stress[1, 1]
    assert step.corrected["probes.shank.stress"][1] == pytest.approx(stress, rel=0.01)


@pytest.mark.parametrize("model", ["plane strain", "3d"])
def test_a_shank_that_ends_within_a_body_is_no_error_of_the_mesh(model: str) -> None:
    """A column between walls, whose stress is uniform: that of the shank's shortening jumps at its ends."""
    up, free = ("z", {"left": "x", "front": "y"}) if model == "3d" else ("y", {"left": "x"})
    held = {f"{body}_{side}": (f"{body}.{side}", axis) for body in ("upper", "lower") for side, axis in free.items()}
    held |= {"roof": ("upper.top", up), "floor": ("lower.bottom", up)}
    supports = {name: {"boundary": side, "displacement": {axis: 0.0}} for name, (side, axis) in held.items()}
    tied = {"joint": {"surface": "upper.bottom", "against": "lower.top", "normal": {"law": "tied"}}}
    simulation = prepare(jack(model, supports=supports, contacts=tied), MPI.COMM_SELF)
    step, _ = simulation.steps()
    assert step.mesh_error < 1e-7
    assert_allclose(step.stress_error, 0.0, atol=1e-7 * FORCE)
    assert stated(step, "contacts.joint.normal_force") < 1e-7 * FORCE


def test_iterative_volume_solves_follow_the_force() -> None:
    sets = ["geometry.mesh_size=0.005", "solver.surface=matrix-free", "solver.method=surface-uzawa", "steps.count=2"]
    tightened, held = prepare(read("lap_joint", sets), MPI.COMM_SELF).steps()
    direct = [*prepare(read("lap_joint", [sets[0], sets[3]]), MPI.COMM_SELF).steps()][1]
    assert stated(tightened, "bolts.bolt.tension") < 10.0  # of 3e6 N
    assert 0.5 < stated(held, "bolts.bolt.tension") / stated(direct, "bolts.bolt.tension") < 2


def test_a_resumed_run_states_the_same_errors_to_the_last_bit(tmp_path: Path) -> None:
    scene = jack(steps={"end": 2.0, "count": 4}, output={"pictures": False})
    _, whole = run(scene, tmp_path / "whole")
    outcome, _ = run(scene, tmp_path / "out", Watch(on_step=Stop(3)))
    assert outcome.status == "interrupted"
    _, resumed = run(scene, tmp_path / "out", resume=True)
    for key in ("contacts", "bolts", "energy", "supports"):
        assert [step[key] for step in resumed["steps"]] == [step[key] for step in whole["steps"]]
