"""Order 2 keeps its order where curved sides press on each other: shrink fits against Lamé's closed forms."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip import steps
from stickslip.workflows.scene_file.read import from_dict

QUARTERS = '''
def build(model, q):
    """Quarters of a shaft, .2 < r < 1, and of a hub, 1 < r < 2; in 3D extruded by .5, with cells in layers."""
    occ, high, ends = model.occ, q["dim"] == 3, {}
    for body, r, cells in (("inner", (0.2, 1.0), q["inner"]), ("outer", (1.0, 2.0), q["outer"])):
        centre = occ.addPoint(0, 0, 0)
        a, b, c, d = (occ.addPoint(x, y, 0) for x, y in ((r[0], 0), (r[1], 0), (0, r[1]), (0, r[0])))
        edges = [occ.addLine(a, b), occ.addCircleArc(b, centre, c), occ.addLine(c, d), occ.addCircleArc(d, centre, a)]
        face = occ.addPlaneSurface([occ.addCurveLoop(edges)])
        solid = occ.extrude([(2, face)], 0, 0, 0.5) if high else [(2, 0), (2, face)]
        occ.remove([(0, centre)])
        occ.synchronize()
        sides = [face, solid[0][1], *(tag for _, tag in solid[2:])] if high else edges
        names = ["bottom", "top"] * high + ["x_axis", "outside", "y_axis", "inside"]
        model.setPhysicalName(q["dim"], model.addPhysicalGroup(q["dim"], [solid[1][1]]), body)
        for side, name in zip(sides, names):
            model.setPhysicalName(q["dim"] - 1, model.addPhysicalGroup(q["dim"] - 1, [side]), f"{body}.{name}")
        around = [(2, side) for side in (sides if high else [face])]
        for _, edge in model.getBoundary(around, combined=False, oriented=False):
            low, up = model.getBoundingBox(1, edge)[:3], model.getBoundingBox(1, edge)[3:]
            x, y, z = (v - u for u, v in zip(low, up))
            count = cells // 4 if z > 0.1 else cells if x > 0.1 and y > 0.1 else cells // 2
            model.mesh.setTransfiniteCurve(edge, max(count, 1) + 1)
        for side in sides if high else [face]:
            model.mesh.setTransfiniteSurface(side)
            if q["boxes"]:
                model.mesh.setRecombine(2, side)
        if high and q["boxes"]:
            model.mesh.setTransfiniteVolume(solid[1][1])
'''
SHAFT, HUB, GAP = (2e5, 0.3), (1e5, 0.25), -1e-3


def grown(material: tuple[float, float], r: tuple[float, float], p: tuple[float, float], spherical: bool) -> float:
    """Displacement [m] at r = 1 of a ring in plane strain, or of a shell, under pressures inside and outside."""
    (E, nu), radii = material, np.array(r)
    G, K = E / 2 / (1 + nu), E / 3 / (1 - 2 * nu)
    stress = [3 * K + 0 * radii, -4 * G / radii**3] if spherical else [2 * (K + G / 3) + 0 * radii, -2 * G / radii**2]
    return float(np.linalg.solve(np.transpose(stress), -np.array(p)).sum())


def pressure(spherical: bool) -> float:
    """Contact pressure [Pa] of the fit."""
    return -GAP / (grown(HUB, (1.0, 2.0), (1.0, 0.0), spherical) - grown(SHAFT, (0.2, 1.0), (0.0, 1.0), spherical))


def fit(folder: Path, cells: int, model: str, slave: str, matching: bool, tied: bool, boxes: bool) -> Any:
    """The contact at the end; a tied one is loaded by the shaft's warmth."""
    (folder / "quarters.py").write_text(QUARTERS)
    spatial = model == "3d"
    count = cells if matching else 3 * cells // 4
    names = {"outer": "outer.inside", "inner": "inner.outside"}
    other = next(name for name in names if name != slave)
    fixed = {"x_axis": "y", "y_axis": "x", "bottom": "z", "top": "z"}
    held = [key for key in fixed if spatial or key == "x_axis"]
    data = {
        "model": model,
        "geometry": {
            "file": str(folder / "quarters.py"),
            "order": 2,
            "parameters": {"dim": 3 if spatial else 2, "inner": cells, "outer": count, "boxes": boxes},
        },
        "bodies": {body: {"E": E, "nu": nu} for body, (E, nu) in (("inner", SHAFT), ("outer", HUB))},
        "contacts": {
            "fit": {"surface": names[slave], "against": names[other]}
            | ({"normal": {"law": "tied"}} if tied else {"gap": GAP})
        },
        "supports": {
            f"{body}_{side}": {"boundary": f"{body}.{side}", "displacement": {fixed[side]: 0.0}}
            for body in names
            for side in held
        },
        "output": {"error": False},
    }
    if tied:
        free = -GAP / (1 + SHAFT[1] if spatial else 1.0)
        data["thermal"] = {"inner": {"expansion": free, "temperature": 1.0}}
    return list(steps(from_dict(data)))[-1].contacts["fit"]


