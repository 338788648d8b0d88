"""surface-uzawa: the answers of condensed-newton, for a number of volume solves that no mesh size changes."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

import solvers.methods.surface_system as surface_system
from solvers.methods.gmres import gmres
from solvers.methods.solution import Status
from solvers.methods.surface_uzawa import SurfaceUzawa
from solvers.nouns.scene import Scene
from solvers.simulation import Simulation
from solvers.state import State
from solvers.surface_metric import surface_metric
from workflows.scene import read

Array = NDArray[np.float64]
SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]
SMALL = {
    "block": ("geometry.mesh_size=0.4", "geometry.contact_mesh_size=0.2"),
    "cube": ("geometry.mesh_size=0.25",),
    "two_blocks": ("geometry.mesh_size=0.25", "geometry.lower_mesh_size=0.3", "geometry.contact_mesh_size=0.12"),
    "cylinders": ("geometry.mesh_size=2.0", "geometry.contact_mesh_size=0.12"),
    "shrink_fit": (),
    "foundation": (),  # compliance, floating
    "arch": (),  # seven stones that contact alone holds
    "stack": (),
    "sliding": (),
    "axisymmetric": (),
    "ring": (),
    "shaft": (),
}


def pressed(scene_of: SceneOf, dim: int, n: int, mu: float, **solver: Any) -> Scene:
    """A block of height 1 with n cells over it: pressed, then dragged."""
    drag = {"x": [[0, 0], [1, 0], [2, 0.02]], "xyz"[dim - 1]: [[0, 0], [1, -0.05]]}
    if dim == 3:
        drag["y"] = [[0, 0], [1, 0], [2, 0.01]]
    friction = {"friction": {"law": "coulomb", "mu": mu}} if mu else {}
    return scene_of(
        dim,
        {"mesh_size": 1 / n, "cells": "tensor"} | ({"length": 1.0} if dim == 3 else {}),
        contacts={"base": {"surface": "block.bottom", "against": "foundation"} | friction},
        supports={"top": {"boundary": "block.top", "displacement": drag}},
        steps={"end": 2.0, "count": 2},
        solver={"method": "surface-uzawa", "surface": "condensed"} | solver,
    )


def solved(simulation: Simulation) -> list[State]:
    """The states of all requested times, reached by the method of the scene alone."""
    state, states = simulation.stepper.start(), []
    for time in simulation.scene.requested_times():
        accepted = simulation.stepper.reach(state, time, lambda row: None)
        assert {accepted.substeps, len(simulation.stepper.attempts.switches)} == {1, 0}
        state = accepted.state
        states.append(state)
    return states


def iterations(simulation: Simulation) -> list[int]:
    """Volume solves of each step after the first measurement."""
    state, found = simulation.stepper.start(), []
    for time in simulation.scene.requested_times():
        accepted = simulation.stepper.reach(state, time, lambda row: None)
        assert accepted.substeps == 1
        state = accepted.state
        found.append(accepted.iterations)
    return found


def same_forces(one: list[State], other: list[State], tolerance: float) -> None:
    for a, b in zip(one, other, strict=True):
        size = max(np.abs(f).max() for f in a.forces.values())
        for name, force in a.forces.items():
            assert_allclose(b.forces[name], force, atol=tolerance * size)


@pytest.mark.parametrize("name", SMALL)
def test_every_kind_of_scene_has_the_answer_of_condensed_newton(name: str, simulation_of: SimulationOf) -> None:
    scene = read(name, SMALL[name])
    answers = []
    for method in ("condensed-newton", "surface-uzawa"):
        solver = replace(scene.solver, method=method, surface="condensed", tolerance=1e-11)
        answers.append(solved(simulation_of(replace(scene, solver=solver))))
    same_forces(*answers, tolerance=1e-8 if name == "block" else 1e-9)


@pytest.mark.parametrize("dim", [2, 3])
def test_gmres_and_a_dense_matrix_give_the_same(
    dim: int, scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = []
    for dense in (0, 10_000):
        monkeypatch.setattr(surface_system, "DENSE", dense)
        answers.append(solved(simulation_of(pressed(scene_of, dim, 6, 0.3, tolerance=1e-11))))
    assert not np.array_equal(answers[0][1].p, answers[1][1].p)
    same_forces(*answers, tolerance=1e-9)


def test_inexact_volume_solves_give_the_same(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    ways = ("condensed", "matrix-free")
    answers = [solved(simulation_of(pressed(scene_of, 2, 16, 0.3, tolerance=1e-9, surface=way))) for way in ways]
    same_forces(*answers, tolerance=1e-6)


@pytest.mark.parametrize("mu", [0.0, 0.3, 1.0, 3.0])
def test_volume_solves_do_not_grow_with_the_mesh_in_the_plane(
    mu: float, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    counts = np.array([iterations(simulation_of(pressed(scene_of, 2, n, mu))) for n in (16, 32, 64, 128)])
    assert np.ptp(counts, axis=0).max() <= 2
    assert counts.max() <= 14  # 1e-8


@pytest.mark.parametrize("mu", [0.3, 3.0])
def test_volume_solves_do_not_grow_with_the_mesh_in_space(
    mu: float, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    counts = np.array([sum(iterations(simulation_of(pressed(scene_of, 3, n, mu)))) for n in (6, 8, 12)])
    assert_allclose(counts, counts.mean(), rtol=0.2)
    assert counts.max() <= 44  # two steps to 1e-8


def test_what_one_step_learnt_serves_the_next(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """A second step of the same kind is solved in fewer iterations with the pairs of the first."""
    scene = pressed(scene_of, 2, 16, 0.3)
    simulation = simulation_of(scene)
    first, _ = solved(simulation)
    accepted = simulation.stepper.reach(simulation.stepper.start(), 1.0, lambda row: None)
    method = SurfaceUzawa(metric=surface_metric(simulation.system), rtol=1e-8)
    fresh = method(accepted.problem, np.zeros_like(first.p))
    again = method(accepted.problem, np.zeros_like(first.p))
    safe = replace(method, safety=4.0)(accepted.problem, np.zeros_like(first.p))
    assert {fresh.status, again.status, safe.status} == {Status.CONVERGED}
    assert again.iterations <= fresh.iterations / 2
    assert safe.iterations > again.iterations  # larger metric, shorter steps, nothing remembered
    assert_allclose(safe.p, fresh.p, atol=1e-6 * accepted.problem.p_ref)


def test_it_says_when_it_ran_out_of_iterations(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    simulation = simulation_of(pressed(scene_of, 2, 8, 0.3))
    problem = simulation.stepper.reach(simulation.stepper.start(), 1.0, lambda row: None).problem
    method = SurfaceUzawa(metric=surface_metric(simulation.system), max_it=3)
    solution = method(problem, np.zeros(problem.cone.size))
    assert (solution.status, solution.iterations, len(solution.history)) == (Status.MAX_IT, 3, 4)
    solves = [step.volume_solves for step in solution.history]
    assert np.diff(solves).tolist() == [1, 1, 1]


def test_gmres_stops_at_the_residual_asked_for() -> None:
    random = np.random.default_rng(0)
    A = np.eye(40) + 0.3 * random.normal(size=(40, 40)) / np.sqrt(40)
    b = random.normal(size=40)
    x, left = gmres(lambda v: A @ v, b, np.zeros(40), lambda v: v / 2, atol=1e-6)
    assert_allclose(np.linalg.norm(b - A @ x), left, rtol=1e-3)
    assert 1e-9 < left <= 1e-6
    short, more = gmres(lambda v: A @ v, b, np.zeros(40), lambda v: v / 2, atol=1e-6, max_it=3)
    assert_allclose(np.linalg.norm(b - A @ short), more, rtol=1e-10)
    assert more > 1e-3
