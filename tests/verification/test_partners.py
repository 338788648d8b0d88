"""One side against several partners: each part belongs to the one that it reaches first."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import audit, solved
from stickslip.geometry.errors import SceneError
from stickslip.solvers.results.step_result import StepResult, told
from stickslip.workflows.scene_file.read import from_dict

PLANE = """
Rectangle(1) = {0, 0, 0, 2, 1}; Rectangle(2) = {0, -1, 0, seam, 1}; Rectangle(3) = {seam, -1, 0, 2 - seam, 1};
Physical Surface("top") = {1}; Physical Surface("left") = {2}; Physical Surface("right") = {3};
Physical Curve("top.under") = {1}; Physical Curve("top.upper") = {3}; Physical Curve("top.end") = {4};
Physical Curve("left.upper") = {7}; Physical Curve("left.under") = {5}; Physical Curve("left.end") = {8};
Physical Curve("right.upper") = {11}; Physical Curve("right.under") = {9}; Physical Curve("right.end") = {10};
MeshSize{PointsOf{Surface{1};}} = 0.25; MeshSize{PointsOf{Surface{2};}} = 0.23; MeshSize{PointsOf{Surface{3};}} = 0.4;
"""
SPACE = """
Box(1) = {0, 0, 0, 2, 1, 1}; Box(2) = {0, 0, -1, seam, 1, 1}; Box(3) = {seam, 0, -1, 2 - seam, 1, 1};
Physical Volume("top") = {1}; Physical Volume("left") = {2}; Physical Volume("right") = {3};
Physical Surface("top.end") = {1}; Physical Surface("top.under") = {5}; Physical Surface("top.upper") = {6};
Physical Surface("left.end") = {7}; Physical Surface("left.under") = {11}; Physical Surface("left.upper") = {12};
Physical Surface("right.end") = {14}; Physical Surface("right.under") = {17}; Physical Surface("right.upper") = {18};
MeshSize{PointsOf{Volume{1};}} = 0.5; MeshSize{PointsOf{Volume{2};}} = 0.41; MeshSize{PointsOf{Volume{3};}} = 0.6;
"""
HEAD = 'SetFactory("OpenCASCADE"); DefineConstant[seam = 1.0];'
STRAIN = 0.01


def blocks(folder: Path, dim: int = 2, **tables: Any) -> dict[str, Any]:
    """A block on two others that meet beneath it, at `seam`; what it is pressed by strains all of them alike."""
    (folder / "blocks.geo").write_text(HEAD + (PLANE if dim == 2 else SPACE))
    up = "xyz"[dim - 1]
    still = {name: {"boundary": f"{name}.end", "displacement": {"x": 0.0}} for name in ("top", "left", "right")}
    corners = {"top": [0.0, 0.0, 1.0], "left": [0.0, 0.0, -1.0], "right": [2.0, 0.0, -1.0]} if dim == 3 else {}
    across = {f"{name}_y": {"point": point, "displacement": {"y": 0.0}} for name, point in corners.items()}
    ends = {f"{name}_under": {"boundary": f"{name}.under", "displacement": {up: 0.0}} for name in ("left", "right")}
    pressed = {"upper": {"boundary": "top.upper", "displacement": {up: -2 * STRAIN}}}
    steps = {"solver": {"tolerance": 1e-12}, "output": {"pictures": False}}
    return (
        steps
        | {
            "model": "plane strain" if dim == 2 else "3d",
            "geometry": {"file": "blocks.geo", "order": 1},
            "bodies": {name: {"E": 1.0, "nu": 0.0} for name in ("top", "left", "right")},
            "contacts": {"seat": {"surface": "top.under", "against": ["left.upper", "right.upper"]}},
            "supports": {**still, **across, **ends, **pressed},
        }
        | tables
    )


def run(folder: Path, scene: dict[str, Any]) -> StepResult:
    simulation, (result,) = solved(from_dict(scene, folder))
    assert audit(simulation, result)["equilibrium"] < 1e-9
    return result


def pressures(result: StepResult) -> np.ndarray:
    """At all nodes that a partner has."""
    return np.concatenate([c.pressure[c.weight > 0] for c in result.contacts.values()])


ROUNDING = 1e-8


@pytest.mark.parametrize("seam", [1.0, 0.87])  # at a node of the block, and inside a facet
@pytest.mark.parametrize(("dim", "order"), [(2, 1), (2, 2), (3, 1)])
def test_a_uniform_pressure_passes_where_three_bodies_meet(dim: int, order: int, seam: float, tmp_path: Path) -> None:
    scene = blocks(tmp_path, dim)
    scene["geometry"] |= {"order": order, "seam": seam}
    result = run(tmp_path, scene)
    assert_allclose(pressures(result), STRAIN, rtol=ROUNDING)
    forces = {name: c.normal_force for name, c in result.contacts.items()}
    assert_allclose([forces["seat.left"], forces["seat.right"]], STRAIN * np.array([seam, 2 - seam]), rtol=ROUNDING)
    assert_allclose(result.sums["seat"].normal_force, 2 * STRAIN, rtol=ROUNDING)
    assert_allclose(result.sums["seat"].force[-1], 2 * STRAIN, rtol=ROUNDING)
    assert_allclose(result.sums["seat"].contact_area, 2.0, rtol=ROUNDING)


@pytest.mark.parametrize("operator", ["mortar", "node-to-segment"])
def test_several_contacts_of_one_side_are_the_same_as_a_list(operator: str, tmp_path: Path) -> None:
    listed = blocks(tmp_path)
    listed["contacts"]["seat"]["operator"] = operator
    each = {side: listed["contacts"]["seat"] | {"against": f"{side}.upper"} for side in ("left", "right")}
    one, two = run(tmp_path, listed), run(tmp_path, listed | {"contacts": each})
    for side, contact in two.contacts.items():
        assert_allclose(one.contacts[f"seat.{side}"].pressure, contact.pressure, atol=1e-15)
    assert sum(c.weight.sum() for c in two.contacts.values()) == pytest.approx(2.0)


@pytest.mark.parametrize("seam", [1.0, 0.87])
@pytest.mark.parametrize(
    ("law", "dim", "order"),
    [("unilateral", 2, 1), ("unilateral", 2, 2), ("compliance", 2, 1), ("compliance", 2, 2), ("compliance", 3, 1)],
)
def test_a_body_and_an_obstacle_share_a_side(law: str, dim: int, order: int, seam: float, tmp_path: Path) -> None:
    """Each has what its own part of the side carries, also of a facet that both share."""
    size = STRAIN if law == "unilateral" else 2 * STRAIN / 3
    up = "xyz"[dim - 1]
    floor = {"shape": "plane", "point": [0.0] * dim, "normal": [*[0.0] * (dim - 1), 1.0], "displacement": {up: -size}}
    scene = blocks(tmp_path, dim, obstacles={"floor": floor})  # which gives way as the body does
    scene["geometry"] |= {"order": order, "seam": seam}
    normal = {"law": law} | ({"c_n": 1.0, "m_n": 1.0} if law == "compliance" else {})
    scene["contacts"] = {"seat": {"surface": "top.under", "against": ["left.upper", "floor"], "normal": normal}}
    found = [run(tmp_path, scene).contacts[name] for name in ("seat.left", "seat.floor")]
    forces = size * np.array([seam, 2 - seam])
    assert_allclose([c.normal_force for c in found], forces, rtol=ROUNDING)
    if law == "compliance":
        arms = np.array([seam, seam + 2]) / 2
        assert_allclose([abs(c.moment[-2 if dim == 3 else 0]) for c in found], forces * arms, rtol=1e-3)


def test_obstacles_divide_a_side_by_the_nearest_and_each_has_its_law(tmp_path: Path) -> None:
    scene = blocks(tmp_path)
    rollers = {
        name: {"shape": "cylinder", "point": [x, -0.2], "radius": 0.2} for name, x in (("near", 0.4), ("far", 1.6))
    }
    contacts = {
        name: {"surface": "top.under", "against": name, "friction": {"law": "coulomb", "mu": mu}}
        for name, mu in (("near", 0.1), ("far", 0.3))
    }
    scene |= {"obstacles": rollers, "contacts": contacts}
    result = run(tmp_path, scene)
    near, far = result.contacts["near"], result.contacts["far"]
    assert not ((near.weight > 0) & (far.weight > 0)).any()
    assert_allclose(near.weight + far.weight, np.maximum(near.weight, far.weight))
    assert (near.points[near.weight > 0][:, 0] <= 1.01).all()
    assert near.normal_force > 0
    assert far.normal_force > 0
    assert near.bound.max() == pytest.approx(0.1 * near.pressure.max())
    assert far.bound.max() == pytest.approx(0.3 * far.pressure.max())


def test_a_block_slides_from_one_partner_onto_the_other(tmp_path: Path) -> None:
    """Its side belongs first to the left table, then to both, and the weight is borne throughout."""
    scene = blocks(tmp_path)
    scene["geometry"] |= {"seam": 1.3}
    scene["contacts"]["seat"] |= {"sliding": True, "friction": {"law": "coulomb", "mu": 0.2}}
    scene["supports"]["top"]["displacement"] = {"x": [[0, 0], [1, 0], [2, 0.6]]}
    scene["supports"]["upper"]["displacement"] = {"y": [[0, 0], [1, -2 * STRAIN], [2, -2 * STRAIN]]}
    scene["supports"]["under"] = {"boundary": "right.end", "displacement": {"x": 0.0}}
    scene["steps"] = {"end": 2.0, "count": 7}
    steps = solved(from_dict(scene, tmp_path))[1]
    share = [step.contacts["seat.right"].contact_area / step.sums["seat"].contact_area for step in steps]
    assert share[0] == pytest.approx(0.35, abs=0.05)
    assert share[-1] == pytest.approx(0.5, abs=0.05)
    total = [step.sums["seat"].normal_force for step in steps[2:]]
    assert min(total) > 0.5 * max(total)


def test_numbers_by_partner_and_in_sum_have_names(tmp_path: Path) -> None:
    scene = from_dict(blocks(tmp_path) | {"accuracy": {"goals": {"seat.normal_force": 0.1}}}, tmp_path)
    assert {"seat.normal_force", "seat.left.normal_force", "seat.right.max_pressure"} <= set(scene.quantities())
    (step,) = solved(scene)[1]
    plain = told(step, None)["contacts"]
    assert list(plain) == ["seat.left", "seat.right", "seat"]
    assert plain["seat"]["statuses"]["slip"] == sum(
        plain[f"seat.{side}"]["statuses"]["slip"] for side in ("left", "right")
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"against": []}, r"against = .*is empty"),
        ({"against": ["left.upper", "left.upper"]}, "against = .*name each once"),
        ({"against": ["left.upper", "rihgt.upper"]}, r"did you mean right\.upper"),
    ],
)
def test_lists_that_name_no_partners_are_refused(change: dict[str, Any], said: str, tmp_path: Path) -> None:
    scene = blocks(tmp_path)
    scene["contacts"]["seat"] |= change
    with pytest.raises(SceneError, match=said):
        from_dict(scene, tmp_path)


def test_contacts_of_one_side_slide_together_and_have_one_operator(tmp_path: Path) -> None:
    seat = {"surface": "top.under", "against": "left.upper"}
    for change, said in (({"sliding": True}, "sliding = true"), ({"operator": "node-to-segment"}, "has one operator")):
        other = seat | {"against": "right.upper"} | change
        with pytest.raises(SceneError, match=said):
            from_dict(blocks(tmp_path, contacts={"one": seat, "other": other}), tmp_path)


def test_methods_that_write_forms_of_the_whole_side_refuse_a_part_of_it(tmp_path: Path) -> None:
    scene = blocks(tmp_path, solver={"method": "block-uzawa"})
    with pytest.raises(SceneError, match="takes one contact a side"):
        solved(from_dict(scene, tmp_path))


HALVES = """
Point(1) = {0, 0, 0}; Point(2) = {1, 0, 0}; Point(3) = {2, 0, 0}; Point(4) = {2, 1, 0}; Point(5) = {0, 1, 0};
Point(11) = {0, 0, 0}; Point(12) = {1, 0, 0}; Point(13) = {2, 0, 0}; Point(14) = {2, -1, 0}; Point(15) = {0, -1, 0};
For k In {0:1}
  q = 10 * k; Line(q + 1) = {q + 1, q + 2}; Line(q + 2) = {q + 2, q + 3}; Line(q + 3) = {q + 3, q + 4};
  Line(q + 4) = {q + 4, q + 5}; Line(q + 5) = {q + 5, q + 1}; Curve Loop(q + 1) = {q + 1:q + 5};
  Plane Surface(q + 1) = {q + 1}; Transfinite Curve{q + 1:q + 5} = 5;
