"""Methods: the linearised laws are the derivative of the laws, and every method finds the same answer."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.linalg import null_space

from shared.cases import every_nth
from shared.problems import surface_problem
from stickslip.solvers.classical.uzawa import Uzawa
from stickslip.solvers.contact.admissible_set import AdmissibleSet
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.iteration import Status
from stickslip.solvers.methods.condensed_newton import CondensedNewton
from stickslip.solvers.newton.active_set import ActiveSet, linearise
from stickslip.solvers.newton.condensed_system import by_motion, by_tractions, solve
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

Array = NDArray[np.float64]
SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]
NORMAL: dict[str, dict[str, Any]] = {
    "unilateral": {"law": "unilateral"},
    "bilateral": {"law": "bilateral"},
    "linear": {"law": "compliance", "c_n": 20.0},
    "power": {"law": "compliance", "c_n": 20.0, "m_n": 2.0},
}
FRICTION: dict[str, dict[str, Any]] = {
    "coulomb": {"law": "coulomb", "mu": 0.4},
    "tresca": {"law": "tresca", "bound": 0.02},
    "stick": {"law": "stick"},
    "penetration": {"law": "compliance", "c_T": 1.6},
    "penetration squared": {"law": "compliance", "c_T": 8.0, "m_T": 2.0},
    "soft coulomb": {"law": "coulomb", "mu": 0.1, "k_T": 5.0},
    "soft tresca": {"law": "tresca", "bound": 0.02, "k_T": 5.0},
    "soft stick": {"law": "stick", "k_T": 5.0},
}


def pressed(scene_of: SceneOf, dim: int, normal: str, friction: str, **solver: Any) -> Scene:
    """Pressed and dragged in one step, by the top and by the foundation; in 3D along both axes."""
    drag = {"x": 0.06, "y": -0.1} if dim == 2 else {"x": 0.06, "y": 0.03, "z": -0.1}
    laws = {"normal": NORMAL[normal], "friction": FRICTION[friction]}
    low = {"point": [0.0] * dim, "normal": [0.0] * (dim - 1) + [1.0]}
    return scene_of(
        dim,
        obstacles={"foundation": {"shape": "plane", "displacement": {"x": -0.01, "y": 0.02}} | low},
        contacts={"base": {"surface": "block.bottom", "against": "foundation"} | laws},
        supports={"top": {"boundary": "block.top", "displacement": drag}},
        solver={"tolerance": 1e-11} | solver,
    )


def trial_away_from_kinks(cone: AdmissibleSet, gamma: Array, seed: int) -> tuple[Array, NDArray[np.str_]]:
    """Random trial tractions, none near an edge between open, stick and slip; the state of each tangential point."""
    random = np.random.default_rng(seed)
    (place,) = cone.places
    p_hat = random.uniform(0.2, 1.0, cone.size) * random.choice([-1.0, 1.0, 1.0, 1.0], cone.size)
    surface = place.rows.surface
    basis = np.abs(place.rows.N_n[:, surface.dim - 1 :: surface.dim])  # the normal is the last axis
    left = basis @ surface.points[:, 0] < 0.6  # open, so that whole facets are
    p_hat[place.normal][left] = -np.abs(p_hat[place.normal][left])
    p_n = place.rows.normal.resolvent(p_hat[place.normal], gamma[place.normal])
    s = cone.bound(place, p_n)
    assert not np.any((s > 0) & (s < 1e-6))  # else choose another seed
    t = random.normal(size=(len(s), place.components))
    slipping = random.random(len(s)) < 0.5
    t *= (np.where(np.isfinite(s), np.where(slipping, 1.6, 0.5) * s, 1.0) / np.linalg.norm(t, axis=1))[:, None]
    t *= 1 + (gamma * cone.softness)[place.tangential].reshape(t.shape)  # the disc holds what the resolvent leaves
    p_hat[place.tangential] = t.ravel()
    return p_hat, np.where(s == 0, "open", np.where(slipping & np.isfinite(s), "slip", "stick"))


def as_one_system(laws: ActiveSet) -> tuple[Array, Array]:
    """M (p, w) = r."""
    return np.hstack([laws.A_p.toarray(), laws.A_w.toarray()]), laws.rhs


COMBINATIONS = [  # of laws
    ("unilateral", "coulomb"), ("unilateral", "tresca"), ("unilateral", "stick"), ("bilateral", "coulomb"),
    ("bilateral", "tresca"), ("linear", "coulomb"), ("power", "coulomb"), ("power", "tresca"),
    ("linear", "penetration"), ("power", "penetration"), ("power", "penetration squared"),
    ("unilateral", "soft coulomb"), ("power", "soft coulomb"), ("bilateral", "soft tresca"),
    ("unilateral", "soft stick"),
]  # fmt: skip


@pytest.mark.parametrize(("laws", "dim"), every_nth(2, COMBINATIONS, [2, 3]))
def test_linearised_laws_are_the_derivative_of_the_laws(
    laws: tuple[str, str], dim: int, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """One Newton step of p - P_C(p + gamma (w - gap)) = 0, by differences, has the linearised laws' solutions."""
    normal, friction = laws
    problem = surface_problem(simulation_of(pressed(scene_of, dim, normal, friction)))
    problem = replace(problem, gap=problem.gap + np.random.default_rng(6).normal(0.0, 0.1, len(problem.gap)))
    cone, gamma, rows = problem.cone, problem.gamma * 0.8, problem.cone.size
    p_hat, states = trial_away_from_kinks(cone, gamma, seed=4)
    if normal != "bilateral" and "stick" not in friction:
        assert set(states) >= {"open", "slip", "stick"}
    p = np.random.default_rng(5).normal(size=rows)
    w = problem.gap + (p_hat - p) / gamma

    def defect(x: Array) -> Array:
        return np.asarray(x[:rows] - cone.project(x[:rows] + gamma * (x[rows:] - problem.gap), gamma))

    x, h = np.concatenate([p, w]), 1e-6
    columns = [(defect(x + h * e) - defect(x - h * e)) / (2 * h) for e in np.eye(2 * rows)]
    J = np.stack(columns, axis=1)
    M, r = as_one_system(linearise(problem, p_hat, gamma))
    assert np.linalg.matrix_rank(M) == np.linalg.matrix_rank(J, tol=1e-6) == rows
    solution = np.linalg.lstsq(M, r, rcond=None)[0]
    assert_allclose(M @ solution, r, atol=1e-12)
    scale = np.abs(J).max() * np.abs(solution - x).max()
    assert_allclose(defect(x) + J @ (solution - x), 0.0, atol=1e-8 * scale)  # differences: h², eps/h
    assert_allclose(J @ null_space(M), 0.0, atol=1e-8 * np.abs(J).max())


