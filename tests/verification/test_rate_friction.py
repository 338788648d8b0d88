"""Friction by slip rate: blocks that slide at a given speed, or under a given force, against mu(V) N."""

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import stickslip
from shared.audited import record_of
from shared.problems import on_floor
from stickslip import SLIP, STICK, Quantity, Scene, SceneError, Simulation
from stickslip.solvers.results.audit import Auditor
from stickslip.solvers.simulation.plan import make_plan
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

TABLE = [[0.0, 0.2], [0.05, 0.3], [0.2, 0.7]]
FORMULA = "0.2 + 0.1*log(1 + V/0.01)"
MU = {
    "table": (TABLE, lambda V: np.interp(V, *np.array(TABLE).T)),
    "expression": (FORMULA, lambda V: 0.2 + 0.1 * np.log(1 + V / 0.01)),
}
LENGTH, PRESS = 2.0, 0.2


def scene(
    mu: Any, count: int, drag: list[list[float]] | None = None, dim: int = 2, E: float = 1e6, **tables: Any
) -> Scene:
    """A block, pressed in one second onto a plane, then drawn along by its top.

    Args:
        mu: of the base, by slip rate.
        count: steps in each of two seconds.
        drag: motion of the top in time; None: no support at all.
    """
    friction = {"law": "rate_dependent", "mu": mu} | tables.pop("friction", {})
    top = {"boundary": "block.top", "displacement": {"x": drag} | ({"y": 0.0} if dim == 3 else {})}
    whole = {
        "supports": {"top": top} if drag else {},
        "loads": {"press": {"boundary": "block.top", "pressure": [[0.0, 0.0], [1.0, PRESS], [2.0, PRESS]]}},
        "steps": {"end": 2.0, "count": 2 * count, "seconds": True},
        "solver": {"tolerance": 1e-11},
    }
    base, sizes = {"friction": friction} | tables.pop("base", {}), {"length": LENGTH, "height": 0.25, "mesh_size": 0.25}
    return from_dict(on_floor(dim, sizes, {"E": E, "nu": 0.0}, base, **whole | tables))


def drawn(speed: float) -> list[list[float]]:
    """At rest for a second, then at a speed [m/s]."""
    return [[0.0, 0.0], [1.0, 0.0], [2.0, speed]]


def solved(data: Scene) -> tuple[Simulation, list[stickslip.StepResult]]:
    simulation = prepare(data)
    return simulation, list(simulation.steps())


@pytest.mark.parametrize("count", [1, 2, 10])
@pytest.mark.parametrize("speed", [0.02, 0.1, 0.4])
@pytest.mark.parametrize("name", MU)
def test_a_block_at_a_given_speed_bears_mu_of_it_whatever_the_step(name: str, speed: float, count: int) -> None:
    """E is so large that shear takes up 1e-6 of the way; mu of another speed would differ by 10 % and more."""
    mu, at = MU[name]
    _, steps = solved(scene(mu, count, drawn(speed)))
    base = steps[-1].contacts["base"]
    assert_allclose(base.normal_force, PRESS * LENGTH, rtol=1e-8)
    assert_allclose(base.tangential_force, at(speed) * PRESS * LENGTH, rtol=1e-5)
    assert_allclose(steps[-1].memory["base"], speed, rtol=1e-5)
    assert_allclose(base.dissipation, at(speed) * PRESS * LENGTH * speed / count, rtol=1e-5)
    assert steps[count - 1].contacts["base"].tangential_force < 1e-10


