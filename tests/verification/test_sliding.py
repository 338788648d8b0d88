"""Large sliding: a block drawn across another by five cells, whose meshes do not match."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import every_nth
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

CELL, MU = 0.25, 0.3
FORCE = 100.0 * 0.005 / 0.5  # E strain, on a side of 1 m: the sliding block is 1e7 times as stiff, nu = 0


def drawn(slave: str, operator: str, order: int, friction: dict[str, Any], law: dict[str, Any]) -> Simulation:
    """The upper, rigid block pressed down, then drawn in x."""
    sides = {"upper": "upper.bottom", "lower": "lower.top"}
    other = "lower" if slave == "upper" else "upper"
    contact = {"surface": sides[slave], "against": sides[other], "operator": operator, "sliding": True, "normal": law}
    scene = from_dict(
        {
            "model": "plane strain",
            "geometry": {
                "builder": "two_blocks",
                "length": 4.0,
                "lower_length": 1.0,
                "height": 0.5,
                "mesh_size": CELL * 2 / 3,
                "lower_mesh_size": CELL,
                "offset": -1.0,
                "order": order,
            },
            "bodies": {"upper": {"E": 1e9, "nu": 0.0}, "lower": {"E": 100.0, "nu": 0.0}},
            "contacts": {"joint": contact | friction},
            "supports": {
                "drive": {
                    "boundary": "upper.top",
                    "displacement": {"x": [[0, 0], [1, 0], [2, 5 * CELL]], "y": [[0, 0], [1, -0.005]]},
                },
                "base": {"boundary": "lower.bottom", "displacement": {"y": 0.0}},
                "pin": {"point": [2.0, -0.5], "displacement": {"x": 0.0}},
            },
            "steps": {"end": 2.0, "count": 12},
        }
    )
    return prepare(scene)


def slide(slave: str, operator: str, order: int, friction: dict[str, Any], law: dict[str, Any]) -> list[StepResult]:
    """Results while it slides."""
    return [step for step in drawn(slave, operator, order, friction, law).steps() if step.time > 1.0]


@pytest.mark.parametrize(
    ("order", "slave", "friction"),
    every_nth(2, [1, 2], ["upper", "lower"], [{}, {"friction": {"law": "coulomb", "mu": MU}}]),
)
def test_force_does_not_feel_the_cells_that_pass(slave: str, order: int, friction: dict[str, Any]) -> None:
    steps = slide(slave, "mortar", order, friction, {"law": "unilateral"})
    forces = np.array([step.contacts["joint"].normal_force for step in steps])
    assert len(forces) >= 6
    assert_allclose(forces, FORCE, rtol=1e-6)  # the stiffness of the upper block: 1e-7
    assert np.ptp(forces) <= 1e-6 * FORCE
    for step in steps:
        energy = step.energy  # 1e9 Pa moved by a metre, which leaves no rounding: it is a rigid motion
        assert_allclose(energy.external, energy.stored + energy.contact, rtol=0, atol=1e-12)
    if friction and slave == "lower":  # all of it is covered, at every step
        assert_allclose([s.contacts["joint"].tangential_force for s in steps], MU * forces, rtol=1e-6)
        assert steps[-1].contacts["joint"].max_slip > 4.5 * CELL


def test_force_of_nodes_on_segments_swings_with_the_cells() -> None:
    steps = slide("lower", "node-to-segment", 1, {}, {"law": "unilateral"})
    forces = np.array([step.contacts["joint"].normal_force for step in steps])
    assert np.ptp(forces) <= 0.05 * FORCE


@pytest.mark.parametrize("slave", ["upper", "lower"])
def test_compliance_slides_too(slave: str) -> None:
    steps = slide(slave, "mortar", 1, {}, {"law": "compliance", "c_n": 1e4})
    # two springs in series: the block, 100 Pa / 0.5 m, and the surface
    expected = 0.005 / (0.5 / 100.0 + 1e-4)
    assert_allclose([step.contacts["joint"].normal_force for step in steps], expected, rtol=1e-6)


def test_pairs_are_searched_again_but_bodies_not_prepared_again() -> None:
    simulation = drawn("lower", "mortar", 1, {}, {"law": "unilateral"})
    steps = list(simulation.steps())
    assert simulation.counters.searches > len(steps)
    assert simulation.counters.factorisations == 1


def test_a_rigid_roller_presses_as_hard_wherever_it_is_drawn() -> None:
    roller = {"shape": "cylinder", "point": [2.0, 2.0], "radius": 1.0}
    roller["displacement"] = {"x": [[0, 0], [1, 0], [2, 1.0]], "y": [[0, 0], [1, -0.02]]}
    contact = {"surface": "block.top", "against": "roller", "sliding": True}
    data = {
        "model": "plane strain",
        "geometry": {"builder": "block", "length": 5.0, "height": 1.0, "mesh_size": 0.1, "contact_mesh_size": 0.05},
        "bodies": {"block": {"E": 1.0, "nu": 0.3}},
        "obstacles": {"roller": roller},
        "contacts": {"track": contact},
        "supports": {"base": {"boundary": "block.bottom", "displacement": {"x": 0.0, "y": 0.0}}},
        "steps": {"end": 2.0, "count": 2},
    }
    pressed, moved = prepare(from_dict(data)).steps()
    force = pressed.contacts["track"].normal_force
    assert force > 0
    assert_allclose(moved.contacts["track"].normal_force, force, rtol=0.02)  # 10 cells touch, 20 passed; ends 1.5 m off
    *_, smoothed = prepare(from_dict(data | {"solver": {"method": "regularised"}})).steps()
    assert_allclose(smoothed.contacts["track"].normal_force, moved.contacts["track"].normal_force, rtol=2e-3)