EndFor
Physical Surface("up") = {1}; Physical Curve("up.left") = {1}; Physical Curve("up.right") = {2};
Physical Surface("low") = {11}; Physical Curve("low.left") = {11}; Physical Curve("low.right") = {12};
Physical Curve("up.top") = {4}; Physical Curve("low.bottom") = {14};
"""


@pytest.mark.parametrize("law", ["unilateral", "tied"])
@pytest.mark.parametrize("exchanged", [False, True])
def test_sides_of_the_same_bodies_that_meet_share_no_multiplier(law: str, exchanged: bool, tmp_path: Path) -> None:
    """A uniform pressure has one answer, though both contacts see the motion of the node between them."""
    (tmp_path / "halves.geo").write_text(HALVES)
    free = {} if law == "tied" else {"friction": {"law": "coulomb", "mu": 0.3}}
    right = ("low.right", "up.right") if exchanged else ("up.right", "low.right")
    coulomb = {"law": "coulomb", "mu": 0.3}
    scene = {
        "model": "plane strain",
        "geometry": {"file": "halves.geo"},
        "bodies": {name: {"E": 1.0, "nu": 0.0} for name in ("up", "low")},
        "contacts": {
            "r": {"surface": right[0], "against": right[1], "friction": coulomb},
            "l": {"surface": "up.left", "against": "low.left", "normal": {"law": law}} | free,
        },
        "supports": {
            "top": {"boundary": "up.top", "displacement": {"x": 0.0, "y": -0.02}},
            "bottom": {"boundary": "low.bottom", "displacement": {"x": 0.0, "y": 0.0}},
        },
    }
    result = run(tmp_path, scene)
    for contact in result.contacts.values():
        assert contact.normal_force == pytest.approx(0.01, rel=1e-8)
        assert contact.max_pressure == pytest.approx(0.01, rel=1e-8)


CORNER = """
SetFactory("OpenCASCADE"); DefineConstant[ seat = 0 ];
Rectangle(1) = {0, 0, 0, 2, 1}; Physical Surface("b") = {1}; Physical Curve("b.bottom") = {1};
Physical Curve("b.left") = {4}; Physical Curve("b.ends") = {2, 3};
If (seat)
  Rectangle(2) = {-1, -1, 0, 3, 2}; Rectangle(3) = {0, 0, 0, 2, 1};
  s() = BooleanDifference{ Surface{2}; Delete; }{ Surface{3}; Delete; }; Physical Surface("s") = {s()};
  f() = Curve In BoundingBox {-0.01, -0.01, -1, 2.01, 0.01, 1}; f() -= {1}; Physical Curve("s.floor") = {f()};
  w() = Curve In BoundingBox {-0.01, -0.01, -1, 0.01, 1.01, 1}; w() -= {4}; Physical Curve("s.wall") = {w()};
  u() = Curve In BoundingBox {-1.01, -1.01, -1, 2.01, -0.99, 1}; Physical Curve("s.under") = {u()};
