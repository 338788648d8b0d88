"""The audit of bodies that nothing loads: all that is found is rounding, however it is related to itself."""

from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

from shared.audited import record_of, stored_by
from stickslip.solvers.results.audit import Auditor
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.simulation import Simulation

SceneOf = Callable[..., Scene]
SimulationOf = Callable[[Scene], Simulation]
CLEAN = 1e-8
PULL = 1e-6  # Pa, 1e5 times that rounding: it is noticed
COULOMB = {"law": "coulomb", "mu": 0.1}
WALL = {"wall": {"boundary": "block.right", "displacement": {"x": 0.0}}}
SLOPES = {
    "normal": {"law": "compliance", "c_n": 1e9, "m_n": 1.0},
    "friction": {"law": "coulomb", "mu": 0.3, "k_T": 1e8},
}
WITHOUT_WEIGHT: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {  # the contact, and what is held
    "compliant, square": ({"normal": SLOPES["normal"] | {"m_n": 2.0}, "friction": COULOMB}, WALL),
    "compliant": ({"normal": SLOPES["normal"], "friction": COULOMB | {"mu": 0.3}}, {}),
    "compliant, springs": (SLOPES, {}),
    "unilateral": ({"friction": COULOMB}, {}),
    "bilateral, springs": ({"normal": {"law": "bilateral"}, "friction": SLOPES["friction"]}, WALL),
}


FLOOR = {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
HILLTOP = {"shape": "cylinder", "point": [1.0, -5.0], "radius": 5.0}
ASIDE, DOWN_UP = [[0.0, 0.0], [2.0, 0.01]], [[0.0, 0.0], [1.0, -0.01], [2.0, 0.01]]
MOVING = [
    *((name, FLOOR | {"displacement": motion}) for name in WITHOUT_WEIGHT for motion in ({"x": ASIDE}, {"y": DOWN_UP})),
    ("compliant, square", HILLTOP | {"displacement": {"x": ASIDE}}),  # it leaves the one point that touches
]


@pytest.mark.parametrize(("name", "floor"), MOVING)
def test_what_rests_without_weight_on_a_floor_that_moves_is_clean(
    name: str, floor: dict[str, Any], scene_of: SceneOf, simulation_of: SimulationOf
) -> None:
    """All that is found are tractions of 1e-11 Pa: rounding, however they are related to each other."""
    contact, supports = WITHOUT_WEIGHT[name]
    scene = scene_of(
        bodies={"block": {"E": 1e7, "nu": 0.3}},
        obstacles={"floor": floor},
        contacts={"base": {"surface": "block.bottom", "against": "floor", **contact}},
        supports=supports,
        steps={"end": 2.0, "count": 2},
        geometry={"cells": "tensor", "mesh_size": 0.5},
    )
    simulation = simulation_of(scene)
    audit, steps = Auditor(simulation.problem, simulation.mesh), [*simulation.steps()]
    assert [step.substeps for step in steps] == [1, 1]
    for step in steps:
        record = record_of(step)
        assert max(asdict(audit(replace(record, stored=stored_by(step)))).values()) < CLEAN
        assert np.abs(record.displacement).max() < 0.011  # it goes no farther than the floor
        assert audit(replace(record, p=record.p - PULL)).negative_pressure > 0.9 or name.startswith("bilateral")
