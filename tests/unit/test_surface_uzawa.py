"""Iterations on the surface: Uzawa's with search directions, Gauss-Seidel's point by point, how they end."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import often, slow
from shared.problems import SceneOf, SimulationOf, march, surface_problem
from stickslip import Counters, Scene, SceneError, Simulation
from stickslip.geometry.arrays import Array
from stickslip.solvers.classical.nsgs import NSGS, Sweeps, in_disc
from stickslip.solvers.interface import scales, schur_complement
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.interface.schur_complement import CondensedSurface
from stickslip.solvers.iteration import Driver, Iterate, Solution, Stall, Status, Step
from stickslip.solvers.methods.method import Setup
from stickslip.solvers.methods.surface_uzawa import LearningIteration
from stickslip.solvers.metrics import surface_metric
from stickslip.solvers.newton import surface_model
from stickslip.solvers.newton.surface_model import gmres, nearest_in_cone
from stickslip.solvers.simulation.plan import make_plan
from stickslip.solvers.stepping.state import State
from stickslip.solvers.tangent.operator import chebyshev
from stickslip.workflows.lab.verification.cases import agreement
from stickslip.workflows.scene_file.read import read

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
    "axisymmetric": ("geometry.mesh_size=0.3", "geometry.contact_mesh_size=0.05", "steps.count=4"),
    "ring": ("steps.count=8",),
    "shaft": (),
    "strip": (),  # slender
}
# bending of a strip 20 times as long as high makes inexact volume solves disagree so much that what was learnt is
# refused, and rounding decides how often; half as long, no step of 12 runs with other rounding took over 52 iterations
SHORTER = {"strip": ("geometry.length=1.0",)}


def pressed(scene_of: SceneOf, dim: int, n: int, mu: float, **solver: Any) -> Scene:
    """A block of height 1 with n cells over it: pressed, then dragged."""
    drag = {"x": [[0, 0], [1, 0], [2, 0.02]], "xyz"[dim - 1]: [[0, 0], [1, -0.05]]}
    if dim == 3:
        drag["y"] = [[0, 0], [1, 0], [2, 0.01]]
    friction = {"friction": {"law": "coulomb", "mu": mu}} if mu else {}
    return scene_of(
        dim,
        {"mesh_size": 1 / n, "cells": "tensor"} | ({"length": 1.0} if dim == 3 else {}),
        base=friction,
        top=drag,
        steps={"end": 2.0, "count": 2},
        solver={"method": "surface-uzawa", "surface": "condensed"} | solver,
    )


def solved(simulation: Simulation) -> list[State]:
    """The states of all requested times, reached by the method of the scene alone."""
    reached = march(simulation)
    assert {step.substeps for step in reached} == {1}
    assert not simulation.stepper.chain.switches
    return [step.state for step in reached]


def iterations(simulation: Simulation) -> list[int]:
    """Volume solves of each step after the first measurement."""
    reached = march(simulation)
    assert {step.substeps for step in reached} == {1}
    return [step.iterations for step in reached]


def same_forces(one: list[State], other: list[State], tolerance: float) -> None:
    for a, b in zip(one, other, strict=True):
        size = max(np.abs(f).max() for f in a.forces.values())
        for name, force in a.forces.items():
            assert_allclose(b.forces[name], force, atol=tolerance * size)


def both_ways(
    scene: Scene, simulation_of: SimulationOf, surface: str, tolerance: float = 1e-10
) -> tuple[list[State], list[State]]:
    """States by condensed-newton, and by surface-uzawa on that form of the bodies."""

    def by(method: str, surface: str) -> list[State]:
        solver = replace(scene.solver, method=method, surface=surface, tolerance=tolerance)
        return solved(simulation_of(replace(scene, solver=solver)))

    return by("condensed-newton", "condensed"), by("surface-uzawa", surface)


@pytest.mark.parametrize("name", often(SMALL, ("cube", "shrink_fit", "foundation")))
def test_every_kind_of_scene_has_the_answer_of_condensed_newton(name: str, simulation_of: SimulationOf) -> None:
    answers = both_ways(read(name, SMALL[name]), simulation_of, "condensed", 1e-12)
    same_forces(*answers, tolerance=1e-8 if name in ("block", "strip") else 1e-9)


@pytest.mark.parametrize("name", often(SMALL, ("two_blocks", "sliding", "axisymmetric")))
def test_without_a_matrix_every_kind_of_scene_has_that_answer_too(name: str, simulation_of: SimulationOf) -> None:
    scene = read(name, SMALL[name] + SHORTER.get(name, ()))
    same_forces(*both_ways(scene, simulation_of, "matrix-free"), tolerance=1e-7)


@pytest.mark.parametrize("surface", ["condensed", "matrix-free"])
def test_pressing_and_lifting_off_again_and_again(surface: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """Open contact carries nothing, exactly."""
    scene = pressed(scene_of, 2, 8, 0.3)
    way = {"x": [[0, 0], [1, 0.001]], "y": [[0, 0.01], [1, -0.05], [2, 0.02], [3, -0.03], [4, -0.01]]}
    lifting = scene_of(
        2,
        top=way,
        base={},
        steps={"end": 4.0, "count": 4},
    )
    scene = replace(scene, supports=lifting.supports, steps=lifting.steps)
    exact, found = both_ways(scene, simulation_of, surface)
    size = max(np.abs(state.forces["base"]).max() for state in exact)
    for a, b in zip(exact, found, strict=True):
        assert_allclose(b.forces["base"], a.forces["base"], rtol=0, atol=1e-7 * size)
    assert [bool(state.p.any()) for state in found] == [False, True, False, True, True]


@pytest.mark.parametrize("surface", ["condensed", "matrix-free"])
def test_compliance_with_open_points(surface: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """A block pressed at a slant on springs: one end stays open."""
    soft = {"normal": {"law": "compliance", "c_n": 5.0}, "friction": {"law": "coulomb", "mu": 0.3}}
    scene = pressed(scene_of, 2, 8, 0.3)
    tilted = scene_of(
        2,
        base=soft,
        obstacles={"foundation": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.06, 1.0]}},
    )
    exact, found = both_ways(
        replace(scene, contacts=tilted.contacts, obstacles=tilted.obstacles), simulation_of, surface
    )
    same_forces(exact, found, tolerance=1e-7)
    n = len(found[-1].p) // 2
    closed = found[-1].p[:n] > 0
    assert 0 < closed.sum() < n


@pytest.mark.parametrize("surface", ["condensed", "matrix-free"])
def test_a_side_that_is_partly_supported(
    surface: str, scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows at an edge that is held measure nothing that gives; neither GMRES nor the metric stumbles over them."""
    monkeypatch.setattr(surface_model, "DENSE", 0)
    scene = pressed(scene_of, 3, 4, 0.3)
    still = {"left": {"boundary": "block.left", "displacement": dict.fromkeys("xyz", 0.0)}}
    held = scene_of(3, supports=still)
    push = scene_of(3, loads={"push": {"boundary": "block.top", "pressure": 0.05}})
    scene = replace(scene, supports=held.supports, loads=push.loads)
    same_forces(*both_ways(scene, simulation_of, surface), tolerance=1e-7)


