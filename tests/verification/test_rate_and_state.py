"""Friction of rate and state: velocity steps in closed form, and a sheared column as a spring slider."""

import re
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import sparse

import stickslip
from shared.audited import record_of
from stickslip import Scene, SceneError, Simulation
from stickslip.geometry.arrays import Array
from stickslip.solvers.laws.law import FrictionLaw, Trial
from stickslip.solvers.laws.normal import Unilateral
from stickslip.solvers.laws.rate_and_state import RateAndState, RateAndStateByPoint
from stickslip.solvers.results.audit import Auditor
from stickslip.solvers.results.closed_formulas import bound
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

LAW = {"law": "rate_and_state", "f0": 0.6, "a": 0.010, "b": 0.015, "Dc": 1e-5, "V0": 1e-6}
SIGMA = 1e6  # [Pa]
STEP = {  # f after a slip at ten times the rate of before, in steady sliding
    "aging": {2e-6: 0.620354332, 1e-5: 0.610404327, 5e-5: 0.589370184},
    "slip": {2e-6: 0.616765033, 1e-5: 0.601193180, 5e-5: 0.588719795},
}
F0, V0 = LAW["f0"], LAW["V0"]
A, B, DC = np.array([[0.01, 0.012, 0.015, 0.02], [0.015, 0.013, 0.01, 0.005], [1e-5, 2e-5, 4e-5, 1e-5]])  # of points
AGED, RATES = np.array([[-1.0, 0.0, 0.5, 2.0], [1e-7, 1e-6, 2e-5, 1e-3]])  # ln(V0 theta / Dc), and V [m/s]
MEMORY = np.column_stack([AGED, RATES])
MEANS = sparse.csr_matrix([[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 1.0]])  # of pressures
PRESSED = np.array([0.2, 0.4, -0.1])  # [MPa]: the last point is open


def by_point(**numbers: Any) -> RateAndStateByPoint:
    """The law at four points, each with its own a, b and Dc."""
    return RateAndStateByPoint(of=RateAndState(**LAW | numbers), a=A, b=B, Dc=DC)


