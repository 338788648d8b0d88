"""A block between two platens that press with 100 N holds a weight of up to 2 mu N = 60 N by friction, and no more."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_allclose

from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Output
from stickslip.solvers.stepping.stepper import NoEquilibriumError, StepError
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import from_dict

PRESS, MU = 100.0, 0.3
LIMIT = 2 * MU * PRESS
FRICTION = {"law": "coulomb", "mu": MU}
STEPS = {"end": 2.0, "count": 2}  # squeezed from t = 0 on; the weight comes between 1 and 2


def weighing(weight: float) -> list[list[float]]:
    return [[0.0, 0.0], [1.0, 0.0], [2.0, weight]]


def model_of(dim: int) -> str:
    return "plane strain" if dim == 2 else "3d"


def between_planes(dim: int, weight: float, by: str) -> Scene:
    """A unit cube between rigid walls x = 0 and x = 1; the right one is pushed by a force, or as far as makes it."""
    E, across = 1e4, [0.0] * (dim - 1)
    push = {"force": -PRESS, "displacement": -PRESS / E}[by]  # nu = 0: the block's stiffness is E times 1 m
    walls: dict[str, Any] = {
        "left": {"shape": "plane", "point": [0.0, *across], "normal": [1.0, *across]},
        "right": {"shape": "plane", "point": [1.0, *across], "normal": [-1.0, *across]},
    }
    walls["right"][by] = {"x": [[0.0, push], [2.0, push]]}
    shape = {"builder": "block", "length": 1.0, "height": 1.0, "mesh_size": 0.25, "cells": "tensor"}
    return from_dict(
        {
            "model": model_of(dim),
            "geometry": shape | ({"width": 1.0} if dim == 3 else {}),
            "bodies": {"block": {"E": E, "nu": 0.3 if by == "force" else 0.0, "density": 1.0}},
            "obstacles": walls,
            "contacts": {s: {"surface": f"block.{s}", "against": s, "friction": FRICTION} for s in walls},
            "gravity": {"acceleration": [*across, weighing(-weight)]},
            "steps": STEPS,
        }
    )


def between_bodies(dim: int, weight: float, by: str) -> Scene:
    """The same between two elastic cubes with other meshes, lying: the weight pulls along x."""
    E, up, axes = 1e4, "xyz"[dim - 1], "xyz"[:dim]
    shape = {"builder": "stack", "count": 3, "length": 1.0, "height": 1.0, "mesh_size": 0.25, "mesh_ratio": 2 / 3}
    lid: dict[str, Any] = {axis: 0.0 for axis in axes[:-1]}
    data: dict[str, Any] = {
        "model": model_of(dim),
        "geometry": shape | {"cells": "tensor"} | ({"width": 1.0} if dim == 3 else {}),
        "bodies": {f"block_{k}": {"E": E, "nu": 0.0} | ({"density": 1.0} if k == 2 else {}) for k in (1, 2, 3)},
        "contacts": {
            "low": {"surface": "block_2.bottom", "against": "block_1.top", "friction": FRICTION},
            "high": {"surface": "block_2.top", "against": "block_3.bottom", "friction": FRICTION},
        },
        "gravity": {"acceleration": [weighing(weight), *[0.0] * (dim - 1)]},
        "steps": STEPS,
    }
    if by == "force":
        data["loads"] = {
            "press": {"boundary": "block_3.top", "traction": [*[0.0] * (dim - 1), [[0, -PRESS], [2, -PRESS]]]}
        }
    else:  # three cubes one behind the other
        lid[up] = [[0.0, -3 * PRESS / E], [2.0, -3 * PRESS / E]]
    base = {axis: 0.0 for axis in axes}
    data["supports"] = {
        "base": {"boundary": "block_1.bottom", "displacement": base},
        "lid": {"boundary": "block_3.top", "displacement": lid},
    }
    return from_dict(data)


def last(scene: Scene) -> StepResult:
    *_, step = prepare(scene).steps()
    return step


@pytest.mark.parametrize("by", ["force", "displacement"])
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("share", [0.5, 0.999])
def test_walls_carry_half_the_weight_each(dim: int, by: str, share: float) -> None:
    step = last(between_planes(dim, share * LIMIT, by))
    across = [0.0] * (dim - 2)
    for name, normal in (("left", PRESS), ("right", -PRESS)):
        force = step.contacts[name].force
        assert_allclose(force, [normal, *across, share * LIMIT / 2], rtol=1e-8, atol=1e-8 * PRESS)


@pytest.mark.parametrize("by", ["force", "displacement"])
@pytest.mark.parametrize("dim", [2, 3])
def test_elastic_platens_hold_as_much(dim: int, by: str) -> None:
    """How much each carries is theirs to share, unless both are held alike."""
    weight = 0.999 * LIMIT
    step = last(between_bodies(dim, weight, by))
    low, high = (step.contacts[name].force for name in ("low", "high"))
    assert_allclose([low[-1], high[-1]], [PRESS, -PRESS], rtol=1e-8)
    assert_allclose(low[0] + high[0], -weight, rtol=1e-8)
    assert max(abs(low[0]), abs(high[0])) <= MU * PRESS * (1 + 1e-8)
    if by == "displacement":
        assert_allclose([low[0], high[0]], -weight / 2, rtol=1e-8)


@pytest.mark.parametrize(("scene", "moves"), [(between_planes, "bodies.block moves along -{up}"),
                                              (between_bodies, "bodies.block_2 moves along x")])  # fmt: skip
@pytest.mark.parametrize("dim", [2, 3])
def test_more_weight_than_friction_can_hold_has_no_equilibrium(dim: int, scene: Any, moves: str) -> None:
    """All is well until the weight is 60 N; the last good substep lies within a halved step's reach of it."""
    reached: list[float] = []
    steps = prepare(scene(dim, 1.001 * LIMIT, "force")).steps()
    with pytest.raises(NoEquilibriumError, match=f"cannot balance the loads: {moves.format(up='xyz'[dim - 1])}"):
        reached.extend(step.time for step in steps)
    holds = 1 + 1 / 1.001
    assert reached[:2] == [0.0, 1.0]
    assert holds - 2 / 256 < reached[2] < holds


