"""When a method fails the next one takes the step over, with the same answer; none left, what was reached is kept."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from numpy.testing import assert_allclose

from solvers.methods.solution import Solution, Status
from solvers.methods.surface_uzawa import SurfaceUzawa
from solvers.nouns.scene import Scene
from solvers.simulation import Simulation
from solvers.stepping import StepError
from workflows.results import summary

SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]
CHAIN = ["surface-uzawa", "surface-uzawa", "condensed-newton"]
FEW = 2  # iterations


def pressed(scene_of: SceneOf, **solver: Any) -> Scene:
    """Pressed, then dragged until a part slips."""
    drag = {"x": [[0, 0], [1, 0], [2, 0.02]], "y": [[0, 0], [1, -0.05]]}
    return scene_of(
        contacts={
            "base": {"surface": "block.bottom", "against": "foundation", "friction": {"law": "coulomb", "mu": 0.3}}
        },
        supports={"top": {"boundary": "block.top", "displacement": drag}},
        steps={"end": 2.0, "count": 2},
        solver=solver,
    )


def forces(simulation: Simulation) -> list[Any]:
    return [step.contacts["base"].force for step in simulation.steps()]


def hasten(monkeypatch: pytest.MonkeyPatch) -> None:
    """surface-uzawa gives up soon."""
    whole = SurfaceUzawa.__call__

    def short(self: SurfaceUzawa, *arguments: Any) -> Solution:
        return whole(replace(self, max_it=FEW), *arguments)

    monkeypatch.setattr(SurfaceUzawa, "__call__", short)


def test_methods_that_fail_hand_the_step_on(
    scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    exact = simulation_of(pressed(scene_of, method="condensed-newton"))
    expected = list(exact.steps())
    hasten(monkeypatch)
    simulation = simulation_of(pressed(scene_of, method="auto", surface="matrix-free"))
    attempts = simulation.stepper.attempts
    assert [stage.method for stage in attempts.choice.stages] == CHAIN
    found = list(simulation.steps())
    for step, other in zip(found, expected, strict=True):
        assert_allclose(step.contacts["base"].force, other.contacts["base"].force, rtol=0, atol=1e-7)
    first, second = attempts.switches  # both in the first step: what failed is not tried again
    assert (first.time, first.iteration, first.because) == (1.0, FEW, Status.MAX_IT.value)
    assert (first.after, second.after) == ("surface-uzawa (matrix-free, safer metric)", "condensed-newton (condensed)")
    assert found[0].iterations == 2 * FEW + expected[0].iterations
    assert found[1].iterations == expected[1].iterations
    choice = summary(simulation, "converged", [], [], 1.0)["choice"]
    assert (choice["method"], choice["because"]) == ("surface-uzawa", "solver.surface = matrix-free")


def test_a_linear_solve_that_fails_hands_the_step_on(
    scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = forces(simulation_of(pressed(scene_of, method="condensed-newton")))
    simulation = simulation_of(pressed(scene_of, method="auto", surface="matrix-free"))
    monkeypatch.setattr("solvers.conjugate_gradients.MOST_ITERATIONS", 1)
    assert_allclose(forces(simulation), expected, rtol=0, atol=1e-7)
    assert {switch.because for switch in simulation.stepper.attempts.switches} == {Status.BROKEN.value}


def test_a_linear_solve_that_fails_leaves_the_steps_before_it(
    scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    steps = simulation_of(pressed(scene_of, method="surface-uzawa", surface="matrix-free")).steps()
    assert next(steps).time == 1.0
    monkeypatch.setattr("solvers.conjugate_gradients.MOST_ITERATIONS", 1)
    with pytest.raises(StepError, match="a linear solve failed"):
        next(steps)
