"""Loads that contact and friction bear no longer are told as limits, of bodies whose pressures elasticity makes."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from stickslip import NoEquilibriumError, SceneError, StepError, StepResult
from stickslip.solvers.stepping import halving
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

STEEL = {"E": 210e9, "nu": 0.3}
MU, ANGLE = 0.5, np.radians(10.0)
LAP = {  # tightened to a force, held, and pulled: what it grips follows from bolt and bodies
    "model": "plane strain",
    "geometry": {"builder": "two_blocks", "length": 0.06, "height": 0.01, "mesh_size": 0.0025},
    "bodies": {"upper": STEEL, "lower": STEEL},
    "contacts": {"joint": {"surface": "upper.bottom", "against": "lower.top",
                           "friction": {"law": "coulomb", "mu": 0.2}}},
    "bolts": {"bolt": {"head": "upper.top", "nut": "lower.bottom", "axis": [0.0, 1.0], "stiffness": 2e10,
                       "force": [[1.0, 3e6]], "held_from": 1.0}},
    "loads": {"pull": {"boundary": "upper.right", "force": {"x": [[1.0, 0.0], [2.0, 8e5]]}}},
    "supports": {"held": {"boundary": "lower.left", "displacement": {"x": 0.0, "y": 0.0}}},
    "steps": {"end": 2.0, "count": 8},
}  # fmt: skip
BELT = {  # on a quarter of a pulley
    "model": "plane strain",
    "geometry": {"builder": "ring", "inner_radius": 1.0, "outer_radius": 1.02, "angle": 90, "mesh_size": 0.04},
    "bodies": {"ring": {"E": 1e6, "nu": 0.3}},
    "obstacles": {"pulley": {"shape": "cylinder", "point": [0.0, 0.0], "radius": 1.0}},
    "contacts": {"wrap": {"surface": "ring.inner", "against": "pulley", "friction": {"law": "coulomb", "mu": 0.3}}},
    "loads": {"slack": {"boundary": "ring.x_axis", "force": {"y": [[1.0, -10.0]]}},
              "tight": {"boundary": "ring.y_axis", "force": {"x": [[1.0, -10.0], [2.0, -30.0]]}}},
    "steps": {"end": 2.0, "count": 2},
}  # fmt: skip
WEDGE = {  # pressed into a groove that it cannot slide out of, let go, then drawn
    "model": "plane strain",
    "geometry": {"builder": "wedge", "half_angle": 10.0, "bottom_width": 1.0, "height": 1.0, "mesh_size": 0.1},
    "bodies": {"wedge": {"E": 1e3, "nu": 0.3}},
    "obstacles": {side: {"shape": "plane", "point": [x, 0.0], "normal": [-2 * x * np.cos(ANGLE), np.sin(ANGLE)]}
                  for side, x in (("left", -0.5), ("right", 0.5))},
    "contacts": {side: {"surface": f"wedge.{side}", "against": side, "friction": {"law": "coulomb", "mu": MU}}
                 for side in ("left", "right")},
    "loads": {"push": {"boundary": "wedge.top", "force": {"y": [[1.0, -20.0], [2.0, 0.0], [3.0, 20.0]]}}},
    "steps": {"end": 3.0, "count": 12},
}  # fmt: skip

SLOT = {  # a block that nothing touches, drawn along its slot; pressures from both sides would hold it
    "model": "plane strain",
    "geometry": {"builder": "block", "length": 1.0, "height": 0.5, "mesh_size": 0.25},
    "bodies": {"block": {"E": 1e6, "nu": 0.3}},
    "obstacles": {"floor": {"shape": "plane", "point": [0.0, -0.01], "normal": [0.0, 1.0]},
                  "roof": {"shape": "plane", "point": [0.0, 0.51], "normal": [0.0, -1.0]}},
    "contacts": {name: {"surface": f"block.{side}", "against": name, "friction": {"law": "coulomb", "mu": 0.3}}
                 for name, side in (("floor", "bottom"), ("roof", "top"))},
    "loads": {"pull": {"boundary": "block.right", "force": {"x": [[1.0, 0.0], [2.0, 10.0]]}}},
    "steps": {"end": 2.0, "count": 2},
}  # fmt: skip
LOOSE = BELT | {  # turned about its shaft, which it does not touch
    "contacts": {"wrap": BELT["contacts"]["wrap"] | {"gap_offset": 1e-3}},
    "geometry": BELT["geometry"] | {"angle": 360},
    "loads": {"torque": {"boundary": "ring.outer", "traction": ["-y*max(t-1,0)", "x*max(t-1,0)"]}},
}
SPUN = {  # the ring widens by far more than its gap, and then moves on until it lies on the shaft
    "model": "plane strain",
    "geometry": {"builder": "ring", "inner_radius": 1.0, "outer_radius": 1.4, "angle": 360, "mesh_size": 0.08},
    "bodies": {"ring": {"E": 210e9, "nu": 0.3, "density": 7850.0}},
    "obstacles": {"shaft": {"shape": "cylinder", "point": [0.0, 0.0], "radius": 1.0}},
    "contacts": {"fit": {"surface": "ring.inner", "against": "shaft", "friction": {"law": "cohesion", "a": 3e6,
                                                                                   "mu": 0.12}}},
    "centrifugal": {"speed": [[1.0, 1000.0]]},
    "loads": {"pull": {"boundary": "ring.outer", "force": {"x": [[1.0, 0.0], [2.0, 1e8]]}}},
    "steps": {"end": 2.0, "count": 1},
}  # fmt: skip


FINER = WEDGE | {"steps": {"end": 3.0, "count": 36}}
LIMITED = {"lap": LAP, "belt": BELT, "wedge": WEDGE, "wedge in finer steps": FINER}


@cache
def ended(name: str) -> tuple[list[StepResult], float, int, int]:
    """Steps; the time from which there is no equilibrium; volume solves of a step before, and of all at the limit."""
    simulation, steps, solves = prepare(from_dict(LIMITED[name])), list[StepResult](), [0]

    def march() -> None:
        for step in simulation.steps():
            steps.append(step)
            solves.append(simulation.counters.volume_solves)

    with pytest.raises(NoEquilibriumError, match=r"cannot balance the loads: .* the last equilibrium") as caught:
        march()
    beyond = float(str(caught.value).split()[2].rstrip(":"))
    return steps, beyond, max(np.diff(solves[:-1])), solves[-1] - solves[-2]


@pytest.mark.parametrize("name", ["lap", "belt", "wedge"])
def test_a_limit_load_is_bracketed_to_a_thousandth_at_the_price_of_ten_steps(name: str) -> None:
    steps, beyond, usual, spent = ended(name)
    turn = 2.0 if name == "wedge" else 1.0
    first = -10.0 / -20.0 if name == "belt" else 0.0  # of the load at the turn, in units of its rate
    assert 0 < beyond - steps[-1].time <= 1e-3 * (steps[-1].time - turn + first) * 1.01
    assert spent <= 10 * max(usual, 3)


def test_a_motion_without_end_is_no_limit_until_friction_is_spent(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as unsure:
        unsure.setattr(halving, "spent", lambda problem, p, motion: False)
        with pytest.raises(StepError, match=r"not shown to be spent: .* moves along x; the last equilibrium") as caught:
            list(prepare(from_dict(LAP)).steps())
    assert type(caught.value) is StepError


@pytest.mark.parametrize("data", [SLOT, LOOSE], ids=["slot", "loose"])
def test_bodies_that_nothing_touches_and_nothing_stops_have_no_equilibrium(data: dict[str, Any]) -> None:
    with pytest.raises(NoEquilibriumError, match=r"t = 1: .* the last equilibrium that was found is at t = 1$"):
        list(prepare(from_dict(data)).steps())


def test_a_body_stops_where_strain_has_widened_its_gap() -> None:
    fit = list(prepare(from_dict(SPUN)).steps())[-1].contacts["fit"]
    assert fit.force[0] == pytest.approx(-1e8, rel=1e-8)


def test_a_joint_grips_as_bodies_and_bolt_press_it() -> None:
    last = ended("lap")[0][-1]
    joint = last.contacts["joint"]
    assert 0.998 * 0.2 * joint.normal_force < joint.tangential_force <= 0.2 * joint.normal_force * (1 + 1e-9)
    assert joint.normal_force < 0.996 * 3e6  # the pull makes the bodies thinner


def test_a_belt_bears_what_eytelwein_says() -> None:
    """Of a thin one; here it is a fiftieth of its radius thick."""
    tight = 10 + 20 * (ended("belt")[0][-1].time - 1)
    assert tight == pytest.approx(10 * np.exp(0.3 * np.pi / 2), rel=0.01)


def test_a_jammed_wedge_comes_out_at_the_same_force_however_finely_it_is_drawn() -> None:
    """Past its largest force it would be in equilibrium with less, too: no history of forces reaches such states."""
    limits = [20 * (ended(name)[0][-1].time - 2) for name in ("wedge", "wedge in finer steps")]
    assert limits[0] == pytest.approx(limits[1], rel=0.01)
    assert 2.0 < limits[0] < 20 * (MU - np.tan(ANGLE)) / (MU + np.tan(ANGLE))  # some of the grip is lost on the way


def test_a_script_finds_the_largest_multiple_of_a_load_and_stays_as_it_was() -> None:
    script = prepare(from_dict(LAP)).script()
    script.step(to=1.0)
    limit = script.limit("loads.pull.x")
    assert limit.value == pytest.approx(0.2 * 2.983e6, rel=2e-3)
    assert limit.value < limit.beyond <= limit.value * 1.0011
    assert limit.multiple == limit.value / 8e5
    assert script.time == 1.0
    script.step(to=2.0, loads={"pull": {"x": limit.value}})
    with pytest.raises(NoEquilibriumError):
        script.step(to=3.0, loads={"pull": {"x": limit.beyond}})


BOX = {  # pushed over a floor by pressure, in space; stands behind its weight
    "model": "3d",
    "geometry": {"builder": "block", "length": 1.0, "width": 0.5, "height": 1.0, "mesh_size": 0.5},
    "bodies": {"block": {"E": 1e4, "nu": 0.3}},
    "obstacles": {"floor": {"shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}},
    "contacts": {"base": {"surface": "block.bottom", "against": "floor", "friction": {"law": "coulomb", "mu": 0.3}}},
    "loads": {"weight": {"boundary": "block.top", "pressure": [[1.0, 10.0]]},
              "wind": {"boundary": "block.left", "pressure": [[1.0, 0.0], [2.0, 1.0]]}},
    "steps": {"end": 2.0, "count": 2},
}  # fmt: skip
PRESS = {  # a plate that forces drive presses a block on a floor, and is drawn to the left
    "model": "plane strain",
    "geometry": {"builder": "block", "length": 1.0, "height": 0.5, "mesh_size": 0.25},
    "bodies": {"block": {"E": 1e4, "nu": 0.3}},
    "obstacles": {"floor": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0], "displacement": {"y": 0.0}},
                  "plate": {"shape": "plane", "point": [0.0, 0.5], "normal": [0.0, -1.0],
                            "force": {"y": [[1.0, -5.0]], "x": [[1.0, 0.0], [2.0, -1.0]]}}},
    "contacts": {name: {"surface": f"block.{side}", "against": name, "friction": {"law": "coulomb", "mu": mu}}
                 for name, side, mu in (("floor", "bottom", 0.5), ("plate", "top", 0.3))},
    "steps": {"end": 2.0, "count": 2},
}  # fmt: skip


@pytest.mark.parametrize(
    ("data", "load", "borne"), [(BOX, "loads.wind.pressure", 3.0), (PRESS, "obstacles.plate.x", -1.5)]
)
def test_the_limit_is_that_of_statics_whatever_the_load_is(data: dict[str, Any], load: str, borne: float) -> None:
    simulation = prepare(from_dict(data))
    script, counters = simulation.script(), simulation.counters
    script.step(to=1.0)
    usual = counters.volume_solves
    limit = script.limit(load)
    assert counters.volume_solves - usual <= 10 * usual
    assert limit.value == pytest.approx(borne, rel=1e-3)
    assert abs(limit.beyond) <= abs(limit.value) * 1.0011
    table, name, part = load.split(".")
    script.step(to=2.0, **{table: {name: {part: 0.97 * borne}}})
    assert script.limit(load).value == pytest.approx(borne, rel=1e-3)  # from there, too


def test_what_is_no_force_has_no_limit() -> None:
    script = prepare(from_dict(PRESS)).script()
    for wrong, text in (("obstacles.floor.y", "displacement: expected a force"), (None, "None: expected"),
                        ("loads.pull", "expected loads.NAME"), ("obstacles.plate.z", "prescribes only")):  # fmt: skip
        with pytest.raises(SceneError, match=text):
            script.limit(wrong)


def test_a_load_that_is_none_has_no_limit() -> None:
    script = prepare(from_dict(LAP)).script()
    for wrong, text in (("loads.pull.y", "prescribes only x"), ("supports.held.x", "expected loads.NAME")):
        with pytest.raises(SceneError, match=text):
            script.limit(wrong)
