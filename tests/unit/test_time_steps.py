"""What time steps and iterations leave: errors of works, corrections towards the exact solution, energy in balance."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from shared.cases import slow
from shared.problems import SceneOf, SimulationOf, march
from shared.solved import coarse
from stickslip import Energy, Scene, SolverError, Steps
from stickslip.geometry.arrays import EXACT, LAST_DIGITS, Array
from stickslip.geometry.mesh.mesh import write_msh
from stickslip.geometry.user_files.user_file import UserFile
from stickslip.solvers.interface.matrix_free import MatrixFreeSurface
from stickslip.solvers.interface.problem import SurfaceProblem
from stickslip.solvers.iteration import Correction, Solution, Status
from stickslip.solvers.laws.wear import SLID, WORN
from stickslip.solvers.newton import correction, surface_model
from stickslip.solvers.newton.surface_model import Flexibility
from stickslip.solvers.results.step_result import OPEN, PARTS, SLIP, ErrorParts, Quantity, StepResult, quantities
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping import certificate
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.stepper import StepError, Stepper
from stickslip.workflows.formats.plus_minus import of_parts
from stickslip.workflows.lab.verification.accuracy.problems import PROBLEMS
from stickslip.workflows.scene_file.read import read

BASE: dict[str, Any] = {}
RUBBED = {"friction": {"law": "coulomb", "mu": 0.3}}
LOST = Quantity("contacts", "base", "dissipation_total")
LOST_IN_STEP = Quantity("contacts", "base", "dissipation")
DEEP = {"y": [[0, 0], [1, -0.1]]}
SHEARED = DEEP | {"x": [[0, 0], [1, 0], [2, 0.05]]}


def pressed(scene_of: SceneOf, contact: Any = RUBBED, path: Any = SHEARED, end: float = 2.0, count: int = 8) -> Scene:
    """A block that is pressed, then pushed aside."""
    sizes = {"geometry": {"mesh_size": 0.125}}  # a coarser one resolves it too
    return scene_of(base=contact, top={"x": 0.0} | path, steps={"end": end, "count": count}, **sizes)


def work(step: StepResult) -> dict[str, float]:
    return {key: getattr(step.energy, key) for key in ("external", "stored", "contact", "compliance", "dissipated")}


@pytest.mark.parametrize("count", [1, *slow(2), 3, *slow(4), 5, *slow(6), 8, *slow(11)])
def test_dissipation_of_a_press_in_proportion_has_the_error_that_is_stated(
    count: int, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """Displacements and tractions grow like t: n steps dissipate 1 + 1/n of what friction does."""
    simulation = simulation_of(pressed(scene_of, path={"y": -0.1}, end=1.0, count=count))
    steps = [*simulation.steps()]
    stated = simulation.time_step_errors(steps)
    exact = steps[-1].contacts["base"].dissipation_total * count / (count + 1)
    assert exact > 0
    for step, errors in zip(steps, stated, strict=True):
        since = step.time - 1 / count
        for key, limit in ((LOST, exact * step.time**2), (LOST_IN_STEP, exact * (step.time**2 - since**2))):
            true = getattr(step.contacts["base"], key.quantity) - limit
            assert 0.7 * true < errors[key].time_step < 3 * true  # of cells twice as long, that have twice as much


def test_external_work_has_the_error_that_is_stated(simulation_of: SimulationOf) -> None:
    """It is of second order: twice the difference is up to half as much again."""
    sizes = ["geometry.mesh_size=0.3", "geometry.contact_mesh_size=0.04", "geometry.order=1"]
    scene = read("axisymmetric", [*sizes, "steps.count=4"])
    simulation, many = simulation_of(scene), simulation_of(replace(scene, steps=Steps(count=64)))
    steps, (*_, exact) = [*simulation.steps()], many.steps()
    stated = simulation.time_step_errors(steps)[-1]
    for key in ("external", "contact"):
        true = work(steps[-1])[key] - work(exact)[key]
        assert true > 0.3 * work(exact)["contact"]
        assert 0.7 * true < stated[Quantity("energy", "", key)].time_step < 3 * true


@pytest.mark.parametrize("contact", [BASE, BASE | {"normal": {"law": "compliance", "c_n": 3.0, "m_n": 2.0}}])
def test_without_friction_nothing_is_solved_and_only_works_have_an_error(
    contact: Any, scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = simulation_of(pressed(scene_of, contact | {"gap_offset": 0.02}))
    steps = [*simulation.steps()]
    monkeypatch.setattr(Stepper, "reach", None)
    errors = simulation.time_step_errors(steps)
    for step, its in zip(steps, errors, strict=True):
        for key, parts in its.items():
            works = key.kind == "energy" and key.quantity in ("external", "contact")
            expected = step.energy.time_remainder if works else 0.0
            assert_array_equal(parts.time_step, np.abs(expected) * np.ones(np.shape(parts.time_step)))
    assert steps[-1].energy.time_remainder > 0


@pytest.mark.parametrize("contact", [*slow(BASE), RUBBED])
def test_closing_an_interference_is_no_work_error(contact: Any, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """The first step closes it, however short it is: its part of the remainder does not vanish."""
    scene = pressed(scene_of, contact | {"gap_offset": -0.01}, count=4)
    simulation, many = simulation_of(scene), simulation_of(replace(scene, steps=Steps(end=2.0, count=64)))
    steps, (*_, exact) = [*simulation.steps()], many.steps()
    stated = simulation.time_step_errors(steps)[-1]
    for key in ("external", "contact"):
        true = abs(work(steps[-1])[key] - work(exact)[key])
        assert true > 0.05 * abs(exact.energy.time_remainder) > 0
        assert 0.7 * true < stated[Quantity("energy", "", key)].time_step < 3 * true


def test_the_estimate_leaves_no_trace(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    scene = pressed(scene_of)
    simulation, other = simulation_of(scene), simulation_of(scene)
    steps = [*simulation.steps()]
    before, iterate = replace(simulation.counters), simulation.seconds.iterate
    simulation.time_step_errors(steps)
    solves = simulation.counters.error_solves
    assert simulation.counters == replace(before, error_solves=solves)
    assert 8 + 16 <= solves - before.error_solves <= 5 * (8 + 16)
    assert simulation.seconds.iterate == iterate
    assert simulation.seconds.error > 0
    for one, again in zip(other.steps(), simulation.steps(), strict=True):
        assert_array_equal(again.p, one.p)


def test_steps_alone_between_two_turns_have_their_error(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """One step presses, one pushes, four draw back."""
    path = {"y": [[0, 0], [1, -0.1]], "x": [[0, 0], [1, 0], [2, 0.05], [6, -0.05]]}
    scene = pressed(scene_of, path=path, end=6.0, count=6)
    simulation, many = simulation_of(scene), simulation_of(replace(scene, steps=Steps(end=6.0, count=6 * 16)))
    steps = [*simulation.steps()]
    exact = {round(step.time, 9): step for step in many.steps()}
    for step, its in zip(steps, simulation.time_step_errors(steps), strict=True):
        true = step.contacts["base"].dissipation_total - exact[step.time].contacts["base"].dissipation_total
        assert 0.7 * true < its[LOST].time_step < 3 * true


def test_behind_a_step_that_cannot_be_solved_nothing_is_known(
    scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation, reach = simulation_of(pressed(scene_of)), Stepper.reach
    steps = [*simulation.steps()]
    expected = simulation.time_step_errors(steps)

    def fails(self: Stepper, start: Any, target: float, *rest: Any) -> Any:
        if target == 1.375:  # in the middle of a step
            raise StepError(target, "too hard", (), None)
        return reach(self, start, target, *rest)

    monkeypatch.setattr(Stepper, "reach", fails)
    found = simulation.time_step_errors(steps)
    assert [its[LOST] for its in found] == [*(its[LOST] for its in expected[:5]), *[ErrorParts()] * 3]


@pytest.mark.parametrize("count", [4, 12])
def test_the_mesh_of_a_file_shows_the_error_by_half_of_the_steps(
    count: int, scene_of: SceneOf, simulation_of: SimulationOf, tmp_path: Path
) -> None:
    """Of four times each is alone between two turns; of twelve the first two behind a turn have a price alone."""
    path = {"y": [[0, 0], [1, -0.1]], "x": [[0, 0], [1, 0], [2, 0.05], [3, 0.0], [4, 0.05]]}
    scene = pressed(scene_of, path=path, end=4.0, count=count)
    write_msh(scene.geometry, scene.request(), tmp_path / "block.msh")
    scene = replace(scene, geometry=UserFile(file=str(tmp_path / "block.msh")))
    simulation, many = simulation_of(scene), simulation_of(replace(scene, steps=Steps(end=4.0, count=96)))
    steps, exact = [*simulation.steps()], {round(step.time, 9): step for step in many.steps()}
    found = simulation.time_step_errors(steps)
    known = [its[LOST].time_step is not None for its in found]
    assert known == ([True] * 4 if count == 4 else [False, False, True] * 4)
    for step, its in zip(steps, found, strict=True):
        assert its[LOST].by == "time on its own mesh"
        if its[LOST].time_step is None:
            assert its[LOST].lacking["time_step"] == 2.0
        else:
            limit = exact[round(step.time, 9)].contacts["base"].dissipation_total
            true = step.contacts["base"].dissipation_total - limit
            assert 0.5 * true < its[LOST].time_step < 3 * true


def test_every_number_of_a_step_has_a_key_and_every_part_a_unit(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    scene = replace(pressed(scene_of), probes=scene_of(probes={"tip": {"point": [0.0, 1.0]}}).probes)
    (step, *_) = simulation_of(scene).steps()
    found = {str(key): np.shape(value) for key, value in quantities(step).items()}
    assert found["contacts.base.force"] == found["obstacles.foundation.displacement"] == (2,)
    assert found["contacts.base.normal_force"] == found["supports.top.moment"] == found["energy.external"] == ()
    assert found["probes.tip.stress"] == (6,)
    parts = {part: float(k) for k, part in enumerate(PARTS)}
    assert ErrorParts(**parts).total == 15.0
    assert ErrorParts(**{name: np.array([1.0, 2.0]) for name in PARTS}).total.tolist() == [6.0, 12.0]  # type: ignore
    assert ErrorParts(time_step=1.0).total is ErrorParts(mesh=1.0, converges=False).total is None
    assert ErrorParts(mesh=1.0, converges=True).joined(ErrorParts(time_step=2.0)) == ErrorParts(
        mesh=1.0, time_step=2.0, converges=True
    )


def test_the_total_is_the_sum_of_what_is_there_and_says_what_it_lacks_at_which_price() -> None:
    """A part is left out for its price, or because nothing tells it; that of the mesh decides whether there is one."""
    left = ErrorParts(iteration=1.0, law=2.0, dear={"mesh": 8.0})
    assert left.total == 3.0
    assert left.lacking == {"mesh": 8.0, "geometry": None, "time_step": None, "linear_solver": None}
    mended = left.joined(ErrorParts(mesh=4.0, by="bubbles", unsure=True, dear={"time_step": 3.0}))
    assert (mended.total, mended.by, mended.unsure) == (7.0, "bubbles", True)
    assert mended.lacking == {"geometry": None, "time_step": 3.0, "linear_solver": None}
    both = ErrorParts.added([mended, replace(mended, by="rough", unsure=None)])
    assert (both.total, both.by, both.unsure, both.lacking) == (14.0, "bubbles, rough", True, mended.lacking)
    assert of_parts(0.5, mended) == "0 ± ≥7"


def test_largest_pressure_is_as_uncertain_as_those_around_it(simulation_of: SimulationOf) -> None:
    """Those of six and of three steps agree by chance: their difference alone is a fifth of the error."""
    scene = PROBLEMS["half_disc"].meshed(1, 2.25)
    simulation, many = simulation_of(scene), simulation_of(replace(scene, steps=replace(scene.steps, count=48)))
    steps, (*_, exact) = [*simulation.steps()], many.steps()
    true = abs(steps[-1].contacts["pole"].max_pressure - exact.contacts["pole"].max_pressure)
    stated = simulation.time_step_errors(steps)[-1]
    assert 0.5 * true < stated[Quantity("contacts", "pole", "max_pressure")].time_step < 3 * true
    assert not any(key.quantity in ("pressure", "slip") for key in stated)


def test_what_slides_before_it_touches_is_no_slip(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """A thirtieth of the first step goes by before the touch, in which the block on its soft springs moves aside.

    Of 250 steps the first one ends with the touch.
    """
    tables: dict[str, Any] = {
        "obstacles": {"foundation": {"shape": "plane", "point": [0.0, -0.02], "normal": [0.0, 1.0]}},
        "base": RUBBED,
        "supports": {},
        "springs": {"bed": {"at": "block.top", "stiffness": [0.02, 0.02]}},
        "loads": {"push": {"boundary": "block.top", "force": [0.01, -0.1]}},
    }
    short, many = (scene_of(**tables, steps={"end": 1.0, "count": count}) for count in (8, 250))
    simulation, exact = simulation_of(short), quantities([*simulation_of(many).steps()][-1])
    steps = [*simulation.steps()]
    stated = simulation.time_step_errors(steps)[-1]
    for key in (Quantity("contacts", "base", "tangential_force"), LOST, Quantity("energy", "", "external")):
        true = abs(float(quantities(steps[-1])[key] - exact[key]))
        assert true < 3 * (stated[key].time_step or 0.0) + 1e-12
    force = Quantity("contacts", "base", "tangential_force")
    assert quantities(steps[-1])[force] == pytest.approx(exact[force], rel=1e-9)


def test_what_slipped_sticks_where_the_motion_turns(simulation_of: SimulationOf) -> None:
    """Newton's method begins with that: with all of them slipping on it takes 16 to 18 iterations a turn."""
    steps = simulation_of(read("hysteresis", coarse("hysteresis"))).steps()
    assert max(step.iterations for step in steps) <= 8


