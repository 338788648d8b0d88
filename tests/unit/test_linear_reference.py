"""The unit of our costs: a linear solve of the same mesh, by each solver that is worth trying."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from stickslip.solvers.linear.multigrid import HYPRE
from stickslip.solvers.results import linear_reference as module
from stickslip.solvers.results.linear_reference import linear_reference
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.system.system import System

SceneOf = Callable[..., Scene]
SystemOf = Callable[[Scene], System]
MULTIGRID = "cg+boomeramg" if HYPRE else "cg+gamg"
BASE = {"base": {"surface": "block.bottom", "against": "foundation"}}


def scene(make: SceneOf, dim: int, pressure: float = 0.1) -> Scene:
    """Held by contact alone: with its contact surface fixed it is held all the same."""
    loads: dict[str, Any] = {"push": {"boundary": "block.top", "pressure": pressure}}
    return make(
        dim, {"cells": "tensor"}, contacts=BASE | {"base": BASE["base"] | {"friction": {"law": "stick"}}}, loads=loads
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_every_solver_solves_and_the_fastest_is_the_unit(dim: int, scene_of: SceneOf, system_of: SystemOf) -> None:
    system = system_of(scene(scene_of, dim))
    found = linear_reference(system)
    assert set(found.solvers) == {"mumps", "cg+gamg", MULTIGRID}
    for timing in found.solvers.values():
        assert timing.residual is not None
        assert timing.residual <= 2e-8
        assert timing.seconds >= found.seconds > 0
    assert found.solvers[found.fastest].seconds == found.seconds
    assert found.solvers[MULTIGRID].iterations > found.solvers["mumps"].iterations
    assert system.counters.volume_solves == 0  # kept apart


def test_a_factorisation_that_would_take_far_longer_is_not_tried(
    scene_of: SceneOf, system_of: SystemOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "QUADRATIC", 1.0)
    found = linear_reference(system_of(scene(scene_of, 3)))
    assert found.solvers["mumps"].note.startswith("not tried")
    assert found.solvers["mumps"].setup is None
    assert found.fastest != "mumps"
    assert np.isfinite(found.seconds)


def test_without_a_load_another_one_is_taken(scene_of: SceneOf, system_of: SystemOf) -> None:
    found = linear_reference(system_of(scene(scene_of, 2, pressure=0.0)))
    assert found.solvers[MULTIGRID].iterations > 1


def test_a_solver_that_fails_is_said(scene_of: SceneOf, system_of: SystemOf, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_ITERATIONS", 1)
    found = linear_reference(system_of(scene(scene_of, 2)))
    assert found.fastest == "mumps"
    assert found.solvers["cg+gamg"].seconds == np.inf