@pytest.mark.parametrize(
    ("scene", "method"),
    [
        (between_planes, "condensed-newton"),
        pytest.param(between_planes, "auto", marks=pytest.mark.slow),
        pytest.param(between_bodies, "auto", marks=pytest.mark.slow),
    ],
)
def test_what_only_elasticity_limits_is_not_called_solved(
    scene: Any, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Platens that are held where they are would press as hard as need be on rigid bodies: no proof, but no answer."""
    monkeypatch.setattr("stickslip.solvers.stepping.halving.HALVINGS", 1)
    found = scene(2, 1.001 * LIMIT, "displacement")
    steps = prepare(replace(found, solver=replace(found.solver, method=method))).steps()
    with pytest.raises(StepError, match="rigid bodies could rest under these loads") as caught:
        list(steps)
    assert not isinstance(caught.value, NoEquilibriumError)


def test_friction_is_what_holds() -> None:
    """Half the coefficient holds half the weight."""
    scene = between_planes(2, 0.999 * LIMIT, "force")
    weaker = {s: replace(contact, friction=Coulomb(mu=MU / 2)) for s, contact in scene.contacts.items()}
    with pytest.raises(NoEquilibriumError):
        list(prepare(replace(scene, contacts=weaker)).steps())


@pytest.mark.slow  # of the sentence above, and of the runs of test_limits
def test_run_ends_as_no_equilibrium_and_keeps_what_was_reached(tmp_path: Path) -> None:
    scene = replace(between_planes(2, 1.001 * LIMIT, "force"), output=Output(pictures=False))
    outcome, content = run(scene, tmp_path / "out")
    assert (outcome.status, outcome.exit_code, content["status"]) == ("no_equilibrium", 3, "no_equilibrium")
    assert "bodies.block moves along -y" in outcome.sentence
    assert [step["time"] for step in content["steps"][:2]] == [0.0, 1.0]
    assert len(content["steps"]) == len(list((tmp_path / "out" / "steps").iterdir())) == 3
    assert max(content["audit"].values()) <= 1e-8
