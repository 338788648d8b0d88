"""A block on a wider one whose overhang carries the same pressure: the pressure under the block is uniform."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import every_nth
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

BLOCKS = """
def build(model, parameters):
    occ = model.occ
    upper = occ.addRectangle(0.5, 1, 0, 1, 1)
    corners = [(0, 0), (2, 0), (2, 1), (1.5, 1), (0.5, 1), (0, 1)]
    points = [occ.addPoint(x, y, 0) for x, y in corners]
    lines = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1])]
    lower = occ.addPlaneSurface([occ.addCurveLoop(lines)])
    occ.synchronize()
    below, right, above, left = (tag for dim, tag in model.getBoundary([(2, upper)], oriented=False))
    groups = {
        (2, "upper"): [upper], (2, "lower"): [lower],
        (1, "upper.bottom"): [below], (1, "upper.top"): [above],
        (1, "lower.bottom"): [lines[0]], (1, "lower.overhang"): [lines[2], lines[4]],
        (1, "lower.top"): [lines[3]],
    }
    for (dim, name), tags in groups.items():
        model.setPhysicalName(dim, model.addPhysicalGroup(dim, tags), name)
    for dim, tag in model.getBoundary([(2, upper)], oriented=False, recursive=True):
        model.mesh.setSize([(dim, tag)], parameters["size"])
    for tag in points:
        model.mesh.setSize([(0, tag)], 0.3)
"""
P = 1e5  # [Pa]


@pytest.mark.parametrize(("slave", "size", "order"), every_nth(2, ["upper", "lower"], [0.2, 0.05], [1, 2]))
def test_pressure_goes_over_to_a_wider_block(tmp_path: Path, slave: str, size: float, order: int) -> None:
    (tmp_path / "blocks.py").write_text(BLOCKS)
    sides = ["upper.bottom", "lower.top"]
    surface, against = sides if slave == "upper" else sides[::-1]
    scene = from_dict(
        {
            "model": "plane strain",
            "geometry": {
                "file": str(tmp_path / "blocks.py"),
                "order": order,
                "parameters": {"size": size},
            },
            "bodies": {"upper": {"E": 2e6, "nu": 0.3}, "lower": {"E": 2e6, "nu": 0.3}},
            "contacts": {"joint": {"surface": surface, "against": against}},
            "supports": {
                "base": {"boundary": "lower.bottom", "displacement": {"y": 0.0}},
                "foot": {"point": [0.0, 0.0], "displacement": {"x": 0.0}},
                "top": {"point": [0.5, 2.0], "displacement": {"x": 0.0}},
            },
            "loads": {
                "top": {"boundary": "upper.top", "pressure": P},
                "overhang": {"boundary": "lower.overhang", "pressure": P},
            },
            "solver": {"tolerance": 1e-12},
        }
    )
    (step,) = prepare(scene).steps()
    joint = step.contacts["joint"]
    assert_allclose(joint.weight.sum(), 1.0, rtol=1e-9)
    assert_allclose(joint.pressure, P, rtol=1e-8)
    assert_allclose(step.stress[:, 1, 1], -P, rtol=1e-8)
    assert np.abs(step.stress[:, [0, 0], [0, 1]]).max() < 1e-8 * P