MOVED = {"x": [[0, 0], [1, 0], [2, 0.02]], "y": [[0, 0], [1, -0.05]]}
DRAGGED: dict[str, Any] = {"top": MOVED, "base": RUBBED, "steps": {"end": 2.0, "count": 4}}
PULLED: dict[str, Any] = {"loads": {"pull": {"boundary": "block.top", "traction": [0.02, -0.1]}}, "base": RUBBED}
FORMS = {"condensed": {"tolerance": 1e-13}, "matrix-free": {"surface": "matrix-free", "method": "surface-uzawa"}}


def states(simulation: Simulation) -> list[State]:
    return [simulation.reported.state for _ in simulation.steps()]


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
    problem = march(simulation, time)[0].problem
    (first, *_) = states(simulation)
    return problem, first.p, first.w


WEAKENING = {"friction": {"law": "slip_dependent", "mu": [[0, 0.4], [0.02, 0.3]]}}


@pytest.mark.parametrize("method", ["condensed-newton", "uzawa"])
def test_so_it_is_where_mu_depends_on_slip(method: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """Also of the lengths of slip; of condensed-newton all of the error is that of mu and slip by turns."""
    scene = DRAGGED | {"base": WEAKENING}
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
    scene = scene_of(**DRAGGED | {"base": WEAKENING}, solver={"tolerance": 1e-2})
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


@pytest.mark.parametrize("form", FORMS)
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
    monkeypatch: pytest.MonkeyPatch
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
    base = {"friction": {"law": "coulomb", "mu": 0.3, "k_T": 4.0}}
    problem, p, w = step_of(simulation_of(scene_of(**DRAGGED | {"base": base})))
    n = problem.surface.normal_rows
    shifted = correction.exact_problem(problem, Correction(p, w, 1.0))
    assert_array_equal(shifted.gap[:n], problem.gap[:n])
    assert_allclose(shifted.gap[n:], problem.gap[n:] + w[n:] - p[n:] / 4.0)
    assert np.abs(p[n:]).max() > 0
    assert correction.exact_problem(problem, Correction.none(len(p))) is problem
    (name,), worn = (rows.name for rows in problem.cone.contacts), np.linspace(0.1, 0.2, n)
    for key, depth in ((WORN, worn), (SLID, 0 * worn)):
        deeper = correction.exact_problem(problem, Correction(0 * p, 0 * w, 1.0, {f"{name}{key}": worn}))
        assert_allclose(deeper.gap[:n], problem.gap[:n] + depth)
        assert_array_equal(deeper.gap[n:], problem.gap[n:])


def test_newton_ends_where_it_repeats_itself_and_all_starts_only_where_they_arrive(
    scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, p, _ = step_of(simulation_of(scene_of(**DRAGGED, solver={"tolerance": 1e-13})))
    off = p * np.random.default_rng(0).uniform(0.8, 1.2, len(p))
    u_c = problem.contact_displacement(off)
    found = rough_solution(off, problem.relative_displacement(u_c), u_c)
    nearer, _ = correction.by_schur_complement(problem, found)
    assert_array_equal(nearer.w, problem.relative_displacement(nearer.u_c))
    exact = correction._newton(problem, found, goal=-1.0)  # no residual is as small
    assert_allclose(exact[0], p, atol=1e-10 * np.abs(p).max())
    arrived = correction._from_all_starts(problem, off, 1e-12)
    assert_allclose(arrived[0], p, atol=1e-10 * np.abs(p).max())
    monkeypatch.setattr(correction, "MAX_IT", 0)
    assert correction._from_all_starts(problem, off, 1e-12) is None


@pytest.mark.parametrize(
    ("factor", "flips", "solves"),
    [
        (-1.0, False, 2),  # to and fro, with one active set
        (-1.0, True, 12),  # and with another one each time: no end is in sight
        (0.4, False, 6),  # steps that get shorter go on until they are 1 % of the way
    ],
)
def test_newton_goes_on_while_its_steps_get_shorter(
    factor: float,
    flips: bool,
    solves: int,
    scene_of: SceneOf,
    simulation_of: SimulationOf,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem, p, _ = step_of(simulation_of(scene_of(**DRAGGED)))
    u = problem.contact_displacement(p)
    way, asked = (2.0 if flips else 1e-3) * u, list[Array]()

    def scripted(laws: object, given: Array) -> tuple[Array, Array]:
        asked.append(given)
        return p, given + factor ** (len(asked) - 1) * way

    monkeypatch.setattr(correction.condensed_system, "solve", scripted)
    begun = rough_solution(p, problem.relative_displacement(u), u)
    found = correction._newton(problem, begun, goal=-1.0)
    assert len(asked) == solves
    assert asked[0] is u
    assert found is None if flips else found[1] is not u


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


BALANCE = 1e-8  # DESIGN's, relative to the largest term so far
COULOMB = RUBBED["friction"]
PLANE = {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
CLAMPED = {"x": 0.0, "y": 0.0}
PRESS = [[0, 0], [1, -0.05]]
TO_AND_FRO = [[1, 0], [2, 0.06], [3, -0.06], [4, 0.0]]


def history(
    foundation: dict[str, Any] | None = None, contact: dict[str, Any] | None = None, **tables: Any
) -> dict[str, Any]:
    """Four seconds in eight steps."""
    foundation, base = foundation or {}, RUBBED | (contact or {})
    obstacles = {"foundation": foundation if "shape" in foundation else PLANE | foundation}
    return {"obstacles": obstacles, "base": base, "top": CLAMPED, "steps": {"end": 4.0, "count": 8}} | tables


ROLLER = {"shape": "cylinder", "point": [1.0, -5.0], "radius": 5.0}
WEIGHT = {"bodies": {"block": {"E": 1.0, "nu": 0.3, "density": 1.0}}}
HISTORIES: dict[str, dict[str, Any]] = {
    "support": history(top={"x": TO_AND_FRO, "y": PRESS}),
    "obstacle that is moved": history({"displacement": {"x": TO_AND_FRO, "y": [[0, 0], [1, 0.05]]}}),
    "obstacle that a force drives": history(
        {"force": {"y": [[0, 0], [1, 0.1], [4, 0.02]]}, "displacement": {"x": TO_AND_FRO}}
    ),
    "obstacle that turns": history(
        ROLLER
        | {
            "displacement": {"y": [[0, 0], [1, 0.05]]},
            "rotation": {"point": [1.0, -5.0], "angle": [[1, 0], [2, 0.01], [4, -0.01]]},
        }
    ),
    "gravity": history(
        top=None,
        gravity={"acceleration": [[[1, 0], [2, 0.02], [3, -0.02], [4, 0.0]], [[0, 0], [1, -0.1]]]},
        **WEIGHT,
    ),
    "loads": history(
        top=None,
        loads={
            "lid": {"boundary": "block.top", "pressure": [[0, 0], [1, 0.1], [4, 0.05]]},
            "side": {"boundary": "block.right", "traction": [[[1, 0], [2, 0.01], [3, -0.01]], 0.0]},
            "other": {"boundary": "block.left", "force": [0.0, [[2, 0], [3, 0.01], [4, -0.01]]]},
        },
    ),
    "Tresca's bound in time": history(
        contact={
            "normal": {"law": "bilateral"},
            "friction": {"law": "tresca", "bound": [[0, 0.01], [2, 0.005], [3, 0.02], [4, 0.0]]},
        },
        top={"x": TO_AND_FRO, "y": PRESS},
    ),
    "compliance, k_T": history(
        contact={"normal": {"law": "compliance", "c_n": 4.0, "m_n": 1.5}, "friction": COULOMB | {"k_T": 2.0}},
        top={"x": TO_AND_FRO, "y": PRESS},
    ),
    "interference": history(contact={"gap_offset": -0.02}, top={"x": TO_AND_FRO, "y": 0.0}),
    "loaded from the start": history(top={"x": TO_AND_FRO, "y": [[0, -0.05], [4, -0.03]]}),
    "lifted and set down": history(top={"x": TO_AND_FRO, "y": [[0, 0], [1, -0.05], [2.5, 0.01], [4, -0.05]]}),
    "contact that slides": history(ROLLER, {"sliding": True}, top={"x": [[1, 0], [2, 0.5], [4, -0.5]], "y": PRESS}),
    "rolled far by a rigid motion": history(top={"x": [[1, 0], [2, 4.0], [4, -4.0]], "y": PRESS}),
}
PAIR: dict[str, Any] = {
    "geometry": {"builder": "two_blocks", "length": 4.0, "lower_length": 1.0, "height": 0.5, "mesh_size": 0.2,
                 "lower_mesh_size": 0.25, "offset": -1.0},
    "bodies": {"upper": {"E": 1e3, "nu": 0.3}, "lower": {"E": 1.0, "nu": 0.3}},
    "obstacles": {},
    "supports": {
        "drive": {
            "boundary": "upper.top", "displacement": {"x": [[1, 0], [3, 0.8], [4, 0.4]], "y": [[0, 0], [1, -0.02]]},
        },
        "bed": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0}},
    },
    "steps": {"end": 4.0, "count": 8},
}  # fmt: skip


def pair(sliding: bool) -> dict[str, Any]:
    """A stiff block drawn across a soft one."""
    joint = {"surface": "lower.top", "against": "upper.bottom", "friction": COULOMB, "sliding": sliding}
    return PAIR | {"contacts": {"joint": joint}}


def imbalance(energies: list[Energy]) -> float:
    """Largest over the steps, of the totals and of each step's share; beside the largest term so far."""
    terms = np.array([[0.0, 0.0, 0.0], *([e.external, e.stored, e.contact] for e in energies)])
    scale = np.maximum.accumulate(np.abs(terms).max(axis=1))[1:]
    return float(np.max(np.abs(terms[1:] @ [1, -1, -1]) / scale))


@pytest.mark.parametrize("name", HISTORIES)
def test_balance_closes_in_every_step(name: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    steps = list(simulation_of(scene_of(**HISTORIES[name], solver={"tolerance": 1e-12})).steps())
    assert len(steps) >= 8
    assert imbalance([step.energy for step in steps]) <= BALANCE
    for before, step in pairwise(steps):  # friction takes, it never gives
        assert step.energy.dissipated >= before.energy.dissipated - 1e-12 * steps[-1].energy.dissipated
    assert steps[-1].energy.dissipated > 0
    assert any(SLIP in step.contacts["base"].status for step in steps)


@pytest.mark.parametrize("sliding", [False, True])
def test_balance_closes_between_bodies(sliding: bool, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    steps = list(simulation_of(scene_of(**pair(sliding))).steps())
    assert imbalance([step.energy for step in steps]) <= BALANCE
    assert steps[-1].energy.dissipated > 0


OTHERS = "surface-uzawa uzawa inexact-uzawa nonlinear-uzawa gram-uzawa perturbed-lagrangian regularised"


@pytest.mark.parametrize("method", OTHERS.split())
def test_balance_closes_by_each_method(method: str, scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """A method that leaves the laws approximate still leaves the bodies in equilibrium."""
    turned = HISTORIES["support"] | {"steps": {"end": 3.0, "count": 3}, "geometry": {"mesh_size": 0.5}}
    solver = {"method": method, "surface": "matrix-free" if method == "surface-uzawa" else "auto"}
    steps = list(simulation_of(scene_of(**turned, solver=solver)).steps())
    assert imbalance([step.energy for step in steps]) <= BALANCE


def test_balance_closes_over_substeps(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    tables = HISTORIES["lifted and set down"] | {"steps": {"end": 4.0, "count": 1}}
    few = {"method": "condensed-newton", "max_iterations": 3}
    steps = list(simulation_of(scene_of(**tables, solver=few)).steps())
    assert max(step.substeps for step in steps) > 1
    assert imbalance([step.energy for step in steps]) <= BALANCE


def test_remainder_in_time_falls_with_the_step(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """First order: friction works at the end of a step, pressure and tractions change within it."""
    drive = {"x": [[1, 0], [2, 0.1], [4, -0.1]], "y": [[0, 0], [1, -0.02], [4, -0.1]]}  # pressed on while it slips
    counts, remainders = np.array([16, 32, 64]), []
    for count in counts:
        scene = scene_of(**history(top=drive, steps={"end": 4.0, "count": int(count)}))
        *_, last = simulation_of(scene).steps()
        assert last.energy.compliance == 0.0
        remainders.append(abs(last.energy.time_remainder))
    rate = np.polyfit(np.log(counts), np.log(remainders), 1)[0]
    assert abs(rate + 1) < 0.15


def test_contact_that_opens_forgets_its_traction_not_its_slip(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """Pressed and sheared, lifted off, moved back in the air, pressed again: as on the first day, but for the slip."""
    drive = {
        "x": [[1, 0], [2, 0.04], [3, 0.04], [4, 0.01]],
        "y": [[0, 0], [1, -0.05], [2, -0.05], [3, 0.02], [4, 0.02], [5, -0.05]],
    }
    scene = scene_of(base=RUBBED, top=drive, steps={"end": 5.0, "count": 5})
    pressed, sheared, lifted, moved, again = (s.contacts["base"] for s in simulation_of(scene).steps())
    assert sheared.tangential_force > 0.1 * sheared.normal_force
    for open_ in (lifted, moved):
        assert set(open_.status) == {OPEN}
        assert_array_equal(open_.pressure, 0.0)
        assert_array_equal(open_.traction, 0.0)
        assert open_.dissipation == pytest.approx(0.0, abs=1e-15)
    assert np.abs(sheared.slip).max() > 0.01
    # as far as the lid has come and gone: what the points slid in the air counts as well
    back = again.slip[:, 0] - pressed.slip[:, 0]
    assert_allclose(back, 0.01, atol=1e-10)
    assert_allclose(again.pressure, pressed.pressure, rtol=1e-8)
    assert_allclose(again.traction, pressed.traction, atol=1e-8 * pressed.max_pressure)
    assert again.dissipation_total > sheared.dissipation_total > pressed.dissipation_total
