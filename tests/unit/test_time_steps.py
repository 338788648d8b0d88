"""The estimated error of the time steps: exact where it is of first order, None where it is not known."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from shared.cases import slow
from shared.problems import SceneOf, SimulationOf
from stickslip.solvers.accuracy import time_steps
from stickslip.solvers.accuracy.time_steps import doubled, halved, stretches
from stickslip.solvers.method_registry import Solver
from stickslip.solvers.results.step_result import PARTS, ErrorParts, Quantity, StepResult, quantities
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.settings import Steps
from stickslip.solvers.simulation.simulation import prepare
from stickslip.solvers.stepping.stepper import StepError, Stepper
from stickslip.workflows.lab.verification.accuracy.problems import PROBLEMS
from stickslip.workflows.scene_file.read import read

BASE = {"surface": "block.bottom", "against": "foundation"}
RUBBED = BASE | {"friction": {"law": "coulomb", "mu": 0.3}}
LOST = Quantity("contacts", "base", "dissipation_total")
LOST_IN_STEP = Quantity("contacts", "base", "dissipation")
DEEP = {"y": [[0, 0], [1, -0.1]]}
SHEARED = DEEP | {"x": [[0, 0], [1, 0], [2, 0.05]]}


def pressed(scene_of: SceneOf, contact: Any = RUBBED, path: Any = SHEARED, end: float = 2.0, count: int = 8) -> Scene:
    """A block that is pressed, then pushed aside."""
    supports = {"top": {"boundary": "block.top", "displacement": {"x": 0.0} | path}}
    return scene_of(contacts={"base": contact}, supports=supports, steps={"end": end, "count": count})


def work(step: StepResult) -> dict[str, float]:
    return {key: getattr(step.energy, key) for key in ("external", "stored", "contact", "compliance", "dissipated")}


@pytest.mark.parametrize("count", [1, *slow(2), 3, *slow(4), 5, *slow(6), 8, *slow(11)])
def test_dissipation_of_a_press_in_proportion_has_the_error_that_is_stated(
    count: int, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """Displacements and tractions grow like t: n steps dissipate 1 + 1/n of what friction does."""
    simulation = simulation_of(pressed(scene_of, path={"y": -0.1}, end=1.0, count=count))
    steps = [*simulation.steps()]
    stated = [errors[LOST].time_step for errors in simulation.time_step_errors(steps)]
    exact = steps[-1].contacts["base"].dissipation_total * count / (count + 1)
    assert exact > 0
    for step, error in zip(steps, stated, strict=True):
        true = step.contacts["base"].dissipation_total - exact * step.time**2
        # the sums of h² are exact; with two histories 1.25 times that; interpolated between times that both have
        assert 1 - 1e-6 < error / true < (1.25 if count < 4 or count == 5 else 1.0) + (step.time < 1) + 1e-6


def test_external_work_has_the_error_that_is_stated(simulation_of: SimulationOf) -> None:
    """It is of second order: the rule for the others would state six times too much."""
    sizes = ["geometry.mesh_size=0.3", "geometry.contact_mesh_size=0.04", "geometry.order=1"]
    scene = read("axisymmetric", [*sizes, "steps.count=4"])
    simulation, many = simulation_of(scene), simulation_of(replace(scene, steps=Steps(count=64)))
    steps, (*_, exact) = [*simulation.steps()], many.steps()
    stated = simulation.time_step_errors(steps)[-1]
    for key in ("external", "contact"):
        true = work(steps[-1])[key] - work(exact)[key]
        assert true > 0.3 * work(exact)["contact"]
        assert stated[Quantity("energy", "", key)].time_step == pytest.approx(true, rel=0.1)


def test_error_of_a_step_is_what_it_adds_to_that_of_all(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    simulation = simulation_of(pressed(scene_of, path={"y": -0.1}, end=1.0, count=8))
    errors = simulation.time_step_errors([*simulation.steps()])
    sums = np.array([each[LOST].time_step for each in errors])
    assert_allclose([each[LOST_IN_STEP].time_step for each in errors], np.diff(sums, prepend=0.0), rtol=1e-6)


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
def test_closing_an_interference_at_once_is_no_error_of_works(
    contact: Any, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """The first step closes it, however short it is: its part of the remainder does not vanish."""
    scene = pressed(scene_of, contact | {"gap_offset": -0.01}, count=4)
    simulation, many = simulation_of(scene), simulation_of(replace(scene, steps=Steps(end=2.0, count=64)))
    steps, (*_, exact) = [*simulation.steps()], many.steps()
    stated = simulation.time_step_errors(steps)[-1]
    for key in ("external", "contact"):
        true = abs(work(steps[-1])[key] - work(exact)[key])
        assert true > 0.05 * abs(exact.energy.time_remainder) > 0
        assert stated[Quantity("energy", "", key)].time_step == pytest.approx(true, rel=0.1)


def test_an_interference_that_cannot_be_closed_leaves_works_unknown(
    scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = simulation_of(pressed(scene_of, BASE | {"gap_offset": -0.01}))
    steps = [*simulation.steps()]

    def fails(self: Stepper, start: Any, target: float, *rest: Any) -> Any:
        raise StepError(target, "too hard", (), None)

    monkeypatch.setattr(Stepper, "reach", fails)
    (*_, last) = simulation.time_step_errors(steps)
    assert {str(key) for key, parts in last.items() if parts.time_step is None} == {"energy.external", "energy.contact"}


def test_the_estimate_leaves_no_trace(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    scene = pressed(scene_of)
    simulation, other = simulation_of(scene), simulation_of(scene)
    steps = [*simulation.steps()]
    before, iterate = replace(simulation.counters), simulation.seconds.iterate
    simulation.time_step_errors(steps)
    solves = simulation.counters.error_solves
    assert simulation.counters == replace(before, error_solves=solves)
    assert 4 + 2 <= solves - before.error_solves <= 3 * (4 + 2)
    assert simulation.seconds.iterate == iterate
    assert simulation.seconds.error > 0
    for one, again in zip(other.steps(), simulation.steps(), strict=True):
        assert_array_equal(again.p, one.p)


def test_steps_alone_between_two_turns_are_halved(scene_of: SceneOf, simulation_of: SimulationOf) -> None:
    """One step presses, one pushes, four draw back."""
    path = {"y": [[0, 0], [1, -0.1]], "x": [[0, 0], [1, 0], [2, 0.05], [6, -0.05]]}
    scene = pressed(scene_of, path=path, end=6.0, count=6)
    simulation, many = simulation_of(scene), simulation_of(replace(scene, steps=Steps(end=6.0, count=6 * 16)))
    steps = [*simulation.steps()]
    exact = {round(step.time, 9): step for step in many.steps()}
    assert stretches([step.time for step in steps], scene.timeline()) == ((1.0,), (2.0,), (3.0, 4.0, 5.0, 6.0))
    for step, its in zip(steps, simulation.time_step_errors(steps), strict=True):
        true = step.contacts["base"].dissipation_total - exact[step.time].contacts["base"].dissipation_total
        assert 0.7 * true < its[LOST].time_step < 3 * true


@pytest.mark.parametrize(("count", "known"), [(2, False), (4, True)])
def test_iterative_solves_are_not_spent_on_twice_the_steps(
    count: int, known: bool, scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """Two steps, each between two turns; then two of each."""
    scene = replace(pressed(scene_of, count=count), solver=Solver(method="surface-uzawa", surface="matrix-free"))
    simulation = simulation_of(scene)
    steps = [*simulation.steps()]
    before = simulation.counters.error_solves
    errors = simulation.time_step_errors(steps)
    assert (simulation.counters.error_solves > before) == known
    assert all((parts.time_step is not None) == known for its in errors for parts in its.values())


@pytest.mark.parametrize("when", [1.5, 1.0])
def test_behind_a_step_that_cannot_be_solved_nothing_is_known(
    when: float, scene_of: SceneOf, simulation_of: SimulationOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation, reach = simulation_of(pressed(scene_of)), Stepper.reach
    steps = [*simulation.steps()]
    expected = simulation.time_step_errors(steps)

    def fails(self: Stepper, start: Any, target: float, *rest: Any) -> Any:
        if target - start.time > 0.4 and target >= when:
            raise StepError(target, "too hard", (), None)
        return reach(self, start, target, *rest)

    monkeypatch.setattr(Stepper, "reach", fails)
    for step, found, usual in zip(steps, simulation.time_step_errors(steps), expected, strict=True):
        assert all((parts.time_step is None) == (step.time > when - 0.5) for parts in found.values())
        if step.time <= when - 0.5:  # without the shortest history: two are compared
            assert found[LOST].time_step >= 0.99 * usual[LOST].time_step


def test_from_a_step_of_the_run_that_was_cut_on_nothing_is_known(
    scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    simulation = simulation_of(pressed(scene_of))
    steps = [replace(step, substeps=2 if step.time == 1.5 else 1) for step in simulation.steps()]
    for step, its in zip(steps, simulation.time_step_errors(steps), strict=True):
        assert all((parts.time_step is None) == (step.time >= 1.5) for parts in its.values())


def test_dissipation_where_slip_begins_within_a_step_is_not_taken_for_exact(simulation_of: SimulationOf) -> None:
    """`foundation`: one, two and four steps dissipate the same, which is .2 % less than the limit."""
    scene = read("foundation", ["geometry.mesh_size=0.25"])
    simulation, many = simulation_of(scene), simulation_of(replace(scene, steps=replace(scene.steps, count=32)))
    steps, (*_, exact) = [*simulation.steps()], many.steps()
    stated = simulation.time_step_errors(steps)[-1]
    true = abs(quantities(steps[-1])[LOST] - quantities(exact)[LOST])
    assert true > 1e-3 * quantities(exact)[LOST]
    assert 0.5 < stated[LOST].time_step / true < 3
    assert_allclose(stated[Quantity("energy", "", "dissipated")].time_step, stated[LOST].time_step)


def test_histories_keep_every_turn() -> None:
    plan: tuple[tuple[float, ...], ...] = ((1.0, 2.0, 3.0), (4.0,), (5.0, 6.0), (7.0, 8.0, 9.0, 10.0, 11.0))
    half = tuple(map(halved, plan))
    assert half == ((3.0,), (4.0,), (6.0,), (9.0, 11.0))
    assert tuple(map(halved, half)) == ((3.0,), (4.0,), (6.0,), (11.0,))
    assert doubled(half, [len(stretch) == 1 for stretch in plan])[1] == (3.5, 4.0)
    for count in range(2, 50):
        times = tuple(float(k) for k in range(1, count + 1))
        half = halved(times)  # type: ignore[assignment]
        assert len(half) == count // 2
        assert half[-1] == times[-1]
        assert {b - a for a, b in pairwise((0.0, *half))} <= {2.0, 3.0}  # type: ignore[arg-type]


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
    assert ErrorParts(mesh=1.0).total is None
    assert ErrorParts(mesh=1.0, converges=True).joined(ErrorParts(time_step=2.0)) == ErrorParts(
        mesh=1.0, time_step=2.0, converges=True
    )


def test_no_more_is_stated_of_a_step_than_its_tractions_changes_can_do(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the last of three steps between two turns most slips at constant traction: shorter histories do not see it."""
    simulation = prepare(PROBLEMS["half_disc"].meshed(1, 2.25))
    steps = [*simulation.steps()]

    def stated() -> float:
        error = simulation.time_step_errors(steps)[-1][Quantity("contacts", "pole", "dissipation")].time_step
        assert isinstance(error, float)
        return error

    last, before = steps[-1].contacts["pole"], steps[-2].contacts["pole"]
    work = (last.weight * np.abs(((last.traction - before.traction) * last.slip_increment).sum(axis=1))).sum()
    assert_allclose(stated(), 3 * work, rtol=1e-9)
    monkeypatch.setattr(time_steps, "TURNED", np.inf)
    assert stated() > 6 * work


