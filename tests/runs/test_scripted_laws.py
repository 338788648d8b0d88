"""A script changes laws and gaps on the way: the bodies stay prepared, and what was reached stays."""

from typing import Any

import pytest
from numpy.testing import assert_allclose

import stickslip
from shared.cases import every_nth
from stickslip.solvers.method_registry import METHODS
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.scene_file.read import from_dict, read

COARSE = ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.25", "output.error=false"]
TRESCA = "contacts.base.friction={law='tresca', bound=[[0, 0], [1, 0.02], [2, 0.01], [3, 0.03]]}"


def prepared(*sets: str) -> Simulation:
    return stickslip.prepare(read("block", [*COARSE, *sets]))


def test_after_a_drop_of_friction_the_force_is_that_of_the_new_coefficient() -> None:
    simulation = prepared("contacts.base.friction.mu=0.4")
    script = simulation.script()
    script.step(to=1.0)
    pulled = script.step(to=2.0, supports={"top": {"x": 0.3}}).contacts["base"]
    assert pulled.stick_area == 0
    assert_allclose(pulled.tangential_force, 0.4 * pulled.normal_force, rtol=1e-6)
    for mu in (0.1, 0.2):  # it slides back, and on
        let = script.step(to=script.time + 1, contacts={"base": {"mu": mu}}, supports={"top": {"x": 0.3 * script.time}})
        base = let.contacts["base"]
        assert base.stick_area == 0
        assert_allclose(base.tangential_force, mu * base.normal_force, rtol=1e-6)
    assert simulation.counters.factorisations == 1
    with pytest.raises(stickslip.SceneError, match="parameters of contacts have changed"):
        script.scene  # noqa: B018
    again = simulation.script()  # the scene's own laws
    assert (
        again.step(to=2.0).contacts["base"].tangential_force
        == [*simulation.steps()][-1].contacts["base"].tangential_force
    )


def test_bound_in_time_is_that_of_a_scene_that_lists_it() -> None:
    listed = [*prepared(TRESCA, "steps.end=3", "steps.count=3").steps()]
    script = prepared(TRESCA.replace("[2, 0.01], [3, 0.03]", "[2, 0.02]"), "steps.end=3", "steps.count=3").script()
    script.step(to=1.0)
    for step, bound in zip(listed[1:], (0.01, 0.03), strict=True):
        found = script.step(to=step.time, contacts={"base": {"bound": bound}})
        assert_allclose(found.contacts["base"].force, step.contacts["base"].force, rtol=1e-12, atol=1e-15)
    assert script.scene.contacts["base"].friction.bound[-1] == (3.0, 0.03)


@pytest.mark.parametrize("method", every_nth(3, METHODS))
def test_every_method_goes_on_with_other_friction_and_another_gap(method: str) -> None:
    """T = mu N with the new mu; and without friction a gap .1 smaller doubles the force of a support .1 down."""
    sets = [f'solver.method="{method}"', "solver.tolerance=1e-5"]
    script = prepared(*sets, "contacts.base.friction.mu=0.3").script()
    script.step(to=1.0)
    script.step(to=2.0, supports={"top": {"x": 0.3}})
    let = script.step(to=3.0, contacts={"base": {"mu": 0.1}}, supports={"top": {"x": 0.6}}).contacts["base"]
    assert_allclose(let.tangential_force, 0.1 * let.normal_force, rtol=1e-3)
    smooth = prepared(*sets, "contacts.base.friction.mu=0.0", "supports.top.displacement={x=0.0, y=-0.1}").script()
    once = smooth.step(to=2.0).contacts["base"].normal_force
    twice = smooth.step(to=3.0, contacts={"base": {"gap_offset": -0.1}}).contacts["base"].normal_force
    assert_allclose(twice, 2 * once, rtol=1e-3)


@pytest.mark.parametrize("method", ["auto", "regularised"])
@pytest.mark.parametrize("normal", ["{law='unilateral'}", "{law='compliance', c_n=1.0, m_n=1.0}"])
def test_gap_offset_presses_like_the_motion_of_the_support(normal: str, method: str) -> None:
    sets = [f"contacts.base.normal={normal}", f'solver.method="{method}"']
    still = prepared(*sets, "supports.top.displacement={x=0.0, y=0.0}").script()
    still.step(to=1.0)
    by_offset = still.step(to=2.0, contacts={"base": {"gap_offset": -0.1}}).contacts["base"]
    moved = prepared(*sets, "supports.top.displacement={x=0.0, y=-0.1}").script()
    by_support = moved.step(to=2.0).contacts["base"]
    assert by_support.normal_force > 0
    assert_allclose(by_offset.normal_force, by_support.normal_force, rtol=1e-10)


def test_pairs_that_were_searched_stay_when_laws_change() -> None:
    """A block is drawn over the end of another one, which rests on a floor: coefficients change by nothing."""
    friction = {"law": "coulomb", "mu": 0.3}
    drawn = {"x": [[1.0, 0.0], [4.0, 0.3]], "y": [[1.0, -1e-3], [4.0, -1e-3]]}
    blocks = {"builder": "two_blocks", "length": 1.0, "lower_length": 1.1, "height": 0.5}
    scene = from_dict(
        {
            "model": "plane strain",
            "geometry": blocks | {"mesh_size": 0.125, "lower_mesh_size": 0.1},
            "bodies": {"upper": {"E": 1e9, "nu": 0.3}, "lower": {"E": 1e9, "nu": 0.3}},
            "obstacles": {"floor": {"shape": "plane", "point": [0.0, -0.5], "normal": [0.0, 1.0]}},
            "contacts": {
                "joint": {"surface": "upper.bottom", "against": "lower.top", "friction": friction, "sliding": True},
                "base": {"surface": "lower.bottom", "against": "floor", "friction": friction | {"mu": 0.5}},
            },
            "supports": {"top": {"boundary": "upper.top", "displacement": drawn}},
            "steps": {"end": 4.0, "count": 4},
        }
    )
    simulation = stickslip.prepare(scene)
    script, other = simulation.script(), simulation.script()
    for time in (1.0, 2.0, 3.0, 4.0):
        more = 1 + 1e-13 * max(time - 2.0, 0.0)
        mine = script.step(to=time, contacts={"joint": {"mu": 0.3 * more}, "base": {"mu": 0.5 * more}})
        theirs = other.step(to=time)
        for name, contact in mine.contacts.items():
            assert_allclose(contact.force, theirs.contacts[name].force, rtol=1e-8)
            assert_allclose(contact.dissipation, theirs.contacts[name].dissipation, rtol=1e-8, atol=1e-8)
        assert_allclose(mine.energy.external, theirs.energy.external, rtol=1e-8)
    assert mine.contacts["joint"].max_slip > 0.25


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"bas": {"mu": 0.1}}, "contacts.bas: nothing there to change; did you mean base"),
        ({"base": {"my": 0.1}}, "contacts.base.my: nothing there to change"),
        ({"base": {"law": 1.0}}, "contacts.base.law: nothing there to change"),
        ({"base": {"mu": -1.0}}, "mu = -1"),
        ({"base": {"mu": "much"}}, "expected a number"),
        ({"base": 0.1}, "expected { component: number }"),
    ],
)
def test_what_is_wrong_is_refused_and_changes_nothing(wrong: dict[str, Any], said: str) -> None:
    script = prepared().script()
    with pytest.raises(stickslip.SceneError, match=said):
        script.step(to=1.0, contacts=wrong)
    assert script.time == 0