@pytest.mark.parametrize("k_T", [None, 1e7])
def test_radiation_is_added_to_friction(k_T: float | None) -> None:
    """eta V beside mu(V) p, where it presses; what it takes is dissipated."""
    eta, speed = 0.3, 0.1
    friction = {"damping": eta} | ({} if k_T is None else {"k_T": k_T})
    simulation, steps = solved(scene(TABLE, 2, drawn(speed), friction=friction))
    base, force = steps[-1].contacts["base"], (MU["table"][1](speed) * PRESS + eta * speed) * LENGTH
    assert_allclose(base.tangential_force, force, rtol=1e-5)
    assert_allclose(base.dissipation, force * speed / 2, rtol=1e-5)
    records = [record_of(step) for step in steps]
    audits = [
        Auditor(simulation.problem, simulation.mesh)(r, b) for r, b in zip(records, [None, *records], strict=False)
    ]
    assert max(max(asdict(each).values()) for each in audits) < 1e-8


@pytest.mark.parametrize("method", ["condensed-newton", "surface-uzawa"])
@pytest.mark.parametrize("count", [2, 7])
def test_a_block_that_a_force_pulls_slides_at_the_speed_at_which_friction_bears_it(count: int, method: str) -> None:
    """Nothing else holds it: mu(V) N = T has one solution V, which no Coulomb problem has."""
    force = 0.3 * PRESS
    pull = {"boundary": "block.bottom", "traction": [[[0.0, 0.0], [1.0, 0.0], [1.5, force], [2.0, force]], 0.0]}
    press = {"boundary": "block.top", "pressure": [[0.0, 0.0], [1.0, PRESS], [2.0, PRESS]]}
    tables = {"loads": {"press": press, "pull": pull}, "solver": {"method": method, "tolerance": 1e-11}}
    _, steps = solved(scene([[0.0, 0.2], [0.1, 0.4]], count, E=1.0, **tables))
    assert_allclose(steps[-1].memory["base"], 0.05, rtol=1e-8)
    assert_allclose(steps[-1].contacts["base"].slip_increment[:, 0], 0.05 / count, rtol=1e-8)
    assert_allclose(steps[-1].contacts["base"].tangential_force, force * LENGTH, rtol=1e-9)
    more = {"loads": tables["loads"] | {"pull": pull | {"traction": [0.5 * PRESS, 0.0]}}}
    with pytest.raises(stickslip.NoEquilibriumError, match=r"cannot balance the loads: bodies\.block moves along x"):
        solved(scene([[0.0, 0.2], [0.1, 0.4]], count, E=1.0, **more))


@pytest.mark.parametrize(
    ("dim", "tables"),
    [
        (2, {}),
        (3, {}),
        (2, {"friction": {"k_T": 5.0}}),
        (2, {"base": {"normal": {"law": "compliance", "c_n": 20.0, "m_n": 2.0}}}),
        (2, {"friction": {"mu": FORMULA}, "base": {"normal": {"law": "bilateral"}}}),
        (2, {"base": {"sliding": True}}),
    ],
)
def test_bent_by_the_drag_a_part_sticks_and_the_audit_agrees(dim: int, tables: dict[str, Any]) -> None:
    simulation, steps = solved(scene(TABLE, 5, drawn(0.025), dim, E=1.0, **tables))
    audit, both = Auditor(simulation.problem, simulation.mesh), False
    records = [record_of(step) for step in steps]
    for before, record, step in zip([None, *records], records, steps, strict=False):
        found = audit(record, before if step.substeps == 1 else None)
        assert max(asdict(found).values()) < 1e-9
        assert not audit.shared
        status = step.contacts["base"].status
        both = both or bool(np.any(status == SLIP) and np.any(status == STICK))
    assert both or dim == 3 or tables
    slower = replace(records[-1], memory={"base": 0.5 * records[-1].memory["base"]})
    assert audit(slower).cone > 1e-3
    if "sliding" not in str(tables):  # of these slip is not followed
        faster = replace(records[-1], memory={"base": 1.5 * records[-1].memory["base"]})
        assert audit(faster, records[-2]).fields > 1e-3


