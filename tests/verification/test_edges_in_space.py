"""Edges and corners in 3D, at order 1 and 2: a cube on its corner, whole skins, a bar on rollers."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import audit, solved
from shared.cases import slow
from stickslip import StepResult
from stickslip.workflows.scene_file.read import from_dict

STIFF = {"E": 1000.0, "nu": 0.3}
CORNER = """
SetFactory("OpenCASCADE");
DefineConstant[h=0.5];
Box(1) = {0, 0, 0, 1, 1, 1};
Rotate {{0, 0, 1}, {0, 0, 0}, Pi/4} { Volume{1}; }
Rotate {{1, 0, 0}, {0, 0, 0}, Acos(1/Sqrt(3))} { Volume{1}; }
Translate {0.1, 0.07, 0} { Volume{1}; }
Box(2) = {-1, -1, -1, 2, 2, 1};
Mesh.MeshSizeMin = h; Mesh.MeshSizeMax = h;
Physical Volume("cube") = {1}; Physical Volume("slab") = {2};
a() = Surface In BoundingBox{-0.95, -0.95, -0.01, 0.95, 0.95, 1.5}; Physical Surface("cube.low") = {a()};
c() = Surface In BoundingBox{-0.95, -0.95, 0.5, 0.95, 0.95, 2}; Physical Surface("cube.high") = {c()};
b() = Surface In BoundingBox{-1.1, -1.1, -1.1, 1.1, 1.1, -0.9}; Physical Surface("slab.bottom") = {b()};
"""
PUNCH = """
SetFactory("OpenCASCADE");
DefineConstant[h=0.5]; DefineConstant[lean=0];
Box(1) = {-3, 0, -1, 6, 2, 1};
Point(101) = {-1, 0, 0}; Point(102) = {1, 0, 0}; Point(103) = {1 + lean, 0, 1.5}; Point(104) = {-1 - lean, 0, 1.5};
Line(101) = {101, 102}; Line(102) = {102, 103}; Line(103) = {103, 104}; Line(104) = {104, 101};
Curve Loop(101) = {101, 102, 103, 104}; Plane Surface(101) = {101};
Extrude {0, 2, 0} { Surface{101}; }
Mesh.MeshSizeMin = h; Mesh.MeshSizeMax = h;
Physical Volume("slab") = {1}; Physical Volume("block") = {2};
b() = Surface In BoundingBox{-4, -1, -1.1, 4, 3, -0.9}; Physical Surface("slab.bottom") = {b()};
t() = Surface In BoundingBox{-4, -1, 1.4, 4, 3, 1.6}; Physical Surface("block.top") = {t()};
"""


HELD = {"boundary": "slab.bottom", "displacement": [0.0, 0.0, 0.0]}
BALANCED = 1e-7  # of forces


def last(scene: dict[str, Any], folder: Path | None = None) -> StepResult:
    """The last step, which the audit finds no fault with."""
    simulation, steps = solved(from_dict(scene | {"output": {"error": False}}, folder))
    assert max(audit(simulation, steps[-1]).values()) < BALANCED
    return steps[-1]


@pytest.mark.parametrize(
    "case",
    [
        ("floor", 0.5, 1),
        ("floor", 0.5, 2),
        ("slab.*", 0.35, 1),
        *slow(("floor", 0.35, 1), ("floor", 0.25, 1), ("slab.*", 0.5, 1), ("slab.*", 0.25, 1), ("slab.*", 0.5, 2)),
    ],
)
def test_a_corner_on_a_face_presses_along_its_normal_where_it_is(case: tuple[str, float, int], tmp_path: Path) -> None:
    """A cube on its corner at (.1, .07, 0), its upper faces pressed down by .01: the corner hardly moves."""
    against, size, order = case
    (tmp_path / "corner.geo").write_text(CORNER)
    scene: dict[str, Any] = {
        "model": "3d",
        "geometry": {"file": "corner.geo", "h": size, "order": order},
        "bodies": {"cube": STIFF, "slab": STIFF},
        "contacts": {"tip": {"surface": "cube.low", "against": against}},
        "supports": {"bed": HELD, "press": {"boundary": "cube.high", "displacement": [0.0, 0.0, -0.01]}},
    }
    if against == "floor":
        scene["obstacles"] = {"floor": {"shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}
    tip = last(scene, tmp_path).contacts["tip"]
    up = tip.force[2]
    assert up > 0.5
    assert_allclose(tip.force, [0.0, 0.0, up], atol=1e-12)
    assert_allclose(tip.moment, [0.07 * up, -0.1 * up, 0.0], atol=2e-3 * up)
    assert (tip.status > 0).sum() == 1


@pytest.mark.parametrize("against", ["floor", *slow("slab.*")])
def test_a_law_of_compliance_is_felt_round_a_corner_of_a_cube(against: str, tmp_path: Path) -> None:
    """F = 3/2 c_n d³ on three faces whose normals have a cosine of 1/√3 with the vertical, at a depth d."""
    (tmp_path / "corner.geo").write_text(CORNER)
    normal = {"law": "compliance", "c_n": 0.1, "m_n": 1.0}
    scene: dict[str, Any] = {
        "model": "3d",
        "geometry": {"file": "corner.geo"},
        "bodies": {"cube": STIFF, "slab": STIFF},
        "contacts": {"tip": {"surface": "cube.low", "against": against, "normal": normal}},
        "supports": {"bed": HELD, "press": {"boundary": "cube.high", "displacement": [0.0, 0.0, -0.02]}},
    }
    if against == "floor":
        scene["obstacles"] = {"floor": {"shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}
    assert_allclose(last(scene, tmp_path).contacts["tip"].normal_force, 1.5 * 0.1 * 0.02**3, rtol=0.02)


@pytest.mark.parametrize(
    "case",
    [
        ("block.*", 0.3, 1.0, 2),
        ("slab.*", 0.3, 1.0, 1),
        *slow(("block.*", 0.0, 0.5, 1), ("slab.*", 0.0, 1.0, 2), ("slab.*", 0.3, 0.5, 1)),
    ],
)
def test_whole_skins_press_on_the_face_between_their_edges(case: tuple[str, float, float, int], tmp_path: Path) -> None:
    """A block 2 by 2 below, wider above by `lean` on either side, that is pressed on a slab as wide as it."""
    surface, lean, size, order = case
    (tmp_path / "punch.geo").write_text(PUNCH)
    (other,) = {"block.*", "slab.*"} - {surface}
    scene = {
        "model": "3d",
        "geometry": {"file": "punch.geo", "h": size, "order": order, "lean": lean},
        "bodies": {"block": STIFF, "slab": STIFF},
        "contacts": {"c": {"surface": surface, "against": other}},
        "supports": {"bed": HELD, "block": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0}}},
        "loads": {"press": {"boundary": "block.top", "pressure": 1.0}},
    }
    c, force = last(scene, tmp_path).contacts["c"], 4 * (1 + lean) * (1 if surface == "block.*" else -1)
    assert_allclose(c.force, [0.0, 0.0, force], atol=1e-7)
    assert_allclose(c.moment, [force, 0.0, 0.0], atol=1e-3)
    assert_allclose(c.contact_area, 4.0, rtol=1e-9)


FLANKS = """
l() = Surface In BoundingBox{-1.9, -1, -0.01, -0.9, 3, 1.6}; Physical Surface("block.left") = {l()};
u() = Surface In BoundingBox{-1.01, -1, -0.01, 1.01, 3, 0.01}; Physical Surface("block.under") = {u()};
s() = Surface In BoundingBox{-3.1, -1, -0.01, 3.1, 3, 0.01}; s() -= u(); Physical Surface("slab.upper") = {s()};
"""


@pytest.mark.parametrize(
    ("lean", "contacts"),
    [
        (0.3, {"c": {"surface": "slab.upper", "against": ["block.under", "block.left"]}}),
        (0.3, {name: {"surface": f"block.{name}", "against": "slab.upper"} for name in ("under", "left")}),
        (0.0, {name: {"surface": f"block.{name}", "against": "slab.upper"} for name in ("left", "under")}),
        (0.3, {name: {"surface": f"block.{name}", "against": "floor"} for name in ("under", "left")}),
    ],
)
def test_a_flank_that_is_named_beside_the_bottom_carries_nothing(
    lean: float, contacts: dict[str, Any], tmp_path: Path
) -> None:
    (tmp_path / "punch.geo").write_text(PUNCH + FLANKS)
    scene: dict[str, Any] = {
        "model": "3d",
        "geometry": {"file": "punch.geo", "h": 1.0, "lean": lean},
        "bodies": {"block": STIFF, "slab": STIFF},
        "contacts": contacts,
        "supports": {"bed": HELD, "block": {"boundary": "block.top", "displacement": {"x": 0.0, "y": 0.0}}},
        "loads": {"press": {"boundary": "block.top", "pressure": 1.0}},
    }
    if "floor" in str(contacts):
        scene["obstacles"] = {"floor": {"shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}
    found = last(scene, tmp_path).contacts
    for name, c in found.items():
        force = 4 * (1 + lean) * ("under" in name)
        assert_allclose(np.abs(c.force), [0.0, 0.0, force], atol=1e-9)


@pytest.mark.parametrize("normal", [{"law": "unilateral"}, {"law": "compliance", "c_n": 0.1}])
def test_faces_of_a_cube_on_its_corner_may_be_sides_of_their_own(normal: dict[str, Any], tmp_path: Path) -> None:
    low = 'Physical Surface("cube.low") = {a()};'
    named = 'Physical Surface("cube.one") = {a(0)}; Physical Surface("cube.two") = {a(1), a(2)};'
    found = []
    for text, sides in ((CORNER, ["low"]), (CORNER.replace(low, named), ["one", "two"])):
        (tmp_path / "corner.geo").write_text(text)
        scene: dict[str, Any] = {
            "model": "3d",
            "geometry": {"file": "corner.geo"},
            "bodies": {"cube": STIFF, "slab": STIFF},
            "contacts": {side: {"surface": f"cube.{side}", "against": "slab.*", "normal": normal} for side in sides},
            "supports": {"bed": HELD, "press": {"boundary": "cube.high", "displacement": [0.0, 0.0, -0.01]}},
        }
        found.append(sum(contact.force for contact in last(scene, tmp_path).contacts.values()))
    assert_allclose(found[1], found[0], atol=1e-2 * found[0][2])


@pytest.mark.parametrize("mu", [0.0, 0.2])
def test_a_bar_on_rollers_in_3d_is_the_beam(mu: float) -> None:
    """Of 10 mm width, three-point bending by 1 mm: Timoshenko's force, and thrust of both rollers with friction."""

    def roller(x: float, height: float, **motion: float) -> dict[str, Any]:
        shape = {"shape": "cylinder", "point": [x, 0.0, height], "axis": [0.0, 1.0, 0.0], "radius": 5.0}
        return shape | ({"displacement": motion} if motion else {})

    friction = {"friction": {"law": "coulomb", "mu": mu}} if mu else {}
    size = {"length": 220.0, "width": 10.0, "height": 20.0, "mesh_size": 10.0, "order": 2}
    scene = {
        "model": "3d",
        "units": "mm-N-MPa",
        "geometry": {"builder": "block"} | size,
        "bodies": {"block": {"E": 70000.0, "nu": 0.0}},
        "obstacles": {"left": roller(10, -5), "right": roller(210, -5), "punch": roller(110, 25, z=-1.0)},
        "contacts": {
            "rollers": {"surface": "block.bottom", "against": ["left", "right"]} | friction,
            "punch": {"surface": "block.top", "against": "punch"},
        },
        "springs": {"hold": {"at": "block.left", "stiffness": [1.0, 1.0, 0.0]}},
    }
    step = last(scene)
    whole = step.sums["rollers"].force
    left, right = (step.contacts[f"rollers.{name}"].force for name in ("left", "right"))
    assert_allclose(whole, left + right, atol=1e-9)
    assert_allclose(left[2], right[2], rtol=1e-4)
    assert_allclose(step.contacts["punch"].force, [0.0, 0.0, -whole[2]], atol=1e-6 * whole[2])
    assert_allclose(np.abs([left[0], right[0]]), mu * whole[2] / 2, rtol=0.01, atol=1e-9)  # the whole of it slips
    beam = 2715.0 / (1 - 1.5 * mu * 20.0 / 200.0)  # as in the ready scene; thrust at the lower face bends it upwards
    assert_allclose(whole[2], beam, rtol=0.003)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_block_slides_on_three_partners(dim: int) -> None:
    """Dragged by half of their distance: the rollers share its load, and each has its friction."""
    up, axis = "yz"[dim - 2], {} if dim == 2 else {"axis": [0.0, 1.0, 0.0]}
    place = {name: [x, *[0.0] * (dim - 2), -1.0] for name, x in (("one", 2.0), ("two", 5.0), ("three", 8.0))}
    names, width = list(place), {} if dim == 2 else {"width": 1.0}
    scene = {
        "model": "plane strain" if dim == 2 else "3d",
        "geometry": {"builder": "block", "length": 10.0, "height": 1.0, "mesh_size": 0.5} | width,
        "bodies": {"block": {"E": 1e4, "nu": 0.3}},
        "obstacles": {k: {"shape": "cylinder", "point": x, "radius": 1.0} | axis for k, x in place.items()},
        "contacts": {
            "bed": {"surface": "block.bottom", "against": names, "friction": {"law": "coulomb", "mu": 0.1}}
            | {"sliding": True}
        },
        "supports": {"top": {"boundary": "block.top", "displacement": {"x": [[0, 0], [1, 0], [2, 1.5]], up: -0.01}}},
        "steps": {"end": 2.0, "count": 4},
    }
    step = last(scene)
    beds = [step.contacts[f"bed.{name}"] for name in names]
    for bed in beds:
        assert bed.normal_force > 50.0
        assert_allclose(bed.tangential_force, 0.1 * bed.normal_force, rtol=1e-5)
        assert_allclose(np.linalg.norm(bed.force), np.sqrt(1.01) * bed.normal_force, rtol=1e-3)
    assert_allclose(sum(bed.force for bed in beds), step.sums["bed"].force, atol=1e-9)
    assert_allclose(step.sums["bed"].force, -step.supports["top"].force, atol=1e-4)
