"""Rigid bodies whose points of contact give: their systems are solved, and they come to rest."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.problems import pressed, scene_of, surface_problem
from stickslip.solvers.interface.prepare import condensed
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Status
from stickslip.solvers.laws.friction import Coulomb
from stickslip.solvers.methods.condensed_newton import CondensedNewton
from stickslip.solvers.newton import condensed_system
from stickslip.solvers.newton.active_set import linearise
from stickslip.solvers.newton.attempts import Attempts, closed
from stickslip.solvers.newton.rigid_bodies import RigidBodies, at_rest
from stickslip.solvers.newton.semismooth import _Exact
from stickslip.workflows.lab.verification.prepared import prepare

PULLED = {"pull": {"boundary": "block.top", "traction": [0.02, -0.1]}}
BASE = {"gap_offset": 0.3, "friction": {"law": "coulomb", "mu": 0.4}}


@pytest.fixture(scope="module")
def problem() -> SurfaceProblem:
    return surface_problem(prepare(scene_of(base=BASE, loads=PULLED)))


def attempts(problem: SurfaceProblem) -> Attempts:
    return Attempts(problem, _Exact(problem, condensed_system.solve), 1e-10, 500)


@pytest.mark.parametrize("hold", [0.0, 1e-3])
def test_a_system_is_solved_and_springs_hold_bodies_where_they_were(hold: float, problem: SurfaceProblem) -> None:
    bodies, surface = RigidBodies(problem), condensed(problem.surface)
    random = np.random.default_rng(1)
    before = random.normal(size=surface.size)
    p_hat = closed(problem) + random.normal(scale=0.3 * problem.p_ref, size=len(problem.gap))
    laws = linearise(problem, p_hat, problem.gamma)
    laws = laws.proximal(p_hat, 0.1, problem.gamma, hold) if hold else laws
    p, u = bodies.solve(laws, p_hat, before)
    w = bodies.relative(p, u)
    assert_allclose(laws.A_p @ p + laws.A_w @ w, laws.rhs, atol=1e-8 * np.abs(laws.rhs).max())
    forces, R = problem.load.f_c - surface.forces(p), surface.R
    give = u - R @ (R.T @ (u - np.diag(np.asarray(surface.flexibility)) * forces))
    assert_allclose(give, np.diag(np.asarray(surface.flexibility)) * forces, atol=1e-8 * np.abs(u).max())
    moved = R.T @ (u - before)
    assert_allclose(R.T @ forces, hold * surface.rho * moved, atol=1e-8 * np.abs(forces).sum())


def test_a_motion_that_nothing_resists_stays_where_it_stood() -> None:
    """Without friction the block that is pressed down could slide; neither the model nor what follows moves it."""
    down = {"pull": {"boundary": "block.top", "traction": [0.0, -0.1]}}
    problem = surface_problem(prepare(scene_of(base=BASE, loads=down)))
    smooth = tuple(replace(rows, friction=Coulomb(mu=0.0)) for rows in problem.cone.contacts)
    problem = replace(problem, cone=replace(problem.cone, contacts=smooth))
    across = problem.surface.R.T @ np.tile([1.0, 0.0], problem.surface.size // 2)
    start = at_rest(attempts(problem))
    assert start is not None
    for u in (start.u_c, CondensedNewton(rtol=1e-10)(problem, np.zeros_like(problem.gap)).u_c):
        assert abs(across @ (problem.surface.R.T @ u)) < 1e-7 * np.abs(u).max()


def test_a_motion_that_is_not_held_is_refused(problem: SurfaceProblem) -> None:
    laws = linearise(problem, np.zeros_like(problem.gap), problem.gamma)
    with pytest.raises(np.linalg.LinAlgError):
        RigidBodies(problem).solve(laws, problem.gap, problem.u_before)


def test_bodies_come_to_rest_where_contact_and_friction_balance_the_load(problem: SurfaceProblem) -> None:
    """The block of the scene falls through its gap; elastic bodies rest within their deformation of that."""
    tried = attempts(problem)
    start = at_rest(tried)
    assert start is not None
    w = problem.relative_displacement(start.u_c)
    assert problem.imbalance(start.p) < 1e-9
    assert problem.natural_residual(start.p, w) < 1e-9
    assert_allclose(start.p_hat, start.p + problem.gamma * (w - problem.gap))
    assert (start.near, start.in_equilibrium) == (True, False)
    assert (tried.history, tried.best, tried.problem) == ([], None, problem)
    exact = CondensedNewton(rtol=1e-10)(problem, np.zeros_like(problem.gap))
    assert exact.status is Status.CONVERGED
    assert_allclose(start.u_c, exact.u_c, atol=0.1 * np.abs(exact.u_c).max())
    assert np.abs(exact.u_c).max() > 0.29


@pytest.mark.parametrize("what", ["held", "weight", "nothing pushes", "no rest"])
def test_there_is_no_rest_where_there_is_nothing_to_find(
    what: str, problem: SurfaceProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    if what == "held":
        problem = surface_problem(prepare(pressed(2, "unilateral", "coulomb")))
    if what == "weight":
        monkeypatch.setattr(SurfaceProblem, "give", None)
    if what == "nothing pushes":
        monkeypatch.setattr(SurfaceProblem, "p_ref", 0.0)
    if what == "no rest":  # the load pulls the block off
        problem = replace(problem, load=replace(problem.load, resultant=-problem.load.resultant))
    assert at_rest(attempts(problem)) is None
