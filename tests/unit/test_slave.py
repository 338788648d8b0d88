"""Which side of a contact carries the tractions, and that nobody who reads the forces can tell."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.geometry.errors import SceneError
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

JOINT = {"surface": "upper.bottom", "against": "lower.top", "friction": {"law": "coulomb", "mu": 0.3}}
AS_WRITTEN, EXCHANGED = ("upper.bottom", "lower.top"), ("lower.top", "upper.bottom")


def pair(upper: float = 1.0, lower: float = 1.0, contacts: Any = None, **joint: Any) -> Scene:
    """Two blocks of these moduli [Pa], pressed and dragged."""
    return from_dict(
        {
            "model": "plane strain",
            "geometry": {"builder": "two_blocks", "length": 2.0, "height": 0.5, "mesh_size": 0.25},
            "bodies": {"upper": {"E": upper, "nu": 0.3}, "lower": {"E": lower, "nu": 0.3}},
            "obstacles": {"lid": {"shape": "plane", "point": [0.0, 1.0], "normal": [0.0, -1.0]}},
            "contacts": {"joint": JOINT | joint} | (contacts or {}),
            "supports": {
                "bed": {"boundary": "lower.bottom", "displacement": {"x": 0.0, "y": 0.0}},
                "top": {"boundary": "upper.top", "displacement": {"x": 0.04, "y": -0.05}},
            },
        }
    )


@pytest.mark.parametrize(
    ("upper", "lower", "expected"),
    [
        (1.0, 1.0, AS_WRITTEN),
        (10.0, 1.0, AS_WRITTEN),  # not by more than ten times
        (10.1, 1.0, EXCHANGED),
        (1.0, 1e6, AS_WRITTEN),
        (1e6, 1.0, EXCHANGED),
    ],
)
def test_the_much_softer_body_carries_the_tractions(upper: float, lower: float, expected: tuple[str, str]) -> None:
    assert pair(upper, lower).slave_and_master("joint") == expected


@pytest.mark.parametrize(("slave", "expected"), [("surface", AS_WRITTEN), ("against", EXCHANGED)])
@pytest.mark.parametrize("upper", [1e-6, 1.0, 1e6])
def test_who_asks_for_a_side_gets_it(upper: float, slave: str, expected: tuple[str, str]) -> None:
    assert pair(upper, slave=slave).slave_and_master("joint") == expected


def test_a_node_is_paired_as_it_is_written() -> None:
    assert pair(1e6, operator="node-to-segment").slave_and_master("joint") == AS_WRITTEN
    assert pair(1e6, operator="mortar").slave_and_master("joint") == EXCHANGED


def test_a_side_with_two_contacts_stays_the_master() -> None:
    with_lid = {"lid": {"surface": "lower.top", "against": "lid"}}
    scene = pair(1e6, contacts=with_lid)
    assert scene.slave_and_master("joint") == AS_WRITTEN
    assert scene.slave_and_master("lid") == ("lower.top", None)
    elsewhere = {"lid": {"surface": "lower.right", "against": "lid"}}
    assert pair(1e6, contacts=elsewhere).slave_and_master("joint") == EXCHANGED


def test_an_obstacle_never_carries_them() -> None:
    with_lid = {"lid": {"surface": "upper.top", "against": "lid"}}
    assert pair(1e6, contacts=with_lid).slave_and_master("lid") == ("upper.top", None)
    with pytest.raises(SceneError, match=r"contacts\.lid\.slave = against: an obstacle is no slave"):
        pair(contacts={"lid": {"surface": "upper.top", "against": "lid", "slave": "against"}})


def solved(scene: Scene) -> StepResult:
    (step,) = prepare(scene).steps()
    return step


@pytest.mark.parametrize(("upper", "rtol"), [(1.0, 0.02), (20.0, 0.05)])  # coarse meshes; they match, corners differ
def test_resultants_act_on_the_surface_that_is_written(upper: float, rtol: float) -> None:
    one, other = (solved(pair(upper, slave=slave)) for slave in ("surface", "against"))
    first, second = one.contacts["joint"], other.contacts["joint"]
    for step, contact in ((one, first), (other, second)):
        push, lift = contact.force
        assert lift > 0  # pressed downwards, the upper block is held up
        assert push < 0  # and is held back against the drag
        assert_allclose(contact.force, -np.array(step.supports["top"].force), rtol=1e-6)
    assert_allclose(first.force, second.force, rtol=rtol)
    assert_allclose(first.moment, second.moment, rtol=rtol)
    assert_allclose(first.normal_force, second.normal_force, rtol=rtol)