def column(stiffness: float, drive: list[list[float]], **friction: Any) -> Scene:
    """A unit column under SIGMA, whose top moves so far in time; stiffness [Pa/m] of its shear."""
    supports = {
        "top": {"boundary": "block.top", "displacement": {"x": drive, "y": [[0, 0], [1, -SIGMA / stiffness / 2]]}}
    }
    base = {"surface": "block.bottom", "against": "floor", "friction": LAW | friction}
    return from_dict(
        {
            "model": "plane strain",
            "geometry": {"builder": "block", "length": 1.0, "height": 1.0, "mesh_size": 1.0},
            "bodies": {"block": {"E": 2 * stiffness, "nu": 0.0}},
            "obstacles": {"floor": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
            "contacts": {"base": base},
            "periodic": {"walls": {"boundary": "block.right", "with": "block.left"}},
            "supports": supports,
            "steps": {"end": drive[-1][0], "count": 10, "seconds": True},
            "solver": {"tolerance": 1e-11},
        }
    )


def followed(simulation: Simulation, times: Array) -> tuple[Array, Array]:
    """Friction over SIGMA, and slip rate [m/s], at these times [s]."""
    stepper, found = simulation.stepper, []
    state, n = stepper.start(), stepper.surface.normal_rows
    for time in times:
        state = stepper.reach(state, float(time), lambda row: None).state
        found.append((np.abs(state.p[n:]).max() / SIGMA, state.memory["base"][:, 1].max()))
    return tuple(np.array(found).T)


@pytest.mark.parametrize("evolution", STEP)
@pytest.mark.parametrize("substeps", [1, 5])
def test_a_state_at_constant_rate_is_exact_in_any_number_of_steps(evolution: str, substeps: int) -> None:
    one = np.ones(1)
    law = RateAndState(**{k: v for k, v in LAW.items() if k != "law"}, evolution=evolution).placed(
        one[:, None], 1.0, 1.0
    )
    for slip, f in STEP[evolution].items():
        memory = law.memory(1)
        for _ in range(substeps):
            memory = law.after(memory, slip / substeps * one, slip / substeps / 1e-5)
        assert_allclose(law.coefficient(*memory.T)[0], f, rtol=2e-9)


@pytest.mark.parametrize("unit", [1.0, 1e6])  # of stress [MPa], [Pa]
@pytest.mark.parametrize("evolution", STEP)
@pytest.mark.parametrize(  # |t_hat| over the pressure, from 1e-30 to 1 m/s
    ("size", "step"), [(0.0, 1e-3), (1e-3, 1e-3), (1e-3, 1e4), (0.7, 1e-3), (3.0, 1e-3), (50.0, 1e-3)]
)
def test_the_traction_of_a_rate_is_that_of_its_law_and_has_its_derivatives(
    evolution: str, size: float, step: float, unit: float
) -> None:
    gamma, p, h = np.array([0.1, 0.2, 0.1, 0.1]) * unit / step, PRESSED * unit, 1e-5
    strength = F0 if size else 10 * F0  # then no number is as small as the rate of nothing
    law, whole = by_point(evolution=evolution, damping=1e-2 * unit, f0=strength), size * np.abs(MEANS @ p)
    now = law.within(MEMORY, step)

    def bound(size: Array, p: Array) -> Array:
        return now.dragged(p, MEANS, Trial(size, gamma)).bound

    found = now.dragged(p, MEANS, Trial(whole, gamma))
    slip = np.maximum(whole - found.bound, 0.0) / gamma
    ended = law.at(law.after(MEMORY, slip, step)).limit(p, MEANS, Unilateral(), 1.0, 1.0)
    creep = np.where(MEANS @ p > 0, whole, 0.0)  # the slowest slip is lost in rounding
    assert_allclose(found.bound, ended if size > 0.1 else creep, rtol=1e-6, atol=1e-30)
    slope = (bound(whole * (1 + h), p) - bound(whole * (1 - h), p)) / (2 * h) / np.maximum(whole, 1e-9)
    assert_allclose(found.by_trial, slope if size else MEANS @ p > 0, rtol=1e-4, atol=1e-7)
    for k, own in enumerate(np.eye(3) * h):
        slope = (bound(whole, p * (1 + own)) - bound(whole, p * (1 - own))) / (2 * h * p[k])
        assert_allclose(found.by_pressure.toarray()[:, k], slope, rtol=1e-4, atol=1e-7)


def test_each_point_has_its_own_numbers() -> None:
    law = RateAndState(**LAW | {"a": "0.01 + 0.01*x", "b": "0.01*y", "Dc": "1e-5*(1 + x)"}, theta=0.5)
    numbers = np.array([[0.01, 0.015, 0.02], [0.01, 0.0, 0.02], [1e-5, 1.5e-5, 2e-5]])
    placed = law.placed(np.array([[0.0, 1.0], [0.5, 0.0], [1.0, 2.0]]), 1.0, 1.0)
    for here, found in ((placed, numbers), (placed.of_points(np.array([2, 0])), numbers[:, [2, 0]])):
        assert isinstance(here, RateAndStateByPoint)
        assert_allclose([here.a, here.b, here.Dc], found)
        assert_allclose(here.memory(len(here.a)).T, [np.log(0.5 * V0 / here.Dc), 0 * here.Dc])
    assert_array_equal(by_point().memory(4), np.zeros((4, 2)), strict=True)


@pytest.mark.parametrize("make", [lambda: RateAndState(**LAW), by_point, lambda: by_point().within(MEMORY, 1.0)])
def test_its_bound_without_slip_is_that_of_f0_and_nothing_limits_it(make: Callable[[], FrictionLaw]) -> None:
    law, now = make(), (Unilateral(), 1.0, 1.0)
    assert_allclose(law.limit(PRESSED, MEANS, *now), [0.12, 0.18, 0.216, 0.0])
    assert law.lines(*now) == (np.inf, 0.0, np.inf)
    assert not law.homogeneous(*now)
    assert law.amplitudes() == {}
    assert law.resists()


def test_friction_is_its_formula_and_has_one_rate_for_each_traction() -> None:
    law, h = by_point(damping=1e5), 1e-5
    least = np.exp(law.ln_least(AGED))
    for rates in (least * np.array([0.1, 0.5, 1.0, 2.0]), RATES):
        f, by_rate, by_state = law.coefficient(AGED, rates)
        assert_allclose(f, A * np.arcsinh(rates / (2 * V0) * np.exp((F0 + B * AGED) / A)), rtol=1e-12)
        ends = [law.coefficient(AGED, rates * np.exp(sign * h))[0] for sign in (1, -1)]
        assert_allclose(by_rate, (ends[0] - ends[1]) / (2 * h), rtol=1e-8)
        ends = [law.coefficient(AGED + sign * h, rates)[0] for sign in (1, -1)]
        assert_allclose(by_state, (ends[0] - ends[1]) / (2 * h), rtol=1e-7)
    assert_allclose(law.coefficient(AGED, least)[0], A * np.arcsinh(1.0), rtol=1e-12)
    assert_array_equal(law.coefficient(AGED, np.zeros(4)), 0.0)
    for rates in (RATES, np.full(4, 10.0), least, np.zeros(4)):
        p = np.array([1.0, 2.0, 1e6, 0.0])
        size = law.coefficient(AGED, rates)[0] * p + 1e5 * rates
        assert_allclose(law.rate(AGED, size, p), np.where(p > 0, rates, 0.0), rtol=1e-12)
    ended = law.at(MEMORY).limit(PRESSED, MEANS, Unilateral(), 1.0, 1.0)
    assert_allclose(ended, np.where(MEANS @ PRESSED > 0, f * (MEANS @ PRESSED) + 1e5 * RATES, 0.0))
    still = law.within(MEMORY, 0.0).limit(PRESSED, MEANS, Unilateral(), 1.0, 1.0)
    assert_array_equal(still, ended)
    assert_array_equal(law.after(MEMORY, RATES, 0.0), MEMORY)
    assert_array_equal(law.rates(MEMORY), RATES)


@pytest.mark.parametrize("evolution", STEP)
@pytest.mark.parametrize("rates", [RATES, 100 * RATES, 0 * RATES])
def test_a_state_follows_its_differential_equation(evolution: str, rates: Array) -> None:
    law, h, step = by_point(evolution=evolution), 1e-5, 0.1
    theta = law.ages(MEMORY)
    assert theta is not None
    assert_allclose(theta, DC / V0 * np.exp(AGED))
    by_time = {"aging": 1 - rates * theta / DC, "slip": -rates * theta / DC * np.log(rates * theta / DC + (rates == 0))}
    assert_allclose(theta * law.evolves(AGED, rates), by_time[evolution], atol=1e-13)
    begun = (law.state(AGED, rates, 1e-7)[0] - law.state(AGED, rates, 0.0)[0]) / 1e-7
    assert_allclose(begun, law.evolves(AGED, rates), rtol=1e-2, atol=1e-5)
    half = law.state(law.state(AGED, rates, step / 2)[0], rates, step / 2)[0]
    whole, by_rate = law.state(AGED, rates, step)
    assert_allclose(half, whole, rtol=1e-12, atol=1e-12)
    ends = [law.state(AGED, rates * np.exp(sign * h), step)[0] for sign in (1, -1)]
    assert_allclose(by_rate, (ends[0] - ends[1]) / (2 * h), rtol=1e-6, atol=1e-9)
    assert_allclose(law.after(MEMORY, rates * step, step), np.column_stack([whole, rates]))


def test_initial_tractions_begin_with_the_state_or_the_rate_that_is_given() -> None:
    law, p, size = by_point(damping=1 / 256), np.array([0.5, 1.0, 1.5, 2.0]), np.array([0.25, 0.55, 1.0, 1.5])

    def begun(law: FrictionLaw = law, size: Array = size, p: Array = p, state: Any = None, rate: Any = None) -> Array:
        return law.begun(MEMORY, p, size, state, rate)

    for aged, V in (begun().T, begun(state=np.full(4, 0.7)).T, begun(rate=1e-9).T, begun(rate=2.0).T):
        assert_allclose(law.coefficient(aged, V)[0] * p + V / 256, size, rtol=1e-12)
    assert_array_equal(begun()[:, 0], AGED)
    assert_allclose(law.ages(begun(state=np.full(4, 0.7))), 0.7)
    assert_allclose(begun(rate=1e-9)[:, 1], 1e-9)
    assert_allclose(begun(rate=2.0)[:, 1], 2.0)
    smooth = replace(law, of=RateAndState(**LAW))
    aged, V = begun(smooth, state="steady").T
    assert_allclose(smooth.evolves(aged, V) * DC / V, 0.0, atol=1e-9)
    assert_allclose(smooth.coefficient(aged, V)[0] * p, size, rtol=1e-12)
    level, flat = replace(law, b=np.array([0.01, 0.01, 0.0, 0.01])), replace(law, b=np.array([0.01, 0.01, 0.015, 0.01]))
    for found, said in (
        ({"p": np.append(p[:3], 0.0)}, "^pressure = 0.0: must be positive at every point"),
        ({"rate": 64.0}, "^rate = 64.0: radiates more than the traction"),
        ({"law": level, "rate": 1e-9}, "^rate = 1e-09: is that of the traction alone where b is 0; give state"),
        ({"law": flat, "state": "steady"}, "^state = steady: needs a traction, and a that differs from b"),
        ({"size": np.append(size[:3], 0.0), "state": "steady"}, "^state = steady: needs a traction"),
        ({"state": np.array([1.0, 2.0, 0.0, 1.0])}, "^state = 0.0: must be positive, in seconds"),
    ):
        with pytest.raises(SceneError, match=said):
            begun(**found)
    assert begun(level).shape == begun(flat).shape == (4, 2)


@pytest.mark.parametrize("evolution", STEP)
def test_a_rigid_column_shows_a_step_of_the_rate(evolution: str) -> None:
    """So stiff that shear takes up a ten millionth of the slip."""
    drive = [[0.0, 0.0], [1.0, 1e-6], [11.0, 11e-6], [16.0, 61e-6]]
    simulation = prepare(column(1e17, drive, evolution=evolution))
    f, V = followed(simulation, np.array([1.0, 11.0, 11.2, 12.0, 16.0]))
    assert_allclose(V, [1e-6, 1e-6, 1e-5, 1e-5, 1e-5], rtol=1e-5)
    assert_allclose(f, [0.6, 0.6, *STEP[evolution].values()], rtol=1e-6)


def test_a_column_is_a_spring_slider() -> None:
    """One and a half times as stiff as it has to be to slide steadily; the drive grows by a hundredth at t = 0.

    Source: stress and state by LSODA, and ln V and ln theta by Radau, made for this project.
    """
    k, start = 1.5 * 5e8, 800.0
    far = 0.6 * SIGMA / k
    drive = [
        [0.0, 0.0],
        [1.0, far],
        [start, far + (start - 1) * 1e-6],
        [start + 50, far + (start - 1) * 1e-6 + 50 * 1.01e-6],
    ]
    before = np.append(1.0, 1 + (start - 1) * np.linspace(0, 1, 41)[1:] ** 1.5)
    exact, off = np.array([0.60004202, 0.60001669, 0.59989378]), list[Array]()
    for step in (2.0, 1.0):
        after = np.arange(step, 50 + step / 2, step)
        f, V = followed(prepare(column(k, drive)), np.concatenate([before, start + after]))
        seen = len(before) + np.searchsorted(after, [10.0, 20.0, 50.0])
        off.append(f[seen] - exact)
    assert np.abs(off[1]).max() < 1.5e-5
    assert np.all((off[0] / off[1] > 1.6) & (off[0] / off[1] < 2.2))  # of first order
    assert_allclose(V[seen], [1.009133e-6, 1.016869e-6, 1.008361e-6], rtol=1e-3)


@pytest.mark.parametrize("numbers", [{"a": 1e-3, "f0": 1.0}, {"f0": 9.0, "b": 0.0}, {"b": 10.0, "theta": 1e6}])
@pytest.mark.parametrize("eta", [0.0, 1e-3])
def test_a_law_beyond_the_largest_exponential_is_that_of_its_logarithm(numbers: dict[str, float], eta: float) -> None:
    law = RateAndState(**{"f0": 0.6, "a": 0.01, "b": 0.015, "Dc": 1e-3, "V0": 1e-6, "damping": eta} | numbers)
    placed, V, p = law.placed(np.ones((1, 1)), 1.0, 1.0), np.array([1e-3]), np.ones(1)
    aged = placed.memory(1)[:, 0]
    f, slope, _ = placed.coefficient(aged, V)
    assert_allclose(f, law.a * np.log(V / law.V0) + law.f0 + law.b * aged, rtol=1e-12)
    assert_allclose(slope, law.a, rtol=1e-12)
    off = placed.rate(aged, f + eta * V, p) / V - 1
    assert np.all(np.abs(off) < 1e-14 * f / (law.a + eta * V) + 1e-12)
    assert_allclose(bound(placed, Unilateral(), p, np.eye(1), 1.0, 1.0, np.column_stack([aged, V])), f + eta * V)


def test_its_steps_pass_the_audit() -> None:
    scene = column(1e9, [[0.0, 0.0], [1.0, 6e-4], [11.0, 6.1e-4]], damping=1e7, evolution="slip")
    simulation = stickslip.prepare(scene)
    steps = list(simulation.steps())
    records, auditor = [record_of(step) for step in steps], Auditor(simulation.problem, simulation.mesh)
    audits = [asdict(auditor(r, before)) for r, before in zip(records, [None, *records], strict=False)]
    assert max(max(each.values()) for each in audits) < 1e-8
    assert not auditor.shared
    base, memory = steps[-1].contacts["base"], steps[-1].memory["base"]
    assert base.dissipation > 0
    for key in ("slip_rate", "state"):
        assert steps[-1].errors[f"contacts.base.{key}"].iteration is not None
    assert_allclose([base.slip_rate, base.state], [memory[:, 1].max(), 10.0 * np.exp(memory[:, 0].max())])


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("a", -0.01, "a = -0.01: must be positive"),
        ("Dc", 0.0, "Dc = 0.0: must be positive"),
        ("damping", -1.0, "damping = -1.0: must not be negative, in Pa s/m"),
        ("theta", 0.0, "theta = 0.0: must be positive"),
        ("k_T", 1.0, "k_T = 1.0: friction that slips"),
        ("f0", 0.0, "f0 = 0.0: must be positive"),
        ("V0", -1e-6, "V0 = -1e-06: must be positive"),
        ("b", -0.1, "b = -0.1: must not be negative"),
        ("a", "0.01*(1 + t)", r"a = 0.01*(1 + t): does not change in time"),
        ("b", "0.01*q", 'b = "0.01*q": column 6: q is not known'),
        ("b", "0.01/(x - x)", 'friction.b = "0.01/(x - x)": has no finite value'),
        ("Dc", "0*x", "Dc = 0*x: must be positive everywhere"),
        ("a", "0.01 - x", "a = 0.01 - x: must be positive everywhere"),
        ("a", "1e-4", "a = 1e-4: must be at least f0 / 1000 = 0.0006"),
        ("f0", 1e5, "a = 0.01: must be at least f0 / 1000 = 100"),
    ],
)
def test_parameters_that_mean_nothing_are_refused_in_a_line(key: str, value: Any, said: str) -> None:
    with pytest.raises(SceneError, match=re.escape(said)) as refused:
        prepare(column(1e9, [[0.0, 0.0], [1.0, 1e-6]], **{key: value}))
    assert "\n" not in str(refused.value)