def orders(folder: Path, model: str, counts: tuple[int, int], **how: Any) -> tuple[float, float, Any]:
    """Orders of the normal force and of the force along the axis that is free, and the finer fit."""
    spatial, exact = model == "3d", pressure(model != "3d")
    area, across = (np.pi / 4, 0.5) if spatial else (2 * np.pi, np.pi)
    found = [fit(folder, cells, model, **how) for cells in counts]
    off = [
        (abs(one.normal_force / (exact * area) - 1), abs(abs(one.force[0 if spatial else 1]) / (exact * across) - 1))
        for one in found
    ]
    rates = np.log(np.array(off[0]) / off[1]) / np.log(counts[1] / counts[0])
    return float(rates[0]), float(rates[1]), found[1].pressure / exact - 1


@pytest.mark.slow
@pytest.mark.parametrize("tied", [False, True])
@pytest.mark.parametrize("slave", ["outer", "inner"])
@pytest.mark.parametrize("matching", [True, False])
def test_tetrahedra_keep_their_order(tmp_path: Path, slave: str, matching: bool, tied: bool) -> None:
    """The dual basis reproduces constants only, a uniform pressure p n is among them."""
    normal, across, _ = orders(tmp_path, "3d", (4, 8), slave=slave, matching=matching, tied=tied, boxes=False)
    assert normal > 2.5
    assert across > 2.2


@pytest.mark.slow
@pytest.mark.parametrize("matching", [True, False])
def test_hexahedra_keep_their_order(tmp_path: Path, matching: bool) -> None:
    how = {"slave": "outer", "matching": matching, "tied": False, "boxes": True}
    normal, across, off = orders(tmp_path, "3d", (4, 8), **how)
    assert min(normal, across) > 2.85
    assert np.abs(off).max() < 0.015


@pytest.mark.slow
@pytest.mark.parametrize("tied", [False, True])
@pytest.mark.parametrize("slave", ["outer", "inner"])
def test_shells_keep_their_order_to_the_axis(tmp_path: Path, slave: str, tied: bool) -> None:
    """Spherical shells: the side's normal turns from the plane of symmetry to the axis."""
    how = {"slave": slave, "matching": False, "tied": tied, "boxes": False}
    normal, across, off = orders(tmp_path, "axisymmetric", (8, 16), **how)
    assert min(normal, across) > 2.5
    assert np.abs(off).max() < 0.015


def test_boxes_that_gmsh_itself_extrudes_are_round(tmp_path: Path) -> None:
    """Of order 2 the nodes in the middle of their sides have no parameters in its own kernel."""
    (tmp_path / "quarter.geo").write_text(
        """Point(1) = {0, 0, 0}; Point(2) = {1, 0, 0}; Point(3) = {2, 0, 0}; Point(4) = {0, 2, 0}; Point(5) = {0, 1, 0};
Line(1) = {2, 3}; Circle(2) = {3, 1, 4}; Line(3) = {4, 5}; Circle(4) = {5, 1, 2};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
Transfinite Curve {1, 3} = 3; Transfinite Curve {2, 4} = 5; Transfinite Surface {1}; Recombine Surface {1};
e[] = Extrude {0, 0, -1} { Surface{1}; Layers{2}; Recombine; };
Physical Volume("body") = {e[1]}; Physical Surface("body.top") = {1}; Physical Surface("body.bottom") = {e[0]};
Physical Surface("body.around") = {e[2], e[3], e[4], e[5]};
"""
    )
    data = {
        "model": "3d",
        "geometry": {"file": str(tmp_path / "quarter.geo"), "order": 2},
        "bodies": {"body": {"E": 1.0, "nu": 0.0}},
        "obstacles": {"floor": {"shape": "plane", "point": [0.0, 0.0, -1.0], "normal": [0.0, 0.0, 1.0]}},
        "contacts": {"base": {"surface": "body.bottom", "against": "floor", "friction": {"law": "stick"}}},
        "supports": {"top": {"boundary": "body.top", "displacement": {"x": 0.0, "y": 0.0, "z": -0.01}}},
        "output": {"error": False},
    }
    base = list(steps(from_dict(data)))[-1].contacts["base"]
    assert abs(base.contact_area / (3 * np.pi / 4) - 1) < 1e-3
