"""Springs that act in one way: closed forms, the law at many of them, what they hold, and what is left when they go."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import stickslip
from shared.audited import audit
from shared.failures import failures
from shared.problems import on_floor
from stickslip import Quantity, Simulation, StepError, StepResult
from stickslip.geometry.arrays import Array
from stickslip.workflows.lab.verification.cases import springs as case
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

Data = dict[str, Any]
PAGE = Path(__file__).resolve().parents[2] / "docs/howto/one_sided.md"
BUMPER, BED = (tomllib.loads(text) for text in re.findall(r"^```toml\n(.*?)^```$", PAGE.read_text(), re.M | re.S))
SOLVERS = [("auto", "auto"), ("uzawa", "auto"), ("surface-uzawa", "matrix-free")]


def solved(
    data: Data, method: str = "auto", surface: str = "auto", order: int = 1
) -> tuple[Simulation, list[StepResult]]:
    solver = {"method": method, "surface": surface, "tolerance": 1e-11}
    geometry = data["geometry"] | {"order": order}
    simulation = prepare(from_dict(data | {"geometry": geometry, "solver": solver}))
    return simulation, list(simulation.steps())


# --- closed forms


@pytest.mark.parametrize("name", ["GAP", "K"])
def test_checks_notice_another_gap_or_stiffness(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = case.scene
    monkeypatch.setattr(case, "scene", lambda springs, *args, **tables: scene(_scaled(springs, name), *args, **tables))
    assert len(failures(case.one_way("plane strain", "tension", "condensed-newton"))) >= 3


def _scaled(springs: Data, name: str) -> Data:
    key = {"GAP": "gap", "K": "stiffness"}[name]
    return springs | {"s": springs["s"] | {key: 1.001 * springs["s"][key]}}


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(("method", "surface"), SOLVERS)
def test_bed_of_the_page_and_its_bumper_are_the_same(method: str, surface: str, order: int) -> None:
    (_, bumper), (_, bed) = solved(BUMPER, order=order), solved(BED, method, surface, order)
    forces = [
        (-step.springs["bumper"].force[1], other.contacts["bed"].normal_force)
        for step, other in zip(bumper, bed, strict=True)
    ]
    assert_allclose(*np.transpose(forces), rtol=1e-9, atol=1e-9)
    assert [force > 1.0 for force, _ in forces] == [True, True, True, False, False, False]


# --- many, beside contact with friction

LAW = {"law": "coulomb", "mu": 0.4}


def cluster(seed: int, count: int) -> Data:
    """A block on soft springs and a floor, and springs of one way at its vertices, in all directions."""
    random = np.random.default_rng(seed)
    at = [[x, y] for x in (0.0, 0.5, 1.0, 1.5, 2.0) for y in (0.5, 1.0) if x in (0.0, 2.0) or y == 1.0]
    angles = random.uniform(0.0, 2 * np.pi, count)
    some: Data = {
        f"s{i}": {
            "at": at[random.integers(len(at))],
            "stiffness": float(10 ** random.uniform(0, 3)),
            "direction": [float(np.cos(angle)), float(np.sin(angle))],
            "acts": str(random.choice(["tension", "compression"])),
            "gap": float(random.choice([0.0, 0.002])),
        }
        for i, angle in enumerate(angles)
    }
    more: Data = {
        "springs": some | {"base": {"at": "block.left", "stiffness": [30.0, 30.0]}},
        "loads": {"push": {"boundary": "block.right", "force": {
            "x": [[1.0, 5.0], [2.0, -5.0], [3.0, 1.0]], "y": [[1.0, -4.0], [2.0, 6.0], [3.0, -9.0]],
        }}},
        "steps": {"end": 3.0, "count": 3},
    }  # fmt: skip
    return on_floor(2, {"mesh_size": 0.25}, {"E": 1000.0}, {"friction": LAW}, **more)


def law_of(data: Data, simulation: Simulation, step: StepResult) -> tuple[Array, Array]:
    """Forces by the displacement of their vertices, and those that were found [N]."""
    forces = []
    for name, spring in data["springs"].items():
        if name == "base":
            continue
        node = np.argmin(np.linalg.norm(simulation.data.points - spring["at"], axis=1))
        way = np.array(spring["direction"]) * (1.0 if spring["acts"] == "tension" else -1.0)
        far = max(float(step.displacement[node] @ way) - spring["gap"], 0.0)
        forces.append((spring["stiffness"] * far, float(-step.springs[name].force @ way)))
    return np.array(forces)[:, 0], np.array(forces)[:, 1]


@pytest.mark.parametrize(("seed", "count"), [(1, 1), (2, 4), (5, 8), (6, 20)])
def test_every_spring_obeys_its_law_beside_contact_with_friction(seed: int, count: int) -> None:
    data = cluster(seed, count)
    simulation, steps = solved(data)
    acting = 0
    for step in steps:
        law, found = law_of(data, simulation, step)
        assert_allclose(found, law, atol=1e-5 * max(law.max(), 1.0))
        assert_allclose(step.energy.external, step.energy.stored + step.energy.contact, atol=1e-9)
        acting += np.count_nonzero(law)
    assert acting > 0
    assert acting < 3 * count or count == 1


def test_a_spring_that_never_changes_costs_no_solution() -> None:
    cable = {"at": "block.right", "stiffness": 100.0, "direction": [1.0, 0.0], "acts": "tension"}
    data = {k: v for k, v in cluster(0, 0).items() if k not in ("contacts", "obstacles")}
    data["springs"] = {"base": {"at": "block.left", "stiffness": [30.0, 30.0]}, "cable": cable}
    data["supports"] = {"foot": {"boundary": "block.bottom", "displacement": {"y": 0.0}}}
    data["loads"] = {"pull": {"boundary": "block.right", "force": {"x": [[1.0, 5.0], [2.0, 9.0]]}}}
    _, taut = solved(data)
    linear = {k: v for k, v in cable.items() if k != "acts"}
    _, both = solved(data | {"springs": data["springs"] | {"cable": linear}})
    assert [step.volume_solves for step in taut] == [step.volume_solves for step in both]
    for one, other in zip(taut, both, strict=True):
        assert_array_equal(one.displacement, other.displacement)


# --- what is left without them


def test_a_load_that_hangs_on_a_cable_is_set_down() -> None:
    data = cluster(0, 0)
    data["steps"] = {"end": 2.0, "count": 2}
    data["springs"] = {"cable": {"at": "block.top", "stiffness": 100.0, "direction": [0.0, -1.0], "acts": "tension"}}
    data["supports"] = {"guide": {"boundary": "block.left", "displacement": {"x": 0.0}}}
    data["contacts"]["base"] |= {"gap_offset": 0.05}  # reached under 5 N
    data["contacts"]["base"].pop("friction")
    data["bodies"]["block"]["nu"] = 0.0
    data["loads"] = {"weight": {"boundary": "block.top", "force": {"y": [[1.0, -4.0], [2.0, -9.0]]}}}
    _, (hangs, stands) = solved(data)
    assert_allclose([hangs.springs["cable"].force[1], hangs.contacts["base"].normal_force], [4.0, 0.0], atol=1e-8)
    total = stands.springs["cable"].force[1] + stands.contacts["base"].normal_force
    assert_allclose(total, 9.0, rtol=1e-9)
    assert stands.springs["cable"].force[1] > 5.0


def test_a_body_falls_through_the_slack_of_a_cable_until_the_floor_holds_it() -> None:
    data = cluster(0, 0)
    data["springs"] = {"cable": {"at": "block.top", "stiffness": 100.0, "direction": [0.0, 1.0], "acts": "tension"}}
    data["supports"] = {"guide": {"boundary": "block.left", "displacement": {"x": 0.0}}}
    data["contacts"]["base"] |= {"gap_offset": 0.05}
    data["loads"] = {"weight": {"boundary": "block.top", "force": {"y": [[1.0, -4.0], [2.0, -9.0]]}}}
    data["steps"] = {"end": 2.0, "count": 2}
    for step, weight in zip(solved(data)[1], (4.0, 9.0), strict=True):
        assert_allclose(step.contacts["base"].normal_force, weight, rtol=1e-6)
        assert_allclose(step.springs["cable"].force, 0.0, atol=1e-6)
        assert step.shortened[0] > 0.05


def test_a_body_that_nothing_but_slack_cables_could_hold_ends_the_run() -> None:
    data = {k: v for k, v in cluster(0, 0).items() if k not in ("contacts", "obstacles")}
    data["springs"] = {"cable": {"at": "block.top", "stiffness": 100.0, "direction": [0.0, -1.0], "acts": "tension"}}
    data["supports"] = {"guide": {"boundary": "block.left", "displacement": {"x": 0.0}}}
    data["loads"] = {"lift": {"boundary": "block.top", "force": [0.0, 4.0]}}
    with pytest.raises(StepError, match=r"springs\.cable: no slack was found .* nothing else holds the bodies there"):
        solved(data)


# --- errors and audit


def dragged(size: float) -> tuple[Simulation, list[StepResult]]:
    """A block that is pressed on a floor and dragged against one spring, away from another one; with errors."""
    data = cluster(0, 0)
    data["geometry"]["mesh_size"] = size
    data["springs"] = {
        "base": {"at": "block.left", "stiffness": [300.0, 20.0]},
        "stop": {"at": "block.right", "stiffness": 500.0, "direction": [-1.0, 0.5], "acts": "compression"},
        "slack": {"at": "block.top", "stiffness": 500.0, "direction": [-1.0, 0.5], "acts": "tension"},
    }
    data["loads"] = {
        "top": {"boundary": "block.top", "pressure": 20.0},
        "push": {"boundary": "block.left", "force": [30.0, 0.0]},
    }
    data["steps"] = {"end": 1.0, "count": 1}
    simulation = stickslip.prepare(from_dict(data))
    return simulation, list(simulation.steps())


def test_stated_errors_hold_where_a_spring_acts_and_are_zero_where_it_does_not() -> None:
    (simulation, steps), (_, (fine,)) = dragged(0.25), dragged(0.0625)
    errors, (coarse,) = simulation.errors(steps)[-1], steps
    for name in ("base", "stop", "slack"):
        parts = errors[Quantity("springs", name, "force")]
        off = np.abs(coarse.springs[name].force - fine.springs[name].force)
        assert np.all(off <= parts.mesh + 1e-9)
        assert np.all(parts.mesh <= 5 * off + 1e-9)
    assert np.linalg.norm(coarse.springs["stop"].force) > 1.0
    assert np.linalg.norm(coarse.springs["slack"].force) < 1e-9


@pytest.mark.parametrize("which", [0, 1])
def test_audit_notices_another_slack(which: int) -> None:
    simulation, (step,) = dragged(0.25)
    assert max(audit(simulation, step).values()) < 1e-9
    wrong = step.shortened.copy()
    wrong[which] += 1e-4
    assert audit(simulation, replace(step, shortened=wrong))["equilibrium"] > 1e-5