def test_largest_pressure_is_as_uncertain_as_those_around_it(simulation_of: SimulationOf) -> None:
    """Those of six and of three steps agree by chance: their difference alone is a fifth of the error."""
    scene = PROBLEMS["half_disc"].meshed(1, 2.25)
    simulation, many = simulation_of(scene), simulation_of(replace(scene, steps=replace(scene.steps, count=48)))
    steps, (*_, exact) = [*simulation.steps()], many.steps()
    true = abs(steps[-1].contacts["pole"].max_pressure - exact.contacts["pole"].max_pressure)
    stated = simulation.time_step_errors(steps)[-1]
    assert 0.5 * true < stated[Quantity("contacts", "pole", "max_pressure")].time_step < 3 * true
    assert not any(key.quantity in ("pressure", "slip") for key in stated)


def test_what_slides_before_it_touches_counts_where_all_steps_are_longer(
    scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """A thirtieth of the first step goes by before the touch, in which the block on its soft springs moves aside."""
    tables: dict[str, Any] = {
        "obstacles": {"foundation": {"shape": "plane", "point": [0.0, -0.02], "normal": [0.0, 1.0]}},
        "contacts": {"base": RUBBED},
        "supports": {},
        "springs": {"bed": {"at": "block.top", "stiffness": [0.02, 0.02]}},
        "loads": {"push": {"boundary": "block.top", "force": [0.01, -0.1]}},
    }
    short, many = (scene_of(**tables, steps={"end": 1.0, "count": count}) for count in (8, 256))
    simulation, exact = simulation_of(short), quantities([*simulation_of(many).steps()][-1])
    steps = [*simulation.steps()]
    stated = simulation.time_step_errors(steps)[-1]
    for key in (Quantity("contacts", "base", "tangential_force"), LOST, Quantity("energy", "", "external")):
        true = abs(float(quantities(steps[-1])[key] - exact[key]))
        assert true > 1e-3 * exact[key]
        assert 0.7 < (stated[key].time_step or 0.0) / true < 3
