"""Scenes that have a solution are solved, however hard: low and high friction, stiff neighbours, loads near a limit."""

import re
from collections.abc import Sequence
from math import cos, radians, sin, tan
from typing import Any

import pytest
from numpy.testing import assert_allclose

from shared.cases import often, slow
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.stepping.stepper import NoEquilibriumError, StepError
from stickslip.workflows.lab.verification.hard.judge import Outcome, judge
from stickslip.workflows.lab.verification.hard.tables import toml
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import read, to_dict

ARCH = [f"bodies.{name}.nu=0.4999" for name in to_dict(read("arch"))["bodies"]]
STACK = ["geometry.mesh_size=0.14", *(f"bodies.block_{k}.nu=0.4999" for k in range(1, 11))]
AT_ONCE = "steps={end=1.0,count=1}"


def solved(name: str, overrides: Sequence[str]) -> StepResult:
    """The last step of a ready scene."""
    *_, last = prepare(read(name, overrides)).steps()
    return last


def on_a_slope(angle: float, mu: float, size: float) -> list[str]:
    """`block`, held on a slope by friction alone; angle in degrees."""
    g = [sin(radians(angle)), -cos(radians(angle))]
    return [
        *("supports={}", "bodies.block={E=1e6,nu=0.3,density=2000.0}", f"gravity={{acceleration={g}}}", AT_ONCE),
        *(f"contacts.base.friction.mu={mu}", f"geometry.mesh_size={size}", f"geometry.contact_mesh_size={size}"),
    ]


def lifted(force: float) -> list[str]:
    """`block` with a weight of 8000 N/m on the ground, pulled upwards."""
    return [
        *("supports={}", "bodies.block={E=1e7,nu=0.3,density=1000.0}", "gravity={acceleration=[0.0,-1.0]}", AT_ONCE),
        f"loads.lift={{boundary='block.top',force=[0.0,{force}]}}",
    ]


def capstan(pull: float) -> list[str]:
    """`ring`: a quarter of a thin band on a rigid drum, held back at one end with 1 N/m, pulled at the other."""
    loads = {
        "slack": {"boundary": "ring.x_axis", "force": [0.0, -1.0]},
        "pull": {"boundary": "ring.y_axis", "force": [-pull, 0.0]},
    }
    return [
        "geometry={builder='ring',inner_radius=1.0,outer_radius=1.05,angle=90,mesh_size=0.025,cells='tensor'}",
        *("bodies.ring={E=1e6,nu=0.3}", "supports={}", f"loads={toml(loads)}", AT_ONCE),
        "obstacles={drum={shape='cylinder',point=[0.0,0.0],radius=1.0}}",
        "contacts={drum={surface='ring.inner',against='drum',friction={law='coulomb',mu=0.3}}}",
    ]


def ladder(past: float) -> list[str]:
    """`strip` as a ladder between floor and smooth wall, so many degrees flatter than where its foot slides."""
    length, height, stands = 2.0, 0.05, radians(60.0)
    mu = (length * cos(stands) - height * sin(stands)) / (2 * length * sin(stands))  # from moments about the foot
    s, c = sin(stands - radians(past)), cos(stands - radians(past))
    obstacles: dict[str, Any] = {
        "floor": {"shape": "plane", "point": [0.0, 0.0], "normal": [s, c]},
        "wall": {"shape": "plane", "point": [length, 0.0], "normal": [-c, s]},
    }
    contacts: dict[str, Any] = {
        "foot": {"surface": "strip.left", "against": "floor", "friction": {"law": "coulomb", "mu": mu}},
        "head": {"surface": "strip.right", "against": "wall"},
    }
    return [
        *(f"geometry.height={height}", "geometry.mesh_size=0.05", "geometry.layers=2", "supports={}", AT_ONCE),
        *("bodies.strip={E=1e7,nu=0.3,density=1000.0}", f"gravity={{acceleration={[-s, -c]}}}"),
        *(f"obstacles={toml(obstacles)}", f"contacts={toml(contacts)}"),
    ]


SOLVABLE = {
    "little friction": ("block", ["contacts.base.friction.mu=0.05"]),
    "friction 10, nearly incompressible": ("raous", ["contacts.base.friction.mu=10.0", "bodies.block.nu=0.4999"]),
    "nearly incompressible on compliance": ("foundation", ["bodies.block.nu=0.4999"]),
    "stiff block on compliance": ("foundation", ["bodies.block.E=1e15"]),
    "nearly incompressible stones": ("arch", ARCH),
    "nearly incompressible blocks": ("stack", STACK),
    "friction 400 on compliance": ("foundation", ["geometry.mesh_size=0.07", "contacts.base.friction.mu=400.0"]),
    "stiff left springer": ("arch", ["bodies.left_springer.E=2e14"]),
    "stiffer left springer": ("arch", ["bodies.left_springer.E=2e16"]),
    "stiff right springer": ("arch", ["bodies.right_springer.E=2e14"]),
    "one stiff block of ten": ("stack", ["bodies.block_5.E=1e12"]),
    "stiff upper block": ("two_blocks", ["bodies.upper.E=1e6"]),
    "stiff fine slave": ("cylinders", ["bodies.upper.E=2e7"]),
    "soft coarse master": ("cylinders", ["bodies.lower.E=2e-4"]),
    "soft inner ring": ("shrink_fit", ["bodies.inner.E=0.2"]),
    "just held on a slope": ("block", on_a_slope(20.0, 1.00001 * tan(radians(20.0)), 0.1)),
    "just held on a slope, finer": ("block", on_a_slope(20.0, 1.00001 * tan(radians(20.0)), 0.05)),
    "nearly lifted": ("block", lifted(7999.9)),
    "band on a drum": ("ring", capstan(1.4)),  # its limit is exp(0.3 pi/2) = 1.602
    **{f"friction {mu} on a block that opens": ("raous", [f"contacts.base.friction.mu={mu}"]) for mu in (5.0, 50.0)},
    "soft tangential springs": ("block", ["contacts.base.friction.k_T=1e-12"]),
}