def test_it_is_combined_with_a_law_that_remembers_slip() -> None:
    """Two blocks on each other: one contact by the slip rate, one by slip, each solved in its own way."""
    by_slip = {"law": "static_kinetic", "mu_s": 0.45, "mu_k": 0.2, "slip_length": 0.2}
    rubs = {"surface": "upper.bottom", "against": "lower.top", "friction": {"law": "rate_dependent", "mu": TABLE}}
    data = {
        "model": "plane strain",
        "geometry": {"builder": "two_blocks", "length": 1.0, "height": 0.5, "mesh_size": 0.25, "lower_mesh_size": 0.25},
        "bodies": {"upper": {"E": 1e6, "nu": 0.0}, "lower": {"E": 1e6, "nu": 0.0}},
        "obstacles": {"floor": {"shape": "plane", "point": [0.0, -0.5], "normal": [0.0, 1.0]}},
        "contacts": {"joint": rubs, "base": {"surface": "lower.bottom", "against": "floor", "friction": by_slip}},
        "supports": {"top": {"boundary": "upper.top", "displacement": {"x": drawn(0.2)}}},
        "loads": {"press": {"boundary": "upper.top", "pressure": [[0.0, 0.0], [1.0, PRESS], [2.0, PRESS]]}},
        "steps": {"end": 2.0, "count": 8, "seconds": True},
        "solver": {"tolerance": 1e-11},
    }
    _, steps = solved(from_dict(data))
    joint, base = steps[-1].contacts["joint"], steps[-1].contacts["base"]
    assert_allclose(joint.tangential_force, base.tangential_force, rtol=1e-9)
    V, slid = steps[-1].memory["joint"].max(), steps[-1].memory["base"].max()
    assert_allclose(joint.tangential_force / joint.normal_force, MU["table"][1](V), rtol=1e-4)
    assert_allclose(base.tangential_force / base.normal_force, 0.45 - 0.25 * slid / 0.2, rtol=0.05)
    below = slid - steps[-2].memory["base"].max()
    assert min(V, below) > 0.01
    assert_allclose(V + below / 0.25, 0.2, rtol=0.05)


@pytest.mark.slow
def test_errors_of_the_time_steps_are_of_the_size_of_the_true_ones() -> None:
    """The drag gets faster and faster: a step has the mean of its speeds."""
    path = [[t, 0.1 * max(t - 1.0, 0.0) ** 2] for t in np.linspace(0.0, 2.0, 41)]
    (simulation, steps), (_, fine) = (solved(scene(TABLE, n, path, E=1.0)) for n in (20, 160))
    found = simulation.time_step_errors(steps)[-1]
    for key, of in (("tangential_force", "tangential_force"), ("dissipation_total", "dissipation_total")):
        true = abs(getattr(steps[-1].contacts["base"], of) - getattr(fine[-1].contacts["base"], of))
        assert true < 3 * found[Quantity("contacts", "base", key)].time_step


def test_errors_of_the_mesh_are_of_the_size_of_the_true_ones() -> None:
    data = scene(TABLE, 2, drawn(0.2), E=1.0)
    simulation = stickslip.prepare(data)
    *_, step = steps = list(simulation.steps())
    *_, errors = simulation.errors(steps)
    *_, fine = prepare(replace(data, geometry=replace(data.geometry, mesh_size=0.02))).steps()
    base, better = step.contacts["base"], fine.contacts["base"]
    true = abs(base.tangential_force - better.tangential_force)
    assert 0.3 * true < errors[Quantity("contacts", "base", "tangential_force")].mesh < 3 * true


def test_plan_says_what_is_added_and_a_script_keeps_seconds() -> None:
    data = scene(TABLE, 2, drawn(0.2))
    (row,) = (row for row in make_plan(data) if row.effect == "friction")
    assert "rate_dependent: 1 row a point, with mu of its slip rate" in row.adds
    script = stickslip.prepare(data).script()
    script.step(to=1.0)
    assert script.scene.steps.seconds
    with pytest.raises(SceneError, match=r"contacts\.base\.mu: nothing there to change"):
        script.step(to=2.0, contacts={"base": {"mu": 0.3}})
