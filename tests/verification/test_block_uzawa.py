"""The yardstick: the assembled block system gives the answers of the condensed methods on the ready scenes."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from shared.cases import often
from stickslip.geometry.errors import SceneError
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.plan import make_plan
from stickslip.workflows.lab.verification.cases.agreement import Answer
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import READY, read

BALLS = {"half_ball", "spheres"}  # of order 1: those of order 2 take half a minute
STEPS = 4  # at most, beside the times that a scene lists
TOLERANCE = 1e-13  # of the residual
AGREEMENT = 1e-8  # of u in the energy norm, and of the tractions of all rows
HELD_BY_CONTACT = {
    *("arch", "dam", "hysteresis", "lap_joint", "rotor", "rubber_mount"),
    *("shrink_fit", "sledge", "spruce", "stack", "strip"),
}
DRIVEN = {"half_space", "sphere"}  # obstacles that forces move
SOLVED = sorted({path.stem for path in READY.glob("*.toml")} - HELD_BY_CONTACT - DRIVEN)
QUICK = {"block", "foundation", "sliding", "spheres"}


def by(method: str, name: str, **keys: Any) -> Scene:
    scene = read(name, ["geometry.order=1"] if name in BALLS else [])
    scene = replace(scene, steps=replace(scene.steps, count=min(scene.steps.count, STEPS)))
    return replace(scene, solver=replace(scene.solver, method=method, tolerance=TOLERANCE, **keys))


def answer(scene: Scene) -> Answer:
    simulation = prepare(scene)
    return Answer(simulation, tuple(simulation.steps()))


def off(name: str, **keys: Any) -> tuple[float, float]:
    """Largest difference from condensed-newton: of u in the energy norm, and of tractions; both relative."""
    found, expected = answer(by("block-uzawa", name, **keys)), answer(by("condensed-newton", name))
    pairs = zip(found.steps, expected.steps, strict=True)
    tractions = max(np.abs(mine.p - theirs.p).max() / np.abs(theirs.p).max() for mine, theirs in pairs)
    return max(found.energy_norm(expected)), float(tractions)


@pytest.mark.parametrize("name", [pytest.param(n, marks=[] if n in QUICK else pytest.mark.slow) for n in SOLVED])
def test_ready_scenes_have_the_answer_of_the_condensed_methods(name: str) -> None:
    assert max(off(name)) < AGREEMENT


@pytest.mark.parametrize("name", often(SOLVED, sorted(QUICK)[::2]))
def test_newton_on_the_nest_has_it_too(name: str) -> None:
    assert max(off(name, outer="ksp")) < AGREEMENT


@pytest.mark.parametrize("name", sorted(HELD_BY_CONTACT | DRIVEN))
def test_what_it_cannot_solve_is_refused_in_one_line(name: str) -> None:
    with pytest.raises(SceneError, match="use condensed-newton") as refused:
        make_plan(by("block-uzawa", name))
    assert "\n" not in str(refused.value)