OTHERS = {  # of their kind
    *("nearly incompressible blocks", "friction 400 on compliance", "just held on a slope, finer"),
    *("stiffer left springer", "stiff right springer"),
    "stiff fine slave",  # its pressure is compared below
}


@pytest.mark.parametrize("case", often(SOLVABLE, SOLVABLE.keys() - OTHERS))
def test_scene_that_has_a_solution_is_solved(case: str) -> None:
    verdict = next(judge(read(*SOLVABLE[case])))
    assert verdict.outcome in (Outcome.SOLVED, Outcome.BRANCH), verdict.reason


BEYOND_DIGITS = {
    "stiffer block on compliance": ("foundation", ["bodies.block.E=1e19"], "base", 47088.0),  # its weight
    "contrast of 1e15, floating": (
        "two_blocks",
        [
            "bodies.upper.E=1e15",
            "supports={base={boundary='lower.bottom',displacement={x=0.0,y=0.0}}}",
            "loads.top={boundary='upper.top',force=[[[0,0],[1,0],[2,0.01]],[[0,0],[1,-0.1]]]}",
        ],
        "joint",
        0.1,
    ),
}


@pytest.mark.parametrize("case", BEYOND_DIGITS)
def test_forces_are_right_where_stresses_are_below_the_last_digit_of_the_displacement(case: str) -> None:
    """The stiff body moves by 1e-4 m and more, and bends by 1e-15 m: the run solves it, and is doubtful."""
    name, overrides, contact, force = BEYOND_DIGITS[case]
    verdict = next(judge(read(name, overrides)))
    assert verdict.outcome is Outcome.DOUBTFUL
    assert "rounding is" in verdict.reason
    assert_allclose(solved(name, overrides).contacts[contact].normal_force, force, rtol=1e-9)


def test_blocks_with_next_to_no_friction_rest_until_they_are_tilted() -> None:
    words = ["geometry.mesh_size=0.25", *(f"contacts.{name}.friction.mu=0.0004" for name in read("stack").contacts)]
    verdict = next(judge(read("stack", words)))
    assert verdict.outcome is Outcome.PROVED
    # the tilt grows by 1 m/s2 from t = 1 on: they slide from 0.0004 * 9.81 s later on
    times = [float(word) for word in re.findall(r"t = (\d\.\d+)", verdict.reason)]
    assert times[1] < 1 + 0.0004 * 9.81 < times[0] < 1.01


def test_points_that_stick_and_lift_may_have_no_solution(monkeypatch: pytest.MonkeyPatch) -> None:
    """With Coulomb's law and mu = 1e4, 1e6 a point slips whose pressure falls as 1/mu while its friction stays."""
    monkeypatch.setattr("stickslip.solvers.stepping.halving.HALVINGS", 1)
    words = ["geometry.mesh_size=0.2", "contacts.base.friction={law='stick'}", "steps.end=6.0", "steps.count=6"]
    words += ["solver.method=condensed-newton"]  # alone: those that take over need ten times as long to give up
    with pytest.raises(StepError, match=r"jumps where the surfaces part: there may be no solution; coulomb has one"):
        solved("hysteresis", words)


@pytest.mark.parametrize("factor", [*slow(1e4), 1e5])
def test_pressure_of_a_stiff_cylinder_does_not_depend_on_which_side_is_the_slave(factor: float) -> None:
    stiff = [f"bodies.upper.E={200 * factor}"]
    swapped = [*stiff, "contacts.line.surface=lower.arc", "contacts.line.against=upper.arc"]
    found, expected = (solved("cylinders", words).contacts["line"].max_pressure for words in (stiff, swapped))
    assert_allclose(found, expected, rtol=0.02)  # cells of 1/40 and 1/30 of the width of contact


def test_far_motion_without_contact_does_not_spoil_the_pressure() -> None:
    """Without contact the long block would turn by metres about its corner; with it, it moves by 0.1 mm."""
    long = ["geometry.length=0.8", "supports.corner.point=[0.8,0.0]"]
    expected = solved("raous", long).contacts["base"]
    found = solved("raous", [*long, "solver.method=surface-uzawa", "solver.tolerance=1e-4"]).contacts["base"]
    assert_allclose(found.max_pressure, expected.max_pressure, rtol=0.01)


def test_weak_compliance_has_its_friction() -> None:
    """All of the base slides: friction is mu times the pressing force, however small both are."""
    weak = ["contacts.base.normal={law='compliance',c_n=1e-9}", "solver.method=uzawa"]
    base = solved("block", weak).contacts["base"]
    assert_allclose(base.normal_force, 1e-9 * 4.0 * 0.1, rtol=1e-6)
    assert_allclose(base.tangential_force, 0.3 * base.normal_force, rtol=1e-4)


@pytest.mark.parametrize(("past", "holds"), [(0.34, True), (0.36, False), (0.5, False)])
def test_ladder_is_solved_or_proved_to_slide(past: float, holds: bool) -> None:
    """It stands a third of a degree longer than in the textbook: its foot has a width, and turns about its corner."""
    if holds:
        assert solved("strip", ladder(past)).residual < 1e-8
        return
    with pytest.raises(NoEquilibriumError):
        solved("strip", ladder(past))
