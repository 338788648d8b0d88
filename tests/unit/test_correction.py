"""The correction from what a method returned to the exact solution of the same steps."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from geometry.arrays import Array
from geometry.errors import SolverError
from solvers.interface.matrix_free import MatrixFreeSurface
from solvers.newton import correction
from solvers.newton.solution import Correction
from solvers.scene.scene import Scene
from solvers.simulation.simulation import Simulation
from solvers.stepping.state import State

SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]
MOVED = {"x": [[0, 0], [1, 0], [2, 0.02]], "y": [[0, 0], [1, -0.05]]}
BASE = {"surface": "block.bottom", "against": "foundation", "friction": {"law": "coulomb", "mu": 0.3}}
DRAGGED: dict[str, Any] = {
    "supports": {"top": {"boundary": "block.top", "displacement": MOVED}},
    "contacts": {
        "base": {"surface": "block.bottom", "against": "foundation", "friction": {"law": "coulomb", "mu": 0.3}}
    },
    "steps": {"end": 2.0, "count": 4},
}


def states(simulation: Simulation) -> list[State]:
    found = []
    for _ in simulation.steps():
        assert simulation.stepper.reported is not None
        found.append(simulation.stepper.reported.state)
    return found


def left(state: State) -> Correction:
    assert state.correction is not None
    return state.correction


@pytest.mark.parametrize(("surface", "off"), [("condensed", 1e-9), ("matrix-free", 0.3)])
def test_corrected_state_is_the_exact_one_of_the_whole_history(
    scene_of: SceneOf, simulation_of: SimulationOf, surface: str, off: float
) -> None:
    exact = states(simulation_of(scene_of(**DRAGGED, solver={"tolerance": 1e-13})))
    solver = {"method": "surface-uzawa", "surface": surface, "tolerance": 1e-3}
    rough = states(simulation_of(scene_of(**DRAGGED, solver=solver)))
    for a, b in zip(exact, rough, strict=True):
        wrong = np.abs(a.p - b.p).max()
        assert wrong > 1e-5 * np.abs(a.p).max()
        assert_allclose(b.p + left(b).p, a.p, atol=off * wrong)
        assert_allclose(b.w + left(b).w, a.w, atol=off * np.abs(a.w - b.w).max())


def test_condensed_form_needs_no_volume_solve_for_it(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    simulation = simulation_of(scene_of(**DRAGGED, solver={"method": "uzawa", "tolerance": 1e-3}))
    steps = list(simulation.steps())
    assert simulation.counters.error_solves == 0
    assert simulation.counters.volume_solves == sum(step.volume_solves for step in steps)


def test_volume_solves_for_it_are_counted_apart(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    solver = {"method": "surface-uzawa", "surface": "matrix-free", "tolerance": 1e-6}
    simulation = simulation_of(scene_of(**DRAGGED, solver=solver))
    steps = list(simulation.steps())
    assert len(steps) <= simulation.counters.error_solves <= 3 * len(steps)
    assert simulation.counters.volume_solves == sum(step.volume_solves for step in steps)


def test_exact_solution_has_the_error_of_rounding(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    simulation = simulation_of(scene_of(**DRAGGED))
    assert [step.iteration_error for step in simulation.steps()] == pytest.approx([correction.FLOOR] * 4, rel=0.5)


def test_where_newton_fails_all_starts_are_tried(
    scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = scene_of(**DRAGGED, solver={"method": "uzawa", "tolerance": 1e-3})
    expected = [step.iteration_error for step in simulation_of(scene).steps()]
    monkeypatch.setattr(correction, "_newton", lambda *given: None)
    simulation = simulation_of(scene)
    assert [step.iteration_error for step in simulation.steps()] == pytest.approx(expected, rel=0.02)
    assert simulation.counters.error_solves > 0
    monkeypatch.setattr(correction, "_from_all_starts", lambda *given: None)
    assert np.isnan([step.iteration_error for step in simulation_of(scene).steps()]).all()  # unknown, not zero


def test_step_is_accepted_where_the_solve_for_it_fails(
    scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*given: object) -> Array:
        raise SolverError("no convergence")

    solver = {"method": "surface-uzawa", "surface": "matrix-free", "tolerance": 1e-6}
    monkeypatch.setattr(MatrixFreeSurface, "displacement", broken)
    steps = list(simulation_of(scene_of(**DRAGGED, solver=solver)).steps())
    assert [step.time for step in steps] == [0.5, 1.0, 1.5, 2.0]
    assert np.isnan([step.iteration_error for step in steps]).all()
