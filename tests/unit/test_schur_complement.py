"""The Schur complement of the bodies: its answers, what they are counted as, and what a checkpoint keeps of them."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import sparse

from shared.problems import surface_problem
from stickslip.geometry.arrays import Array
from stickslip.solvers.interface import schur_complement
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.schur_complement import CondensedSurface, RowStiffness
from stickslip.solvers.iteration import OnStep, Solution, Status, ignore
from stickslip.solvers.linear.block_diagonal import BlockDiagonal
from stickslip.solvers.methods.condensed_newton import CondensedNewton
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation

SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]
BASE = {"surface": "block.bottom", "against": "foundation", "friction": {"law": "coulomb", "mu": 0.3}}
PLANE = {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
HELD = {"top": {"boundary": "block.top", "displacement": {"x": 0.05, "y": -0.1}}}
SCENES: dict[str, dict[str, Any]] = {
    "held": {"supports": HELD},
    "floating": {"loads": {"pull": {"boundary": "block.top", "traction": [0.02, -0.1]}}},
    "driven": {"supports": HELD, "obstacles": {"foundation": PLANE | {"force": {"y": 0.2}}}},
}


@pytest.fixture
def simulation_named(scene_of: SceneOf, simulation_of: SimulationOf) -> Callable[[str], Simulation]:
    def make(name: str) -> Simulation:
        load = {"push": {"boundary": "block.right", "pressure": 0.03}}
        tables = {k: v for k, v in SCENES[name].items() if k != "loads"}
        loads = load | SCENES[name].get("loads", {})
        block = {"block": {"E": 3.0, "nu": 0.3}}
        return simulation_of(scene_of(bodies=block, contacts={"base": BASE}, loads=loads, **tables))

    return make


def condensed(simulation: Simulation) -> CondensedSurface:
    surface = simulation.stepper.surface
    assert isinstance(surface, CondensedSurface)
    return surface


def fresh(surface: CondensedSurface) -> CondensedSurface:
    """Another one of the same bodies, which has done nothing yet."""
    return CondensedSurface(
        surface.volume, N=surface.N, W=surface.W, R=surface.R, normal_rows=surface.normal_rows, driven=surface.driven
    )


@pytest.mark.parametrize("name", SCENES)
def test_displacements_are_in_equilibrium(name: str, simulation_named: Callable[[str], Simulation]) -> None:
    """On the contact dofs, S u = f_c - N^T W p + rho R (b - R^T u) with b = 0; on all dofs, K u = f - B^T p."""
    problem = surface_problem(simulation_named(name))
    surface = problem.surface
    assert isinstance(surface, CondensedSurface)
    p = np.random.default_rng(0).normal(size=len(problem.gap))
    before = surface.counters.volume_solves
    u_c = surface.under(problem.load, p)
    assert surface.counters.volume_solves == before + 1
    held = surface.S + surface.rho * surface.R @ surface.R.T
    force = problem.load.f_c - surface.N.T @ (surface.W * p)
    assert_allclose(held @ u_c, force, atol=1e-11 * np.abs(force).max())
    u = surface.recover(problem.load, p, u_c)
    own, K = len(u_c) - surface.driven, surface.volume.K
    read = surface.volume.contact.read
    assert_allclose(read(u), u_c[:own])
    left = K * u - problem.load.f_q  # - B^T p, and what holds a floating body
    on_contact = (surface.S @ u_c - problem.load.f_c)[:own]
    assert_allclose(read(left), on_contact, atol=1e-11 * np.abs(force).max())
    surface.volume.contact.write(left, np.zeros(own))
    assert np.abs(left.array).max() < 1e-11 * np.abs(force).max()


def test_the_inverse_is_formed_when_it_pays(
    simulation_named: Callable[[str], Simulation], monkeypatch: pytest.MonkeyPatch
) -> None:
    surface = fresh(condensed(simulation_named("held")))
    monkeypatch.setattr(schur_complement, "PAYS", surface.size / 2)  # after more than two forces
    formed = []
    for k in range(4):
        surface.displacement(np.eye(surface.size)[k])
        formed.append("flexibility" in surface._dense)
    assert formed == [False, False, True, True]


def as_after(surface: CondensedSurface, forces: Array) -> CondensedSurface:
    """A fresh one that has answered some forces, and condensed a load."""
    other = fresh(surface)
    for force in forces:
        other.displacement(force)
    return other


@pytest.mark.parametrize("count", [1, 3])
def test_a_restored_one_answers_to_the_last_bit(
    count: int, simulation_named: Callable[[str], Simulation], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before and after the inverse is formed."""
    problem = surface_problem(simulation_named("held"))
    surface = problem.surface
    assert isinstance(surface, CondensedSurface)
    monkeypatch.setattr(schur_complement, "PAYS", surface.size / 2)
    forces = np.random.default_rng(0).normal(size=(6, surface.size))
    one, other = as_after(surface, forces[:count]), fresh(surface)
    f_q = problem.load.f_q
    one._condensed(f_q)
    one._lambda_max = 7.0  # what Lanczos found
    snapshot = one.snapshot()
    snapshot["condensed"]["vectors"] = [own.values for own in snapshot["condensed"]["vectors"]]  # as read from a file
    other.restore(snapshot)
    assert other.lambda_max == 7.0
    solves = surface.counters.volume_solves
    assert_array_equal(other._condensed(2.0 * f_q), one._condensed(2.0 * f_q))
    assert surface.counters.volume_solves == solves  # of a known load
    for force in forces[count:]:
        assert_array_equal(other.displacement(force), one.displacement(force))
        assert set(other._dense) == set(one._dense)