@pytest.mark.parametrize("dim", [2, 3])
def test_the_condensed_system_is_solved_with_its_laws(dim: int, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    problem = surface_problem(simulation_of(pressed(scene_of, dim, "power", "coulomb")))
    p_hat, _ = trial_away_from_kinks(problem.cone, problem.gamma, seed=4)
    laws = linearise(problem, p_hat, problem.gamma)
    p, u_c = solve(laws, np.zeros(laws.problem.surface.size))
    surface = problem.surface
    w = surface.N @ u_c + problem.offset
    M, r = as_one_system(laws)
    size = np.abs(M).max() * max(np.abs(p).max(), np.abs(w).max())
    assert_allclose(M @ np.concatenate([p, w]), r, atol=1e-11 * size)
    balance = surface.S @ u_c + surface.forces(p) - problem.load.f_c
    assert_allclose(balance, 0.0, atol=1e-11 * np.abs(surface.S @ u_c).max())


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("normal", "friction"), [
    ("unilateral", "coulomb"), ("unilateral", "soft coulomb"), ("soft", "soft coulomb"), ("power", "coulomb"),
])  # fmt: skip
def test_it_is_solved_with_floating_bodies_too(
    normal: str, friction: str, dim: int, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    laws: dict[str, Any] = {"normal": (NORMAL | {"soft": {"law": "compliance", "c_n": 0.5}})[normal]}
    laws |= {"friction": FRICTION[friction], "gap_offset": -0.01}
    drag = [0.005, -0.1] if dim == 2 else [0.005, 0.003, -0.1]
    problem = surface_problem(simulation_of(scene_of(
        dim,
        bodies={"block": {"E": 3.0, "nu": 0.3}},
        contacts={"base": {"surface": "block.bottom", "against": "foundation"} | laws},
        loads={"pull": {"boundary": "block.top", "traction": drag}},
    )))  # fmt: skip
    surface = problem.surface
    assert isinstance(surface, CondensedSurface)
    assert surface.floating
    linear = linearise(problem, trial_away_from_kinks(problem.cone, problem.gamma, seed=4)[0], problem.gamma)
    assert linear.slip.any()
    M, r = as_one_system(linear)
    bodies = surface.row_stiffness(problem.cone.carrying)
    for p, u_c in [by_tractions(linear, surface), *([by_motion(linear, bodies)] if bodies is not None else [])]:
        w = surface.N @ u_c + problem.offset
        size = np.abs(M).max() * max(np.abs(p).max(), np.abs(w).max())
        assert_allclose(M @ np.concatenate([p, w]), r, atol=1e-11 * size)
        balance = surface.S @ u_c + surface.forces(p) - problem.load.f_c
        assert_allclose(balance, 0.0, atol=1e-10 * surface.total * np.abs(u_c).max())
        resultant = surface.R.T @ (problem.load.f_c - surface.forces(p))
        assert_allclose(resultant, 0.0, atol=1e-10 * np.abs(surface.forces(p)).sum())


def test_rows_that_slip_are_known(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    problem = surface_problem(simulation_of(pressed(scene_of, 2, "unilateral", "coulomb")))
    p_hat, states = trial_away_from_kinks(problem.cone, problem.gamma, seed=4)
    laws, (place,) = linearise(problem, p_hat, problem.gamma), problem.cone.places
    assert laws.slip[place.tangential].tolist() == ((states == "slip") & place.rows.free[:, 0]).tolist()
    assert not laws.slip[place.normal].any()


def test_a_direction_without_multiplier_has_no_law(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """A point that slips in 3D, one of whose directions a support has taken: its row is p = 0."""
    problem = surface_problem(simulation_of(pressed(scene_of, 3, "unilateral", "coulomb")))
    p_hat, states = trial_away_from_kinks(problem.cone, problem.gamma, seed=4)
    (rows,), point = problem.cone.contacts, int(np.flatnonzero(states == "slip")[0])
    free = rows.free.copy()
    free[point, 1] = False
    cone = AdmissibleSet((replace(rows, free=free),), problem.cone.time, problem.cone.end)
    row = problem.surface.normal_rows + 2 * point + 1
    p_hat[row - 1] = 10.0  # it slips along the other one
    laws = linearise(replace(problem, cone=cone), p_hat, problem.gamma)
    assert np.isfinite(laws.A_p.toarray()).all()
    assert np.isfinite(laws.A_w.toarray()).all()
    assert not laws.A_w.toarray()[row].any()
    assert laws.slip[row - 1]
    assert not laws.slip[row]


def test_nan_goes_through_the_system(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """It ends as Status.NOT_FINITE, not as an error."""
    problem = surface_problem(simulation_of(pressed(scene_of, 2, "linear", "coulomb")))
    p_hat, _ = trial_away_from_kinks(problem.cone, problem.gamma, seed=4)
    laws = linearise(problem, p_hat, problem.gamma)
    surface = problem.surface
    assert isinstance(surface, CondensedSurface)
    p, u_c = by_tractions(replace(laws, rhs=laws.rhs * np.nan), surface)
    assert np.isnan(p).any()
    assert np.isnan(u_c).any()


@pytest.mark.parametrize(
    ("friction", "dim", "seed"), every_nth(3, ["coulomb", "tresca", "soft coulomb"], [2, 3], [4, 5, 6])
)
def test_unknown_tractions_and_unknown_motions_give_the_same_answer(
    friction: str, dim: int, seed: int, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    problem = surface_problem(simulation_of(pressed(scene_of, dim, "unilateral", friction)))
    surface = problem.surface
    assert isinstance(surface, CondensedSurface)
    bodies = surface.row_stiffness(problem.cone.carrying)
    assert bodies is not None
    laws = linearise(problem, trial_away_from_kinks(problem.cone, problem.gamma, seed)[0], problem.gamma)
    (p, u), (q, v) = by_motion(laws, bodies), by_tractions(laws, surface)
    assert np.abs(p).max() > 0
    assert_allclose(p, q, atol=1e-10 * np.abs(p).max())  # rounding, condition some 1e3
    assert_allclose(u, v, atol=1e-10 * np.abs(u).max())


@pytest.mark.parametrize(("dim", "normal", "friction"), [
    (2, "unilateral", "coulomb"), (2, "linear", "tresca"), (2, "bilateral", "tresca"),
    (3, "power", "coulomb"), (2, "power", "penetration squared"), (3, "linear", "penetration"),
    (2, "unilateral", "soft coulomb"), (2, "bilateral", "soft tresca"),
    pytest.param(2, "power", "coulomb", marks=pytest.mark.slow),
    pytest.param(3, "power", "soft coulomb", marks=pytest.mark.slow),
])  # fmt: skip
def test_uzawa_and_newton_find_the_same_answer(
    dim: int, normal: str, friction: str, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    steps, problems = [], []
    for method in ("uzawa", "condensed-newton"):
        simulation = simulation_of(pressed(scene_of, dim, normal, friction, method=method))
        steps += list(simulation.steps())
        problems.append(simulation.stepper.surface)
    one, other = steps
    assert 0 < other.iterations < one.iterations
    size = np.abs(one.displacement).max()
    assert_allclose(one.displacement, other.displacement, atol=1e-9 * size)  # tolerance 1e-11, condition some 100
    forces = [surface.forces(step.p) for surface, step in zip(problems, steps, strict=True)]
    assert_allclose(forces[0], forces[1], atol=1e-9 * np.abs(forces[0]).max())
    contact = other.contacts["base"]
    assert contact.slip_area > 0
    assert contact.tangential_force > 0.01
    assert contact.dissipation > 0


def test_friction_is_what_the_methods_see_of_mu(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    scene = pressed(scene_of, 2, "power", "coulomb")
    smooth = scene_of(
        contacts={"base": {"surface": "block.bottom", "against": "foundation", "normal": NORMAL["power"],
                           "friction": {"law": "coulomb", "mu": 0.0}}},
        supports={"top": {"boundary": "block.top", "displacement": {"x": 0.06, "y": -0.1}}},
    )  # fmt: skip
    (rough,), (slippery,) = (list(simulation_of(s).steps()) for s in (scene, smooth))
    assert slippery.contacts["base"].tangential_force == 0.0
    assert rough.contacts["base"].tangential_force <= 0.4 * rough.contacts["base"].normal_force * (1 + 1e-9)


@pytest.mark.parametrize(("relaxation", "converges"), [(0.2, True), (1.99, True), (2.02, False)])
def test_uzawa_converges_up_to_two_over_lambda_max_and_no_further(
    relaxation: float, converges: bool, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """All points closed and sticking: Richardson's iteration, whose bound is sharp."""
    problem = surface_problem(simulation_of(pressed(scene_of, 2, "bilateral", "stick")))
    method = Uzawa(alpha=relaxation / problem.surface.lambda_max, rtol=1e-8, max_it=20000)
    solution = method(problem, np.zeros(problem.cone.size))
    if converges:
        assert solution.status is Status.CONVERGED
        newton = CondensedNewton(rtol=1e-10)(problem, np.zeros(problem.cone.size))
        assert_allclose(solution.w, newton.w, atol=1e-7 * problem.u_ref)
    else:
        assert solution.status is Status.STALLED
        assert np.abs(solution.p).max() > 1e3 * problem.p_ref  # (2.02 - 1)^500 = 2e4, started at rounding or above


def test_a_method_says_when_it_ran_out_of_iterations(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    problem = surface_problem(simulation_of(pressed(scene_of, 2, "unilateral", "coulomb")))
    nothing = np.zeros(problem.cone.size)
    solution = Uzawa(rtol=1e-12, max_it=3)(problem, nothing)
    assert (solution.status, solution.iterations, len(solution.history)) == (Status.MAX_IT, 3, 4)
    # what is returned is what was measured
    w = problem.relative_displacement(problem.contact_displacement(solution.p))
    assert solution.residual == problem.natural_residual(solution.p, w)
    assert CondensedNewton(rtol=1e-12, max_it=1)(problem, nothing).status is not Status.CONVERGED


@pytest.mark.parametrize("mu", [1e-4, 0.3, 1.0])
def test_a_surface_that_looks_every_way_has_a_scale_too(mu: float) -> None:
    # the mean normal of a bore is 0: trial tractions scaled by it sent the point at the bottom from side to side
    ring = {"builder": "ring", "inner_radius": 1.0, "outer_radius": 1.5, "mesh_size": 0.1, "cells": "tensor"}
    shaft = {"shape": "cylinder", "point": [0.0, 0.0], "radius": 0.98, "displacement": {"y": -0.04}}
    friction = {"law": "coulomb", "mu": mu}
    scene = from_dict(
        {
            "model": "plane strain",
            "geometry": ring,
            "bodies": {"ring": {"E": 1.0, "nu": 0.3}},
            "obstacles": {"shaft": shaft},
            "contacts": {"bore": {"surface": "ring.inner", "against": "shaft", "friction": friction}},
            "supports": {"housing": {"boundary": "ring.outer", "displacement": {"x": 0.0, "y": 0.0}}},
        }
    )
    (step,) = prepare(scene).steps()
    assert (step.substeps, step.contacts["bore"].normal_force > 0.05) == (1, True)
    assert step.iterations <= 8
