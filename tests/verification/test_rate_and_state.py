"""Friction of rate and state: velocity steps in closed form, and a sheared column as a spring slider."""

from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import sparse

import stickslip
from shared.audited import record_of
from stickslip import Scene, SceneError, Simulation
from stickslip.geometry.arrays import Array
from stickslip.solvers.laws.law import Trial
from stickslip.solvers.laws.normal import Unilateral
from stickslip.solvers.laws.rate_and_state import RateAndState
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


@pytest.mark.parametrize("evolution", STEP)
@pytest.mark.parametrize("size", [1e-3, 0.7, 3.0, 50.0])  # |t_hat| over the pressure, from 1e-30 to 1 m/s
def test_the_traction_of_a_rate_is_that_of_its_law_and_has_its_derivatives(evolution: str, size: float) -> None:
    one, gamma, step, h = np.ones(1), np.array([1e8]), 1e-3, 1e-4
    keys = {key: value for key, value in LAW.items() if key != "law"}
    law = RateAndState(**keys, evolution=evolution, damping=1e4).placed(one[:, None], 1.0, 1.0)
    start, p, average = law.memory(1), np.array([2e5]), sparse.identity(1, format="csr")
    now = law.within(start, step)

    def bound(size: float, p: Array) -> Array:
        return now.dragged(p, average, Trial(np.array([size]), gamma)).bound

    whole = size * p[0]
    found = now.dragged(p, average, Trial(np.array([whole]), gamma))
    slip = (whole - found.bound) / gamma
    ended = law.at(law.after(start, slip, step)).limit(p, average, Unilateral(), 1.0, 1.0)
    assert_allclose(found.bound, ended if size > 0.1 else whole, rtol=1e-6)  # the slowest slip is lost in rounding
    for derivative, low, high, at in (
        (found.by_trial, bound(whole * (1 - h), p), bound(whole * (1 + h), p), whole),
        (found.by_pressure.toarray()[0], bound(whole, p * (1 - h)), bound(whole, p * (1 + h)), p[0]),
    ):
        assert_allclose(derivative, (high - low) / (2 * h * at), rtol=1e-4, atol=1e-7)


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


@pytest.mark.parametrize("numbers", [{"a": 7e-4}, {"f0": 9.0}, {"b": 10.0, "theta": 1e6}])
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
        ("damping", -1.0, "damping = -1.0: must not be negative"),
        ("theta", 0.0, "theta = 0.0: must be positive"),
        ("k_T", 1.0, "k_T = 1.0: friction that slips"),
        ("a", "0.01 - x", "a = 0.01 - x: must be positive everywhere"),
        ("a", "1e-4", "a = 1e-4: must be at least f0 / 1000 = 0.0006"),
        ("f0", 1e5, "a = 0.01: must be at least f0 / 1000 = 100"),
    ],
)
def test_parameters_that_mean_nothing_are_refused_in_a_line(key: str, value: Any, said: str) -> None:
    with pytest.raises(SceneError, match=said.replace("(", r"\(")) as refused:
        prepare(column(1e9, [[0.0, 0.0], [1.0, 1e-6]], **{key: value}))
    assert "\n" not in str(refused.value)