def test_once_the_inverse_is_formed_the_count_is_no_state(
    simulation_named: Callable[[str], Simulation], monkeypatch: pytest.MonkeyPatch
) -> None:
    surface = condensed(simulation_named("held"))
    monkeypatch.setattr(schur_complement, "PAYS", surface.size / 2)
    forces = np.random.default_rng(0).normal(size=(6, surface.size))
    kept = [as_after(surface, forces[:count]).snapshot() for count in (0, 1, 3, 5)]
    assert [(each["forces"], each["inverted"]) for each in kept] == [(0, False), (1, False), (0, True), (0, True)]


def test_other_contact_pairs_take_over_what_is_known_of_the_bodies(
    simulation_named: Callable[[str], Simulation],
) -> None:
    surface = condensed(simulation_named("held"))
    forces = np.random.default_rng(0).normal(size=(6, surface.size))
    one, other = as_after(surface, forces), fresh(surface)
    other.adopt(one)
    assert other.flexibility is one.flexibility
    assert other._condensed is one._condensed
    # the factor is there, too: the first answer comes from the inverse, to the last bit
    assert_array_equal(other.displacement(forces[0]), one.flexibility @ forces[0])


def test_the_complement_by_rows_is_of_those_rows(simulation_named: Callable[[str], Simulation]) -> None:
    surface = condensed(simulation_named("held"))
    rows = np.ones(len(surface.W), bool)
    bodies = surface.row_stiffness(rows)
    assert bodies is not None
    N = surface.N.toarray()
    assert_allclose(N.T @ bodies.H @ N, surface.S, atol=1e-11 * np.abs(surface.S).max())
    assert surface.row_stiffness(rows) is bodies
    assert surface.row_stiffness(np.zeros_like(rows)) is None


@pytest.mark.parametrize(("scales", "determined"), [((1e6, 1e-1), True), ((1e6, 1e-4), False), ((1e-6, 1e-9), True)])
def test_rows_that_hardly_determine_a_dof_are_refused(scales: tuple[float, float], determined: bool) -> None:
    """By their pivots' ratio, whatever the unit."""
    N, S = sparse.diags(scales).tocsr(), np.eye(2)
    assert (RowStiffness.of(N, BlockDiagonal.whole(S), np.ones(2, bool)) is not None) is determined


def test_a_driven_obstacle_is_a_dof_without_stiffness(simulation_named: Callable[[str], Simulation]) -> None:
    surface = condensed(simulation_named("driven"))
    assert surface.driven == 1
    assert not np.asarray(surface.S)[-1].any()
    assert surface.floating


def smooth(make: SceneOf, dim: int, **tables: Any) -> Scene:
    """A block without friction, pressed from the side and from above."""
    held = {"top": {"boundary": "block.top", "displacement": dict.fromkeys("xyz"[:dim], -0.1)}}
    base = {"surface": "block.bottom", "against": "foundation"}
    return make(dim, **{"contacts": {"base": base}, "supports": held} | tables)


@pytest.mark.parametrize(("dim", "count"), [pytest.param(2, 9, marks=pytest.mark.slow), (3, 15)])
def test_without_friction_only_normal_displacements_are_condensed(
    dim: int, count: int, scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = simulation_of(smooth(scene_of, dim))
    (step,) = simulation.steps()
    with_friction = simulation_of(smooth(scene_of, dim, contacts={"base": BASE}))
    assert (simulation.counters.schur_size, with_friction.counters.schur_size) == (count, dim * count)
    inclined = {"foundation": {"shape": "plane", "point": [0.0] * dim, "normal": [0.1] * (dim - 1) + [1.0]}}
    assert simulation_of(smooth(scene_of, dim, obstacles=inclined)).counters.schur_size == dim * count
    whole = simulation_of(smooth(scene_of, dim, solver={"method": "surface-uzawa"}))
    (other,) = whole.steps()
    assert whole.counters.schur_size == dim * count
    assert_allclose(step.displacement, other.displacement, atol=1e-6)
    monkeypatch.setattr(CondensedNewton, "__call__", broken)  # the next method of the chain needs all of them
    (instead,) = simulation.steps()
    assert_allclose(instead.displacement, other.displacement, atol=1e-6)
    assert simulation.stepper.chain.switches[0].after == "surface-uzawa (condensed)"
    assert simulation.stepper.chain.reached.whole
    assert (simulation.counters.factorisations, simulation.counters.schur_size) == (2, dim * count)


def broken(method: CondensedNewton, problem: SurfaceProblem, p: Array, on_step: OnStep = ignore) -> Solution:
    return Solution(p=p, w=p, u_c=np.zeros(0), status=Status.STALLED, residual=1.0, history=())
