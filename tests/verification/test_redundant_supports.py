"""A nearly rigid block on four feet: forces on single feet may be anything, the displacement is one."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stickslip.solvers.results.step_result import StepResult
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

TABLE = """
def build(model, parameters):
    occ, foot = model.occ, 0.3
    box = occ.addBox(0, 0, 0, 1, 1, 0.4)
    corners = [(x, y) for x in (0, 1 - foot) for y in (0, 1 - foot)]
    feet = [(2, occ.addRectangle(x, y, 0, foot, foot)) for x, y in corners]
    occ.fragment([(3, box)], feet)
    occ.synchronize()

    def name(dim, tags, text):
        model.setPhysicalName(dim, model.addPhysicalGroup(dim, tags), text)

    def inside(x, y, z, size):
        e = 1e-6
        found = model.getEntitiesInBoundingBox(x - e, y - e, z - e, x + size + e, y + size + e, z + e, 2)
        return [tag for dim, tag in found]

    name(3, [tag for dim, tag in model.getEntities(3)], "table")
    for k, (x, y) in enumerate(corners):
        name(2, inside(x, y, 0, foot), f"table.foot_{k}")
    name(2, inside(0, 0, 0.4, 1), "table.top")
"""
P = 1e6  # [Pa]
STIFF = 1e12  # [Pa]
UNEVEN = np.array([0.0, 0.2, 0.05, 0.3])  # heights of the floor under the feet, over P / E: all of them touch


def stand(path: Path, E: float, order: tuple[int, ...] = (0, 1, 2, 3), **solver: Any) -> StepResult:
    """The table on its feet under a load that leans to one side."""
    (path / "table.py").write_text(TABLE)
    data = {
        "model": "3d",
        "geometry": {"file": str(path / "table.py"), "mesh_size": 0.15},
        "bodies": {"table": {"E": E, "nu": 0.3}},
        "obstacles": {"floor": {"shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}},
        "contacts": {
            f"foot_{k}": {"surface": f"table.foot_{k}", "against": "floor", "gap_offset": UNEVEN[k] * P / E}
            for k in order
        },
        "supports": {
            "here": {"point": [0.0, 0.0, 0.4], "displacement": {"x": 0.0, "y": 0.0}},
            "there": {"point": [1.0, 0.0, 0.4], "displacement": {"y": 0.0}},
        },
        "loads": {"top": {"boundary": "table.top", "pressure": P}},
        "solver": solver,
    }
    (step,) = prepare(from_dict(data)).steps()
    return step


def test_displacement_of_a_stiff_block_on_four_feet_is_unique(tmp_path: Path) -> None:
    found = stand(tmp_path, STIFF)
    again = stand(tmp_path, STIFF, order=(2, 0, 3, 1), tolerance=1e-12)
    size = np.abs(found.displacement).max()
    assert_allclose(again.displacement, found.displacement, rtol=0, atol=1e-6 * size)
    carried = sum(foot.normal_force for foot in found.contacts.values())
    assert_allclose(carried, P, rtol=1e-7)  # the top's area is 1 m²; the solver's 1e-8
    assert min(foot.normal_force for foot in found.contacts.values()) > 0.01 * P  # all four have to


@pytest.mark.parametrize("E", [1.0, 1e6])
def test_stiffness_scales_the_displacement_and_nothing_else(tmp_path: Path, E: float) -> None:
    stiff, soft = stand(tmp_path, STIFF), stand(tmp_path, E)
    size = np.abs(stiff.displacement).max()
    assert_allclose(soft.displacement * E / STIFF, stiff.displacement, rtol=0, atol=1e-6 * size)
