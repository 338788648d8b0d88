"""The method `nsgs`: point by point on the Delassus operator, to the answer that Newton's method finds."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import slow
from shared.problems import SimulationOf
from stickslip.geometry.errors import SceneError
from stickslip.solvers.classical.nsgs import NSGS, Sweeps, in_disc
from stickslip.solvers.iteration import Status
from stickslip.solvers.methods.method import Setup
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.lab.verification.cases import agreement
from stickslip.workflows.scene_file.read import read

BLOCK = ("geometry.mesh_size=0.4", "geometry.contact_mesh_size=0.2", "solver.method=nsgs", "solver.tolerance=1e-10")


def first_step(simulation: Simulation, **settings: Any) -> tuple[Sweeps, Any]:
    """The method with these settings, and the problem of the first step."""
    stepper = simulation.stepper
    problem = stepper.reach(stepper.start(), 1.0, lambda row: None).problem
    method = NSGS(**settings).build(Setup(system=stepper.system, surface=stepper.surface))
    assert isinstance(method, Sweeps)
    return method, problem


@pytest.mark.parametrize(
    "name", [*slow("block"), "block, in one step", "cube", "cylinders", "shrink_fit, its shaft held"]
)
def test_it_finds_what_newton_finds(name: str) -> None:
    found, expected = (agreement.solve(name, method).quantities() for method in ("nsgs", "condensed-newton"))
    off = agreement.apart(found, expected)
    assert max(off.values()) < agreement.AGREEMENT, off


@pytest.mark.parametrize("m_n", [*slow(1.0), 2.0])
def test_each_quadrature_point_of_a_compliant_face_is_a_point(m_n: float, simulation_of: SimulationOf) -> None:
    law = f'contacts.base.normal={{law="compliance", c_n=20.0, m_n={m_n}}}'
    scene = read("block", [*BLOCK, law, "solver.tolerance=1e-11"])
    found, expected = (
        list(simulation_of(replace(scene, solver=replace(scene.solver, method=method))).steps())
        for method in ("nsgs", "condensed-newton")
    )
    for one, other in zip(found, expected, strict=True):
        assert_allclose(one.p, other.p, rtol=0, atol=1e-8 * np.abs(other.p).max())
        assert one.substeps == 1


def test_the_operator_is_what_tractions_do(simulation_of: SimulationOf) -> None:
    """w = N F f + offset - D W p, D symmetric and positive on the rows."""
    method, problem = first_step(simulation_of(read("block", BLOCK)))
    p = np.random.default_rng(1).normal(size=problem.cone.size)
    loaded = problem.relative_displacement(problem.load.free)
    expected = problem.relative_displacement(problem.contact_displacement(p))
    found = loaded - method.D @ (problem.surface.W * p)
    assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())
    assert_allclose(method.D, method.D.T, atol=1e-14 * np.abs(method.D).max())
    assert np.linalg.eigvalsh(method.D).min() > 0


def test_the_residual_is_that_of_the_tractions_that_it_returns(simulation_of: SimulationOf) -> None:
    method, problem = first_step(simulation_of(read("block", BLOCK)), rtol=1e-12, max_it=5)
    start = np.zeros(problem.cone.size)
    solution = method(problem, start)
    assert (solution.status, solution.iterations) == (Status.MAX_IT, 5)
    assert not start.any()  # what it starts from stays as it is
    w = problem.relative_displacement(problem.contact_displacement(solution.p))
    assert solution.residual == problem.natural_residual(solution.p, w)
    residuals = [step.residual for step in solution.history]
    assert residuals[-1] < residuals[0]


def test_what_rounding_forbids_stalls_by_name(simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stickslip.solvers.classical.nsgs.PATIENT", 20)
    method, problem = first_step(simulation_of(read("block", BLOCK)), rtol=1e-18)
    assert method(problem, np.zeros(problem.cone.size)).status is Status.STALLED


def test_what_is_no_number_ends_by_name(simulation_of: SimulationOf) -> None:
    method, problem = first_step(simulation_of(read("block", BLOCK)))
    assert method(problem, np.full(problem.cone.size, np.nan)).status is Status.NOT_FINITE


@pytest.mark.parametrize("bound", [0.0, 1e-3, 0.7, 5.0, np.inf])
def test_a_point_answers_its_own_problem(bound: float) -> None:
    """Inside the disc nothing slips; on its edge what is left over points along the traction."""
    random = np.random.default_rng(3)
    for _ in range(50):
        give, asked = random.uniform(0.1, 10.0, 2), random.normal(size=2) * 3
        t = in_disc(give, asked, bound)
        slip = asked - give * t
        if np.linalg.norm(t) < bound * (1 - 1e-12):
            assert_allclose(slip, 0.0, atol=1e-14)
        elif bound:
            assert np.linalg.norm(t) == pytest.approx(bound, rel=1e-14)
            assert slip @ t == pytest.approx(np.linalg.norm(slip) * bound, rel=1e-12)


def test_bodies_must_be_held() -> None:
    with pytest.raises(SceneError, match=r"solver\.method = nsgs: needs bodies that their supports hold"):
        make_plan(read("shrink_fit", ["solver.method=nsgs"]))
