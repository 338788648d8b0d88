"""Steps by a clock: a spring slider and velocity steps to six digits, and the errors that a clock states."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from verification.test_rate_and_state import LAW, SIGMA, column, followed

from shared.audited import record_of
from shared.house import ROOT
from stickslip import Clock, Coulomb, Initial, Scene, SceneError, StepError, Steps, Support, read
from stickslip.geometry.arrays import Array
from stickslip.solvers.results.audit import Auditor
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

STIFF = 1.5 * 5e8  # [Pa/m], of which two thirds let a slider run away


def by_clock(scene: Scene, error: float = 1e-7, smallest: float = 1e-6, largest: float = 100.0) -> Scene:
    """The same scene with a clock."""
    clock = Clock(error=error, smallest=smallest, largest=largest)
    return replace(scene, steps=Steps(end=scene.steps.end, clock=clock))


def test_a_slider_that_creeps_does_so_to_eight_digits() -> None:
    """Source: stress and state by LSODA, and ln V and ln theta by Radau, made for this project."""
    start, far = 4000.0, 0.6 * SIGMA / STIFF
    far_too = far + (start - 1) * 1e-6
    drive = [[0.0, 0.0], [1.0, far], [start, far_too], [start + 50, far_too + 50 * 1.01e-6]]
    f, V = followed(prepare(by_clock(column(STIFF, drive))), np.array([1.0, start, *(start + np.array([10, 20, 50]))]))
    assert_allclose(f[1:], [0.6, 0.60004202, 0.60001669, 0.59989378], atol=2e-8)
    assert_allclose(V[2:], [1.009133e-6, 1.016869e-6, 1.008361e-6], rtol=1e-6)


@pytest.mark.parametrize("evolution", ["aging", "slip"])
def test_a_step_of_the_rate_is_that_of_an_independent_integration(evolution: str) -> None:
    """The same column in traction and ln(theta), by an implicit method of order 5 (Radau)."""
    k, start, a, b, Dc = 10 * STIFF, 4000.0, LAW["a"], LAW["b"], LAW["Dc"]
    far = 0.6 * SIGMA / k
    before = far + (start - 1) * 1e-6
    drive = [[0.0, 0.0], [1.0, far], [start, before], [start + 5, before + 5e-5]]
    later = np.array([0.2, 1.0, 5.0])
    f, _ = followed(prepare(by_clock(column(k, drive, evolution=evolution))), np.array([1.0, start, *start + later]))

    def rates(_: float, y: Array) -> list[float]:
        V = 2e-6 * np.exp(-(0.6 + b * y[1]) / a) * np.sinh(y[0] / a)
        aged = (1e-6 * np.exp(-y[1]) - V) / Dc if evolution == "aging" else -V / Dc * (np.log(V / 1e-6) + y[1])
        return [k / SIGMA * (1e-5 - V), aged]

    exact = solve_ivp(rates, (0, 5), [0.6, 0.0], method="Radau", t_eval=later, rtol=1e-11, atol=1e-13).y[0]
    assert_allclose(f[2:], exact, rtol=1e-7)
    assert np.ptp(exact) > 0.005


def test_dissipation_of_steady_creep_is_friction_times_slip() -> None:
    far = 0.6 * SIGMA / STIFF
    drive = [[0.0, 0.0], [1.0, far], [4000.0, far + 3999e-6], [5000.0, far + 4999e-6]]
    steps = list(prepare(by_clock(column(STIFF, drive))).steps())
    lost = steps[-1].energy.dissipated - steps[-2].energy.dissipated
    assert_allclose(lost, 0.6 * SIGMA * 1e-3, rtol=1e-6)


def test_a_stiff_column_takes_no_more_steps_than_a_soft_one() -> None:
    """It slides as it is driven: a pair that stability holds back would need 30 000 steps."""
    k = 1e4 * STIFF
    far = 0.6 * SIGMA / k
    drive = [[0.0, 0.0], [1.0, far], [4000.0, far + 3999e-6], [5000.0, far + 3999e-6 + 2e-3]]
    steps = list(prepare(by_clock(column(k, drive))).steps())
    assert sum(step.substeps for step in steps) < 300
    last = steps[-1].contacts["base"]
    assert_allclose(last.slip_rate, 2e-6, rtol=1e-8)
    rated = 0.6 + (LAW["a"] - LAW["b"]) * np.log(2.0)
    assert_allclose(np.abs(last.force[0]) / SIGMA, rated, rtol=1e-7)


def test_a_rigid_slab_slips_as_it_is_driven() -> None:
    """A million times as stiff as rock: rates are as it is driven, at all depths, whatever slip has to be known to."""
    meshed = ["geometry.mesh_size=8e3", "geometry.contact_mesh_size=2e3", "output.error=false", "steps.end=4e9"]
    steps = list(prepare(read("fault", [*meshed, "bodies.block.E=8e16"])).steps())
    assert sum(step.substeps for step in steps) < 1000
    assert_allclose(steps[-1].contacts["fault"].slip_rate, 5e-10, rtol=1e-3)


def running_away(error: float, end: float = 700.0, **keys: Any) -> Scene:
    """A slider of half the stiffness that it had to have, in its first events."""
    far = 0.6 * SIGMA / 2.5e8
    return by_clock(column(2.5e8, [[0.0, 0.0], [1.0, far], [end, far + (end - 1) * 1e-6]], damping=1e7, **keys), error)


def test_stated_errors_of_a_clock_hold_and_every_time_of_a_table_is_hit() -> None:
    found = []
    for error in (1e-3, 1e-7):
        simulation = prepare(running_away(error))
        steps = list(simulation.steps())
        assert {1.0, 700.0} < {step.time for step in steps}  # and of events
        found.append((steps, simulation.time_step_errors(steps)))
    (rough, stated), (fine, _) = found
    for key in ("tangential_force", "slip_rate", "state"):
        off = abs(getattr(rough[-1].contacts["base"], key) - getattr(fine[-1].contacts["base"], key))
        said = next(float(parts.time_step) for q, parts in stated[-1].items() if q.quantity == key)
        assert 0 < off < 3 * said, key
        assert said < 100 * off, key


def test_its_steps_pass_the_audit_and_balance_energy() -> None:
    simulation = prepare(running_away(1e-5))
    steps = list(simulation.steps())
    auditor = Auditor(simulation.problem, simulation.mesh)
    audits = [auditor(record_of(step), None) for step in steps]
    assert max(max(vars(each).values()) for each in audits) < 1e-8
    last = steps[-1].energy
    assert_allclose(last.external, last.stored + last.contact, rtol=1e-12)
    assert sum(step.substeps for step in steps) > 100


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"count": 2}, "steps.count = 2: leave it out: the clock finds the steps"),
        ({"clock": {"error": 0.0, "smallest": 1.0, "largest": 2.0}}, "error = 0.0: must lie between 0 and 1"),
        ({"clock": {"error": 1e-4, "smallest": 3.0, "largest": 2.0}}, "largest = 2.0: must not be less than"),
    ],
)
def test_wrong_clocks_are_refused_in_a_line(changes: dict[str, Any], said: str) -> None:
    clock = {"error": 1e-4, "smallest": 1e-3, "largest": 1.0}
    block = {"builder": "block", "length": 1.0, "height": 1.0, "mesh_size": 1.0}
    scene = {"model": "plane strain", "geometry": block, "steps": {"end": 1.0, "clock": clock} | changes}
    with pytest.raises(SceneError, match=said) as refused:
        from_dict(scene)
    assert "\n" not in str(refused.value)


def test_laws_that_a_clock_does_not_follow_are_refused_in_a_line() -> None:
    scene = column(STIFF, [[0.0, 0.0], [1.0, 1e-6]])
    scene = replace(scene, contacts={"base": replace(scene.contacts["base"], friction=Coulomb(mu=0.3))})
    with pytest.raises(SceneError, match=r"contacts.base.friction.law = coulomb: steps.clock does not follow it yet"):
        by_clock(scene)


def test_steps_below_the_smallest_are_given_up_in_a_line() -> None:
    simulation = prepare(running_away(1e-6))
    simulation.stepper.clock = Clock(error=1e-6, smallest=1.0, largest=100.0)
    with pytest.raises(StepError, match="the clock stops: its error asks for steps below smallest = 1 s") as given_up:
        list(simulation.steps())
    assert "\n" not in str(given_up.value)


def test_events_of_a_slider_that_runs_away_return_after_its_period() -> None:
    """Source: by LSODA, 285.794093 s to 1e-8 from the fourth event on, a peak of 3.56607e-3 m/s."""
    end = 2600.0
    scene = stressed(
        STRESSED | {"traction": 0.5 * SIGMA, "state": 10.0}, [[0.0, 0.0], [end, end * 1e-6]], 2.5e8, damping=1e7
    )
    steps = list(prepare(by_clock(scene, error=1e-7)).steps())
    events = [event for step in steps for event in step.events]
    assert_allclose(np.diff([event.start for event in events])[3:], 285.794093, rtol=1e-6)
    assert [event.contact for event in events] == ["base"] * len(events)
    for event in events[3:]:
        assert_allclose(event.rate, 3.56607e-3, rtol=2e-3)
        assert_allclose(event.moment, 1.25e8 * 2 * event.slip, rtol=1e-9)  # G times slip times a metre
        lasts = event.end - event.start
        assert 0.01 < lasts < 1.0
        assert_allclose(event.drop, 2.5e8 * (event.slip - 1e-6 * lasts), rtol=1e-6)  # what the column lets go
        assert event.place == (0.5, 0.0)  # of a point that stands for both nodes
    begun = [step.time for step in steps if step.contacts["base"].slip_rate > 9e-4]
    assert len(begun) == len(events)  # a step is told of where each begins, and where it ends
    assert len(steps) == 2 * len(events) + 1


STRESSED = {"pressure": SIGMA, "traction": 0.6 * SIGMA, "state": "steady"}


def stressed(initial: dict[str, Any], drive: list[list[float]], stiffness: float = STIFF, **friction: Any) -> Scene:
    """A column that stands under initial tractions; its top is held, and drawn along."""
    scene = column(stiffness, drive, **friction)
    top = replace(scene.supports["top"], displacement={"x": drive, "y": 0.0})
    base = replace(scene.contacts["base"], initial=Initial(**initial))
    return replace(scene, supports={"top": top}, contacts={"base": base})


@pytest.mark.parametrize("clock", [True, False])
def test_initial_tractions_and_a_steady_state_go_on_from_the_first_moment(clock: bool) -> None:
    scene = stressed(STRESSED, [[0.0, 0.0], [20.0, 2e-5]])
    simulation = prepare(by_clock(scene, error=1e-9) if clock else scene)
    start = simulation.stepper.start()
    assert_allclose(start.p, [SIGMA, -0.6 * SIGMA if start.p[1] < 0 else 0.6 * SIGMA])
    assert_allclose(start.memory["base"], [[0.0, 1e-6]], rtol=1e-12, atol=1e-12)
    f, V = followed(simulation, np.array([1e-3, 1.0, 20.0]))
    assert_allclose(f, 0.6, rtol=1e-9)
    assert_allclose(V, 1e-6, rtol=1e-6)


def test_the_first_moments_are_those_of_an_independent_integration() -> None:
    """Half the steady traction of a rate on surfaces of another age, stated by a number, in the direction of -x."""
    drive = [[0.0, 0.0], [50.0, -5e-5]]
    given = {"pressure": "1e6", "traction": [-0.595e6, 0.0], "state": 7.0}
    f, _ = followed(prepare(by_clock(stressed(given, drive))), np.array([1.0, 10.0, 50.0]))

    def rates(_: float, y: Array) -> list[float]:
        V = 2e-6 * np.exp(-(0.6 + 0.015 * y[1]) / 0.01) * np.sinh(y[0] / 0.01)
        return [STIFF / SIGMA * (1e-6 - V), (1e-6 * np.exp(-y[1]) - V) / 1e-5]

    exact = solve_ivp(rates, (0, 50), [0.595, np.log(0.7)], "Radau", t_eval=[1, 10, 50], rtol=1e-11, atol=1e-13)
    assert_allclose(f, exact.y[0], rtol=1e-7)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"pressure": 0.0}, "initial.pressure = 0.0: must be positive"),
        ({"rate": 1e-6}, "rate = 1e-06: leave it out, or `state`"),
        ({"state": -1.0}, "initial.state = -1.0: must be positive, in seconds"),
        ({"traction": [1.0, 0.0, 0.0]}, r"initial.traction = .*: expected 2 components"),
        ({"traction": 0.0}, "initial.state = steady: needs a traction"),
        ({"pressure": "1e6 - 2e6*x"}, "initial.pressure = .*: must be positive at every point"),
    ],
)
def test_wrong_initial_tractions_are_refused_in_a_line(change: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError, match=said) as refused:
        prepare(stressed(STRESSED | change, [[0.0, 0.0], [1.0, 1e-6]])).stepper.start()
    assert "\n" not in str(refused.value)


def test_the_ready_slider_has_its_period() -> None:
    steps = list(prepare(read("spring_slider", ["output.error=false"])).steps())
    starts = [event.start for step in steps for event in step.events]
    assert len(starts) == 4
    assert_allclose(starts[3] - starts[2], 285.794093, rtol=1e-6)


def test_the_ready_fault_slips_what_its_far_side_has_gone_ahead() -> None:
    """Coarser by half: events come back, slip nearly what creep at depth has, and start where a is less than b."""
    words = ["geometry.contact_mesh_size=800", "geometry.width=800", "output.error=false"]
    scene = read("fault", [*words, "supports.far.displacement.y=[[0,0],[1.4e10,7]]", "steps.end=1.4e10"])
    events = [event for step in prepare(scene).steps() for event in step.events]
    assert len(events) == 3
    apart = np.diff([event.start for event in events])
    assert_allclose(apart, apart[0], rtol=0.01)
    for event in events[1:]:
        assert 0.85 < event.slip / (0.5e-9 * apart[0]) < 1.0  # the rest creeps before and after
        assert event.place[2] > 25e3
        assert_allclose(event.moment / 32e9 / 800, event.slip * 15e3, rtol=0.15)  # over the depth where a < b
        assert 2e6 < event.drop < 6e6  # (b - a) p ln of nine decades of rate, at the most


def test_coarse_bp1_has_the_interval_of_boundary_elements() -> None:
    """Of eight times the Dc in 50 cells. Source: elements of constant slip of a half-space, made for this project."""
    words = ["geometry.count=50", "contacts.fault.friction.Dc=0.032"]
    steps = prepare(read(ROOT / "workflows/lab/studies/bp1/bp1.toml", words)).steps()
    events = [event for step in steps for event in step.events]
    assert_allclose(np.diff([event.start for event in events]) / 31556926, [182.727], rtol=2e-3)  # years
    assert_allclose([2 * event.rate for event in events], [0.676, 0.650], rtol=0.03)


@pytest.mark.slow
def test_bp3_has_the_published_interval() -> None:
    """In cells of 200 m. Source: Erickson et al., Bull. Seismol. Soc. Am. 113 (2023)."""
    words = ["geometry.count=200", "geometry.length=160e3", "geometry.depth=200e3", "steps.end=1.45e10"]
    steps = list(prepare(read(ROOT / "workflows/lab/studies/bp3/bp3.toml", words)).steps())
    starts = np.array([event.start for step in steps for event in step.events]) / 31556926  # years
    assert_allclose(starts[0], 185, rtol=0.025)  # it is 183.7 with 50 m
    assert_allclose(np.diff(starts)[2:], [89.83], rtol=0.01)
    assert_allclose(steps[-1].contacts["fault"].pressure, 50e6, rtol=1e-8)


def test_points_that_supports_hold_along_the_surface_have_a_state_too() -> None:
    scene = stressed({"pressure": SIGMA, "traction": 0.55 * SIGMA, "rate": 1e-9}, [[0.0, 0.0], [1.0, 1e-6]])
    held = Support(point=(0.0, 0.0), displacement={"x": 0.0})
    simulation = prepare(replace(scene, periodic={}, supports=scene.supports | {"left": held}))
    start = simulation.stepper.start()
    assert_allclose(start.memory["base"][:, 1], 1e-9, rtol=1e-9)
    assert sum(abs(start.p) == 0.55 * SIGMA) == sum(abs(start.p) == SIGMA) - 1  # it carries no shear