@pytest.mark.parametrize("dim", [2, *slow(3)])
def test_gmres_and_a_dense_matrix_give_the_same(
    dim: int, scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers = []
    for dense in (0, 10_000):
        monkeypatch.setattr(surface_model, "DENSE", dense)
        answers.append(solved(simulation_of(pressed(scene_of, dim, 6, 0.3, tolerance=1e-11))))
    assert not np.array_equal(answers[0][1].p, answers[1][1].p)
    same_forces(*answers, tolerance=1e-9)


def test_inexact_volume_solves_give_the_same(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    ways = ("condensed", "matrix-free")
    answers = [solved(simulation_of(pressed(scene_of, 2, 16, 0.3, tolerance=1e-9, surface=way))) for way in ways]
    same_forces(*answers, tolerance=1e-6)


@pytest.mark.parametrize("case", [(0.3, 3), *slow((0.0, 4), (0.3, 4), (1.0, 4), (3.0, 4))])
def test_volume_solves_do_not_grow_with_the_mesh_in_the_plane(
    case: tuple[float, int], scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    mu, meshes = case
    counts = np.array([iterations(simulation_of(pressed(scene_of, 2, 16 * 2**k, mu))) for k in range(meshes)])
    assert np.ptp(counts, axis=0).max() <= 2
    assert counts.max() <= 14  # 1e-8


@pytest.mark.parametrize("mu", [3.0, *slow(0.3)])
def test_volume_solves_do_not_grow_in_space(mu: float, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    counts = np.array([sum(iterations(simulation_of(pressed(scene_of, 3, n, mu)))) for n in (6, 8, 12)])
    assert_allclose(counts, counts.mean(), rtol=0.2)
    assert counts.max() <= 44  # two steps to 1e-8


def test_what_one_step_learnt_serves_the_next(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """A second step of the same kind is solved in fewer iterations with the pairs of the first."""
    scene = pressed(scene_of, 2, 16, 0.3)
    simulation = simulation_of(scene)
    first, _ = solved(simulation)
    problem = surface_problem(simulation)
    method = LearningIteration(metric=surface_metric(simulation.system), rtol=1e-8)
    fresh = method(problem, np.zeros_like(first.p))
    again = method(problem, np.zeros_like(first.p))
    safe = replace(method, safety=4.0)(problem, np.zeros_like(first.p))
    assert {fresh.status, again.status, safe.status} == {Status.CONVERGED}
    assert again.iterations <= fresh.iterations / 2
    assert safe.iterations > again.iterations  # larger metric, shorter steps, nothing remembered
    assert_allclose(safe.p, fresh.p, atol=1e-6 * problem.p_ref)


def test_it_says_when_it_ran_out_of_iterations(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    simulation = simulation_of(pressed(scene_of, 2, 8, 0.3))
    problem = surface_problem(simulation)
    method = LearningIteration(metric=surface_metric(simulation.system), max_it=3)
    solution = method(problem, np.zeros(problem.cone.size))
    assert (solution.status, solution.iterations, len(solution.history)) == (Status.MAX_IT, 3, 4)
    solves = [step.volume_solves for step in solution.history]
    assert np.diff(solves).tolist() == [1, 1, 1]


def test_a_residual_that_is_no_number_is_never_the_best(
    scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = simulation_of(pressed(scene_of, 2, 8, 0.3))
    problem = surface_problem(simulation)
    method, p = LearningIteration(metric=surface_metric(simulation.system)), np.zeros(problem.cone.size)
    F = method._F(problem.surface)
    flexibility = surface_model.Flexibility(surface=problem.surface, F=F, metric=method.metric)
    w = problem.offset + problem.surface.N @ problem.load.free
    measure, asked = SurfaceProblem.natural_residual, []

    def broken_first(self: SurfaceProblem, p: Array, w: Array) -> float:
        asked.append(measure(self, p, w))
        return np.nan if len(asked) == 1 else asked[-1]

    monkeypatch.setattr(SurfaceProblem, "natural_residual", broken_first)
    found = nearest_in_cone(problem, flexibility, p, w, 1e-8)
    assert found.residual == min(asked[1:]) <= 1e-9


def test_exact_bodies_may_use_all_of_the_tolerance(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """Their volume solves have no error to be added: it ends at the first residual that is small enough."""
    simulation = simulation_of(pressed(scene_of, 2, 8, 0.3))
    problem = surface_problem(simulation)
    metric, p = surface_metric(simulation.system), np.zeros(problem.cone.size)
    residuals = [step.residual for step in LearningIteration(metric=metric, rtol=1e-12)(problem, p).history]
    rtol = 1.0001 * residuals[3]
    assert residuals[3] < min(residuals[:3])
    assert LearningIteration(metric=metric, rtol=rtol)(problem, p).iterations == 3


def test_a_singular_block_of_springs_is_said_as_that(
    scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    def singular(A: object) -> None:
        raise RuntimeError("Factor is exactly singular")

    monkeypatch.setattr(surface_model, "DENSE", 0)
    simulation = simulation_of(pressed(scene_of, 2, 4, 0.3))
    problem = march(simulation, 1.0, 2.0)[-1].problem  # it slips
    monkeypatch.setattr(surface_model, "splu", singular)
    method = LearningIteration(metric=surface_metric(simulation.system), hurried=True)
    solution = method(problem, np.zeros(problem.cone.size))
    assert solution.status in (Status.STALLED, Status.NO_HOLD)  # not a traceback


def test_searches_for_pairs_share_a_factorisation(simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch) -> None:
    made, factor = [], schur_complement._cholesky

    def counted(block: Array) -> Any:
        made.append(len(block))
        return factor(block)

    monkeypatch.setattr(schur_complement, "_cholesky", counted)
    scene = read("sliding")
    scene = replace(scene, solver=replace(scene.solver, method="surface-uzawa", surface="condensed"))
    simulation = simulation_of(scene)
    searches = len({id(state.rows) for state in solved(simulation)})
    assert searches > 1
    surface = simulation.stepper.surface
    assert isinstance(surface, CondensedSurface)
    assert len(made) == 2 * len(surface.S.blocks)  # of the bodies, and of the coarse mesh


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


BLOCK = ("geometry.mesh_size=0.4", "geometry.contact_mesh_size=0.2", "solver.method=nsgs", "solver.tolerance=1e-10")


def first_step(simulation: Simulation, **settings: Any) -> tuple[Sweeps, Any]:
    """The method with these settings, and the problem of the first step."""
    problem = surface_problem(simulation)
    method = NSGS(**settings).build(Setup(system=simulation.system, surface=simulation.stepper.surface))
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
    assert method(problem, np.zeros(problem.cone.size)).residual == 0.0  # the scales say what is rounding
    monkeypatch.setattr(scales, "LAST_DIGITS", 0.0)
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


def test_errors_are_those_of_the_polynomial() -> None:
    low, high, count = 0.1, 2.0, 6
    eigenvalues = np.linspace(0.05, 2.05, 41)
    x, more = np.zeros((2, len(eigenvalues)))
    for again, share in chebyshev(low, high, count):
        more = again * more + share * (1 - eigenvalues * x)
        x = x + more
    polynomial = np.polynomial.chebyshev.Chebyshev.basis(count)
    expected = polynomial((high + low - 2 * eigenvalues) / (high - low)) / polynomial((high + low) / (high - low))
    assert_allclose(1 - eigenvalues * x, expected, atol=1e-12)


def yielding(*residuals: float) -> Iterator[Iterate]:
    return (Iterate(k, residual, np.array([float(k)])) for k, residual in enumerate(residuals))


@pytest.mark.parametrize(
    ("residuals", "status", "rows"),
    [
        ((1.0, 0.5, 0.1, 0.0), Status.CONVERGED, 3),  # as small as is asked for is enough
        ((1.0, np.nan, 0.0), Status.NOT_FINITE, 2),
        ((1.0, np.inf, 0.0), Status.NOT_FINITE, 2),
        ((1.0, 0.9, 0.8, 0.7, 0.0), Status.STALLED, 4),
        ((1.0, 0.9, 0.4, 0.3, 0.3, 0.1), Status.MAX_IT, 6),
        ((1.0, 0.9), Status.NO_HOLD, 2),  # the method goes no further
    ],
)
def test_an_iteration_ends_by_name(residuals: tuple[float, ...], status: Status, rows: int) -> None:
    told: list[Step] = []
    driver = Driver(Counters(volume_solves=7), 0.1 if status is Status.CONVERGED else 0.0, 5, told.append)
    found = driver.run(yielding(*residuals), Stall(2))
    assert (found.status, len(found.history)) == (status, rows)
    assert found.history == tuple(told) == tuple(driver.history)
    assert told[-1].volume_solves == 7
    assert found.p[0] == rows - 1  # the last one
    assert driver.stalled is (status is Status.STALLED)
    assert driver.over is (status in (Status.CONVERGED, Status.MAX_IT))


def test_a_method_may_say_itself_that_it_is_enough_or_that_a_residual_is_not_known() -> None:
    driver = Driver(Counters(), 0.5, 9)
    known = [Iterate(1, 0.1, enough=False), Iterate(2, 0.9, enough=True), Iterate(3, 0.0)]
    assert driver.run([Iterate(0, np.inf, known=False), *known]).history[-1].iteration == 2
    found = Driver(Counters(), 0.0, 9).run(yielding(1.0, 1.0, 1.0), slow=lambda k, residual: k == residual)
    assert (found.status, found.iterations) == (Status.SLOW, 1)


def test_runs_share_history_and_the_best_iterate() -> None:
    driver = Driver(Counters(), 0.0, 9)
    equal = 0.1 * (1 + 1e-14)
    for residuals in ((np.nan,), (0.3, 0.1), (equal, 0.4), (np.nan,)):  # of equal ones the last, and NaN is worst
        driver.run(yielding(*residuals), otherwise=Status.STALLED)
    assert [step.residual for step in driver.history[1:5]] == [0.3, 0.1, equal, 0.4]
    assert (driver.best.p[0], driver.best.status, driver.best.history) == (0.0, Status.STALLED, ())
    driver.run([Iterate(9, 0.2)])
    assert (driver.best.p[0], driver.best.status) == (0.0, Status.MAX_IT)
    driver.run(replace(x, residual=np.inf, known=False) for x in yielding(1.0, 1.0))
    assert driver.best.p[0] == 0.0
    unknown = Driver(Counters(), 0.0, 9)
    unknown.run(replace(x, residual=np.inf, known=False) for x in yielding(1.0, 1.0))
    assert unknown.best.p[0] == 1.0


def test_iterations_that_are_needed_follow_from_the_rate_of_the_last_half() -> None:
    def needed(*residuals: float, status: Status = Status.MAX_IT) -> float:
        history = tuple(Step(k, residual, 0) for k, residual in enumerate(residuals))
        return Solution(nothing, nothing, nothing, status, residuals[-1], history).needs(4.0, 2.0**-8)

    nothing, first = np.zeros(0), (1.0, 2.0, 3.0, 4.0)
    assert needed(*first, 8.0, 4.0, 2.0, 1.0) == pytest.approx(10)
    assert np.isnan(needed(*first, 8.0, 4.0, 2.0, 1.0, status=Status.STALLED))
    assert np.isnan(needed(*first, 8.0, 4.0, 4.0, 1.0))  # it did not fall steadily
    assert np.isnan(needed(8.0, 4.0, 2.0, 1.0))  # too few


def test_a_method_that_reaches_nothing_returns_nothing() -> None:
    driver = Driver(Counters(), 0.0, 9)
    found = driver.run([])
    assert (found.status, found.residual, found.history, driver.stalled) == (Status.NO_HOLD, np.inf, (), False)


def test_what_comes_back_is_the_end_if_it_is_said_so() -> None:
    p, w, u_c = np.random.default_rng(0).normal(size=(3, 2))
    for cycles, rows, status in ((False, 4, Status.NO_HOLD), (True, 2, Status.STALLED)):
        found = Driver(Counters(), 0.0, 9).run([Iterate(k, 1.0, p, w, u_c) for k in range(4)], cycles=cycles)
        assert (len(found.history), found.status, found.p is p, found.w is w) == (rows, status, True, True)
        assert found.u_c is u_c
    assert len(Driver(Counters(), 0.0, 9).run([Iterate(k, 1.0) for k in range(4)]).history) == 4