EndIf
MeshSize{:} = 0.5;
"""


@pytest.mark.parametrize("seat", [False, True])
def test_each_face_at_a_corner_has_its_own_compliance_and_friction(seat: bool, tmp_path: Path) -> None:
    """A stiff block sinks in along a floor and a wall: one slips as far as friction bounds it, the other by k_T."""
    (tmp_path / "corner.geo").write_text(CORNER)
    bodies = ("b", "s") if seat else ("b",)
    planes = {"floor": [0.0, 1.0], "wall": [1.0, 0.0]}
    moved = {"boundary": "b.ends", "displacement": {"x": -0.01, "y": -0.02}}
    scene: dict[str, Any] = {
        "model": "plane strain",
        "geometry": {"file": "corner.geo", "seat": int(seat)},
        "bodies": {name: {"E": 1e7, "nu": 0.0} for name in bodies},
        "obstacles": {}
        if seat
        else {n: {"shape": "plane", "point": [0.0, 0.0], "normal": x} for n, x in planes.items()},
        "contacts": {
            side: {
                "surface": f"b.{side}",
                "against": f"s.{face}" if seat else face,
                "normal": {"law": "compliance", "c_n": c_n},
                "friction": {"law": "coulomb", **friction},
            }
            for side, face, c_n, friction in (
                ("bottom", "floor", 10.0, {"mu": 0.2}),
                ("left", "wall", 30.0, {"mu": 4.0, "k_T": 5.0}),
            )
        },
        "supports": {"ends": moved, **({"under": {"boundary": "s.under", "displacement": [0.0, 0.0]}} if seat else {})},
    }
    found = run(tmp_path, scene).contacts
    floor, wall = 10.0 * 0.02 * 2, 30.0 * 0.01 * 1
    assert_allclose(found["bottom"].force, [0.2 * floor, floor], rtol=3e-5)  # c_n / E is 3e-6
    assert_allclose(found["left"].force, [wall, 5.0 * 0.02 * 1], rtol=3e-5)
