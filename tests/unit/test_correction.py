"""The correction from what a method returned to the exact solution of the same steps."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from shared.cases import often
from shared.problems import SceneOf, SimulationOf
from stickslip.geometry.arrays import EXACT, LAST_DIGITS, Array
from stickslip.geometry.errors import SolverError
from stickslip.solvers.interface.matrix_free import MatrixFreeSurface
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Correction, Solution, Status
from stickslip.solvers.newton import correction, surface_model
from stickslip.solvers.newton.surface_model import Flexibility
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping import certificate
from stickslip.solvers.stepping.state import State

MOVED = {"x": [[0, 0], [1, 0], [2, 0.02]], "y": [[0, 0], [1, -0.05]]}
BASE = {"surface": "block.bottom", "against": "foundation", "friction": {"law": "coulomb", "mu": 0.3}}
DRAGGED: dict[str, Any] = {
    "supports": {"top": {"boundary": "block.top", "displacement": MOVED}},
    "contacts": {
        "base": {"surface": "block.bottom", "against": "foundation", "friction": {"law": "coulomb", "mu": 0.3}}
    },
    "steps": {"end": 2.0, "count": 4},
}


PULLED: dict[str, Any] = {
    "loads": {"pull": {"boundary": "block.top", "traction": [0.02, -0.1]}},
    "contacts": {"base": BASE},
}
FORMS = {"condensed": {"tolerance": 1e-13}, "matrix-free": {"surface": "matrix-free", "method": "surface-uzawa"}}


def states(simulation: Simulation) -> list[State]:
    found = []
    for _ in simulation.steps():
        assert simulation.reported is not None
        found.append(simulation.reported.state)
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


@pytest.mark.parametrize("dense", [True, False])
def test_so_it_is_of_a_floating_body(
    dense: bool, scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not dense:
        monkeypatch.setattr(surface_model, "DENSE", 0)
    (exact,) = states(simulation_of(scene_of(**PULLED, solver={"tolerance": 1e-13})))
    solver = {"method": "surface-uzawa", "surface": "matrix-free", "tolerance": 1e-2}
    (rough,) = states(simulation_of(scene_of(**PULLED, solver=solver)))
    wrong, far = np.abs(exact.p - rough.p).max(), np.abs(exact.w - rough.w).max()
    assert wrong > 1e-4 * np.abs(exact.p).max()
    assert_allclose(rough.p + left(rough).p, exact.p, atol=0.3 * wrong)
    assert_allclose(rough.w + left(rough).w, exact.w, atol=0.3 * far)


def step_of(simulation: Simulation, time: float = 0.5) -> tuple[SurfaceProblem, Array, Array]:
    """The surface problem of the first step, its tractions and relative displacement."""
    stepper = simulation.stepper
    problem = stepper.reach(stepper.start(), time, lambda row: None).problem
    (first, *_) = states(simulation)
    return problem, first.p, first.w


WEAKENING = BASE | {"friction": {"law": "slip_dependent", "mu": [[0, 0.4], [0.02, 0.3]]}}


@pytest.mark.parametrize("method", ["condensed-newton", "uzawa"])
def test_so_it_is_where_mu_depends_on_slip(method: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """Also of the lengths of slip; of condensed-newton all of the error is that of mu and slip by turns."""
    scene = DRAGGED | {"contacts": {"base": WEAKENING}}
    exact = states(simulation_of(scene_of(**scene, solver={"tolerance": 1e-13})))
    rough = states(simulation_of(scene_of(**scene, solver={"method": method, "tolerance": 1e-2})))
    for a, b in zip(exact[1:], rough[1:], strict=True):
        wrong, short = np.abs(a.p - b.p).max(), np.abs(a.memory["base"] - b.memory["base"]).max()
        assert wrong > 1e-5 * np.abs(a.p).max()
        assert short > 1e-5 * a.memory["base"].max()
        assert_allclose(b.p + left(b).p, a.p, atol=0.03 * wrong)
        assert_allclose(b.memory["base"] + left(b).memory["base"], a.memory["base"], atol=0.03 * short)
        assert left(b).size > 0


def test_an_exact_solution_that_is_not_found_in_a_turn_leaves_the_error_unknown(
    scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def lost_at_last(problem: SurfaceProblem, found: Solution) -> tuple[Solution, float]:
        asked.append(problem)
        return found, 1.0 if len(asked) == 1 else np.nan

    monkeypatch.setattr(certificate, "by_schur_complement", lost_at_last)
    scene = scene_of(**DRAGGED | {"contacts": {"base": WEAKENING}}, solver={"tolerance": 1e-2})
    assert np.isnan(left(states(simulation_of(scene))[1]).size)
    assert len(asked) >= 2


def rough_solution(p: Array, w: Array, u_c: Array) -> Solution:
    return Solution(p, w, u_c, Status.STALLED, 0.1, ())


def by_flexibility(
    problem: SurfaceProblem, known: Flexibility, p: Array, w: Array, most: int = correction.SOLVES
) -> Correction:
    exact, size = correction.by_flexibility(problem, known, rough_solution(p, w, np.zeros(0)), most)
    return Correction(exact.p - p, exact.w - w, size)


def perturbed(form: str, simulation: Simulation) -> tuple[SurfaceProblem, Correction, int]:
    """A step whose tractions are changed by up to a fifth, their correction, and its volume solves."""
    problem, p, _ = step_of(simulation)
    p = p * np.random.default_rng(0).uniform(0.8, 1.2, len(p))
    u_c = problem.contact_displacement(p)
    w = problem.relative_displacement(u_c)
    before = problem.surface.counters.error_solves
    if form == "condensed":
        exact, size = correction.by_schur_complement(problem, rough_solution(p, w, u_c))
        found = Correction(exact.p - p, exact.w - w, size)
    else:
        known = simulation.stepper.chain.flexibility(simulation.system, problem.surface)
        found = by_flexibility(problem, known, p, w)
    return problem, found, problem.surface.counters.error_solves - before


@pytest.mark.parametrize("form", FORMS)
def test_its_size_is_the_energy_norm_with_a_margin(form: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """Of a displacement that the tractions dp alone cause: du · S du = - dw · W dp."""
    scene = scene_of(**DRAGGED, solver=FORMS[form])
    problem, found, _ = perturbed(form, simulation_of(scene))
    energy = -float(found.w @ (problem.surface.W * found.p))
    assert energy > 0
    off = 1e-9 if form == "condensed" else 0.15  # the last volume solves are inexact
    assert found.size == pytest.approx(correction.MARGIN * np.sqrt(energy), rel=off)


@pytest.mark.parametrize("form", often(FORMS, ("condensed",)))
def test_it_has_no_unit(form: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """With E 2^60 times as large or small all is the same, but the unit."""
    found = []
    for E in (2.0**-60, 1.0, 2.0**60):
        scene = scene_of(bodies={"block": {"E": E, "nu": 0.3}}, **DRAGGED, solver=FORMS[form])
        _, left, solves = perturbed(form, simulation_of(scene))
        found.append((left.p / E, left.w, left.size / np.sqrt(E), solves))
    for p, w, size, solves in found:
        assert_allclose(p, found[1][0], atol=1e-6 * np.abs(p).max())
        assert_allclose(w, found[1][1], atol=1e-6 * np.abs(w).max())
        assert size == pytest.approx(found[1][2], rel=1e-6)
        assert solves == found[1][3]


@pytest.fixture
def rough(scene_of: SceneOf, simulation_of: SimulationOf) -> tuple[SurfaceProblem, Flexibility, Array, Array]:
    """A step with the bodies matrix-free, what is known of their flexibility, and an inexact solution."""
    simulation = simulation_of(scene_of(**DRAGGED, solver={"method": "surface-uzawa", "surface": "matrix-free"}))
    problem, p, _ = step_of(simulation)
    p = p * np.random.default_rng(0).uniform(0.8, 1.2, len(p))
    known = simulation.stepper.chain.flexibility(simulation.system, problem.surface)
    return problem, known, p, problem.relative_displacement(problem.contact_displacement(p))


def test_without_volume_solves_the_approximate_flexibility_measures_it(
    rough: tuple[SurfaceProblem, Flexibility, Array, Array],
) -> None:
    problem, known, p, w = rough
    before = problem.surface.counters.error_solves
    found = by_flexibility(problem, known, p, w, most=0)
    assert problem.surface.counters.error_solves == before
    assert np.abs(found.p).max() > 0.01 * np.abs(p).max()
    force = problem.surface.forces(found.p)
    assert found.size == pytest.approx(correction.UNSURE * np.sqrt(force @ known.F(force)))
    assert_allclose(found.w, -known(found.p), atol=1e-12 * np.abs(w).max())


@pytest.mark.parametrize("most", [0, correction.SOLVES])
def test_a_rigid_motion_is_taken_back(
    most: int, scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a floating body that has been put somewhere else, with the tractions that are right."""
    solver = {"method": "surface-uzawa", "surface": "matrix-free", "tolerance": 1e-10}
    simulation = simulation_of(scene_of(**PULLED, solver=solver))
    problem, p, w = step_of(simulation, time=1.0)
    surface = problem.surface
    known = simulation.stepper.chain.flexibility(simulation.system, surface)
    moved = surface.N @ (surface.R @ np.array([0.02, -0.01, 0.015]))
    begun, nearest = list[Array](), correction.nearest_in_cone
    monkeypatch.setattr(correction, "nearest_in_cone", lambda *given: begun.append(given[3]) or nearest(*given))
    found = by_flexibility(problem, known, p, w + moved, most)
    for at in begun[1:]:  # at once, so that what follows begins beside the solution
        assert_allclose(at, w, atol=0.1 * np.abs(moved).max())
    assert (len(begun) == 1) == (most == 0)
    assert_allclose(found.w, -moved, atol=0.1 * np.abs(moved).max())  # that much of the residual is left
    assert_allclose(found.p, 0.0, atol=0.1 * np.abs(p).max())


