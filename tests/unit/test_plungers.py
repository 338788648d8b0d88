"""Spring plungers: a closed form with and without touch, stated errors, refusals, and where their force is shown."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import stickslip
from shared.audited import audit
from shared.command import result
from stickslip.geometry.errors import SceneError
from stickslip.solvers.results.step_result import Quantity
from stickslip.workflows.formats.csv_tables import read_steps_table
from stickslip.workflows.formats.results import read_results
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.pictures.report_compare import compare
from stickslip.workflows.pictures.report_page import page
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import from_dict

E, LENGTH, K, GROUND = 1000.0, 2.0, 250.0, 500.0
PRELOAD, PUSH = [[0.0, 0.0], [0.5, 3.0]], [[0.0, 0.0], [1.0, -4.0], [2.0, 10.0]]
STOP = {"boundary": "block.left", "direction": [2.0, 0.0], "stiffness": K, "preload": PRELOAD}


def scene(model: str = "plane strain", nu: float = 0.0, size: float = 0.5, **stop: Any) -> stickslip.Scene:
    """A bar on rollers between a plunger, whose side a traction pushes and pulls, and a spring to the ground."""
    deep = {"3d": {"width": 1.0}}.get(model, {})
    zero = [0.0] * (2 if model == "3d" else 1)
    return from_dict(
        {
            "model": model,
            "geometry": {"builder": "block", "length": LENGTH, "height": 1.0, "mesh_size": size} | deep,
            "bodies": {"block": {"E": E, "nu": nu}},
            "supports": {
                "base": {"boundary": "block.bottom", "displacement": {"z" if deep else "y": 0.0}},
                **({"side": {"boundary": "block.front", "displacement": {"y": 0.0}}} if deep else {}),
            },
            "springs": {"ground": {"at": "block.right", "stiffness": [GROUND, *zero]}},
            "loads": {"push": {"boundary": "block.left", "traction": [PUSH, *zero]}},
            "plungers": {"stop": STOP | {"direction": [2.0, *zero]} | stop},
            "steps": {"end": 2.0, "count": 4},
        }
    )


@pytest.mark.parametrize("model", ["plane strain", "3d"])
def test_a_plunger_pushes_with_its_preload_and_lets_go(model: str) -> None:
    """With the bar's stiffness E / L = GROUND the right end moves by (F + t) / GROUND, the left one by twice that."""
    simulation = prepare(scene(model))
    for step in simulation.steps():
        preload, push = (np.interp(step.time, *np.transpose(table)) for table in (PRELOAD, PUSH))
        touching = preload - 2 * K * (preload + push) / (GROUND + 2 * K)
        assert_allclose(step.plungers["stop"].force, max(touching, 0.0), atol=1e-10)
        assert_allclose(-step.springs["ground"].force[0], max(touching, 0.0) + push, atol=1e-10)
        assert max(audit(simulation, step).values()) < 1e-9
    assert touching < -1.0


def test_a_negative_preload_is_a_gap() -> None:
    *_, last = prepare(scene(preload=-0.5)).steps()
    assert last.plungers["stop"].force == pytest.approx(0.0, abs=1e-12)
    load = {"push": stickslip.Load(boundary="block.left", traction=(-4.0, 0.0))}
    *_, last = prepare(replace(scene(preload=-0.5), loads=load)).steps()
    moved = (-0.5 - 4.0) / (GROUND + 2 * K)
    assert last.plungers["stop"].force == pytest.approx(-0.5 - 2 * K * moved, rel=1e-9)


def rubbing(size: float) -> stickslip.Scene:
    """The bar lies on a floor, pressed on it, and the plunger pushes it against friction that holds most of it."""
    floor = stickslip.Plane(point=(0.0, 0.0), normal=(0.0, 1.0))
    base = stickslip.Contact(surface="block.bottom", against="floor", friction=stickslip.Coulomb(mu=2.0))
    loads = {"top": stickslip.Load(boundary="block.top", pressure=4.0)}
    found = replace(scene(nu=0.3, size=size, preload=5.0), obstacles={"floor": floor}, loads=loads, supports={})
    return replace(found, contacts={"base": base}, steps=stickslip.Steps(end=1.0, count=1))


def test_its_stated_error_holds() -> None:
    """Against a mesh four times as fine."""
    simulation, fine = (stickslip.prepare(rubbing(size)) for size in (0.25, 0.0625))
    (coarse,), (finer,) = simulation.steps(), fine.steps()
    parts = simulation.errors([coarse])[0][Quantity("plungers", "stop", "force")]
    off = abs(coarse.plungers["stop"].force - finer.plungers["stop"].force)
    assert parts.mesh is not None
    assert 1e-4 * coarse.plungers["stop"].force < off <= parts.mesh < 5 * off  # type: ignore[operator]


def test_its_force_is_a_goal_and_stands_in_every_output(tmp_path: Path) -> None:
    found = rubbing(0.5)
    assert "plunger.stop.force" in found.quantities()
    run(found, tmp_path / "out")
    (step,), columns = result(tmp_path / "out")["steps"], read_steps_table(tmp_path / "out")
    plunger = step["plungers"]["stop"]
    assert plunger["error"]["force"]["total"] > 0
    assert columns["plunger.stop.force"] == [plunger["force"]]
    assert columns["plunger.stop.force.error"] == [plunger["error"]["force"]["total"]]
    assert result(tmp_path / "out")["units"]["plungers.force"] == "N/m"
    (loaded,) = stickslip.load(tmp_path / "out").steps
    assert loaded.plungers["stop"].force == plunger["force"]
    read = read_results(tmp_path / "out")
    assert "plunger stop: push [N/m]" in [row[0] for table in compare(read, read) for row in table.rows]
    assert "plunger stop" in page(read)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"boundary": "block.lft"}, r"plungers\.stop\.boundary = block\.lft: no such side; did you mean"),
        ({"direction": [1.0]}, r"plungers\.stop\.direction = \[1\.0\]: expected 2 components"),
        ({"direction": [0.0, 0.0]}, r"plungers\.stop\.direction = .*must not be zero"),
        ({"stiffness": 0.0}, r"plungers\.stop\.stiffness = 0\.0: must be positive, in N/m"),
    ],
)
def test_wrong_plungers_are_refused(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene(**keys)
