"""Goals on numbers that are as good as 0 are refused; numbers that are merely small are not."""

from dataclasses import replace
from typing import Any

import pytest

from shared.cases import every_nth
from stickslip.geometry.errors import SceneError
from stickslip.solvers.results.step_result import Errors, StepResult
from stickslip.solvers.simulation.simulation import prepare
from stickslip.workflows.accuracy.goals import standings
from stickslip.workflows.scene_file.read import read

SIZES = ["geometry.mesh_size=0.4", "geometry.contact_mesh_size=0.2"]
DOWN = "supports.top.displacement={x=0.0, y=[[0, 0], [1, -0.1]]}"


def solved(*words: str) -> tuple[StepResult, Errors]:
    """The last step of a block, and its errors."""
    simulation = prepare(read("block", [*SIZES, *words]))
    steps = list(simulation.steps())
    return steps[-1], simulation.errors(steps)[-1]


@pytest.mark.parametrize(
    ("name", "cells"),
    every_nth(
        2, ["base.tangential_force", "support.top.force.x", "obstacle.foundation.force.x"], ["tensor", "simplex"]
    ),
)
def test_what_rounding_or_a_mesh_without_symmetry_leaves_is_0(name: str, cells: str) -> None:
    """A block pressed straight down: no force acts sideways."""
    step, errors = solved(DOWN, f"geometry.cells={cells!r}")
    with pytest.raises(SceneError, match=rf"accuracy\.goals\.{name}: is 0 at the end \(.*e-.*counts as that\)"):
        standings({name: 0.01}, step, errors)
    assert standings({"base.normal_force": 0.01}, step, errors)


@pytest.mark.parametrize(
    ("small", "accepted"),
    [
        ({"max_penetration": 1e-7}, True),  # of a stiff surface, beside a displacement of .1
        ({"max_penetration": 1e-17}, False),
        ({"dissipation_total": 1e-6}, True),  # of partial slip, beside a stored energy of .01
        ({"normal_force": 1e-5}, True),  # of a contact that hardly bears, beside a force of .2
        ({"tangential_force": 1e-3}, True),
        ({"tangential_force": 1e-5}, False),
    ],
)
def test_small_numbers_that_do_not_cancel_out_are_goals(small: dict[str, float], accepted: bool) -> None:
    step, errors = solved()
    contacts: dict[str, Any] = {"base": replace(step.contacts["base"], **small)}
    step = replace(step, contacts=contacts)
    goals = {f"base.{key}": 0.01 for key in small}
    if accepted:
        assert [goal.value for goal in standings(goals, step, errors)] == list(small.values())
    else:
        with pytest.raises(SceneError, match="is 0 at the end"):
            standings(goals, step, errors)