@pytest.mark.parametrize(("contraction", "solves"), [(0.0, correction.SOLVES), (np.inf, 1)])
def test_volume_solves_go_on_until_what_they_add_is_small(
    contraction: float, solves: int, rough: tuple[SurfaceProblem, Flexibility, Array, Array],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    problem, known, p, w = rough
    monkeypatch.setattr(correction, "CONTRACTION", contraction)
    asked, displacement = [], MatrixFreeSurface.displacement

    def watched(self: MatrixFreeSurface, force: Array, error: float = 0.0) -> Array:
        asked.append((force, error))
        return displacement(self, force, error)

    monkeypatch.setattr(MatrixFreeSurface, "displacement", watched)
    by_flexibility(problem, known, p, w)
    assert len(asked) == solves
    assert all(error > 0 for _, error in asked)
    force, error = asked[0]  # nothing is learnt before the first
    assert error == pytest.approx(correction.ACCURACY * np.abs(known.F(force)).max())


def test_where_nothing_is_left_or_nothing_holds_the_bodies_there_is_no_correction(
    rough: tuple[SurfaceProblem, Flexibility, Array, Array], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, known, p, w = rough
    with monkeypatch.context() as patch:
        patch.setattr(correction, "nearest_in_cone", lambda *given: None)
        lost = by_flexibility(problem, known, p, w)
    assert np.isnan(lost.size)
    monkeypatch.setattr(SurfaceProblem, "natural_residual", lambda self, p, w: LAST_DIGITS / 2)
    none = by_flexibility(problem, known, p, w)
    assert none.size == 0.0
    for found in (lost, none):
        assert_array_equal([found.p, found.w], np.zeros((2, len(p))))


def test_slip_counts_from_where_the_exact_solution_has_it(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    base = BASE | {"friction": {"law": "coulomb", "mu": 0.3, "k_T": 4.0}}
    problem, p, w = step_of(simulation_of(scene_of(**DRAGGED | {"contacts": {"base": base}})))
    n = problem.surface.normal_rows
    shifted = correction.exact_problem(problem, Correction(p, w, 1.0))
    assert_array_equal(shifted.gap[:n], problem.gap[:n])
    assert_allclose(shifted.gap[n:], problem.gap[n:] + w[n:] - p[n:] / 4.0)
    assert np.abs(p[n:]).max() > 0
    assert correction.exact_problem(problem, Correction.none(len(p))) is problem


def test_newton_ends_where_it_repeats_itself_and_all_starts_only_where_they_arrive(
    scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, p, _ = step_of(simulation_of(scene_of(**DRAGGED, solver={"tolerance": 1e-13})))
    off = p * np.random.default_rng(0).uniform(0.8, 1.2, len(p))
    u_c = problem.contact_displacement(off)
    found = rough_solution(off, problem.relative_displacement(u_c), u_c)
    exact = correction._newton(problem, found, goal=-1.0)  # no residual is as small
    assert exact is not None
    assert_allclose(exact[0], p, atol=1e-10 * np.abs(p).max())
    arrived = correction._from_all_starts(problem, off, 1e-12)
    assert arrived is not None
    assert_allclose(arrived[0], p, atol=1e-10 * np.abs(p).max())
    monkeypatch.setattr(correction, "MAX_IT", 0)
    assert correction._from_all_starts(problem, off, 1e-12) is None


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
    assert [step.iteration_error for step in simulation.steps()] == pytest.approx([EXACT] * 4, rel=0.5)


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
