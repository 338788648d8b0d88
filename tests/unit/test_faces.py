"""Sides round corners and edges: their faces, and what touches there."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.audited import audit, solved
from stickslip.geometry.arrays import Array
from stickslip.geometry.curved_facets import find_edges
from stickslip.geometry.mesh.gmsh_session import gmsh_session
from stickslip.geometry.surfaces.faces import edges_of, split_at_edges
from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.results.step_result import StepResult
from stickslip.workflows.run.mesh_report import look
from stickslip.workflows.run.warnings import doubts, reasons_to_doubt
from stickslip.workflows.scene_file.read import from_dict

STEEL = {"E": 200_000.0, "nu": 0.3}


def chain(points: Array, degree: int = 1, closed: bool = False) -> Surface:
    """Nodes on a line that runs clockwise round its body."""
    n, k = len(points), np.arange(len(points) - 1 + closed)
    facets = np.stack([k, (k + 1) % n], axis=1)
    if degree == 2:
        points = np.concatenate([points, points[facets].mean(axis=1)])
        facets = np.column_stack([facets, n + np.arange(len(facets))])
    numbers = np.arange(len(points))
    return Surface("interval", degree, numbers, numbers, points, facets, -np.ones(len(facets)), False)


def turned(angles: Array, lengths: Array | float = 1.0) -> Array:
    """Points of a line whose facets turn by angles [degrees] one after the other."""
    along = np.radians(np.cumsum(np.concatenate([[0.0], angles])))
    steps = np.stack([np.cos(along), np.sin(along)], axis=1) * np.broadcast_to(lengths, len(along))[:, None]
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def edges(surface: Surface) -> int:
    return len(split_at_edges(surface).nodes) - len(surface.nodes)


FLAT = np.zeros(3)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(
    ("angles", "count"),
    [
        ([*FLAT, 90, *FLAT], 1),
        ([*FLAT, -90, *FLAT], 1),
        ([*FLAT, 20, *FLAT], 1),
        ([*FLAT, 90, 90, *FLAT], 2),  # a foot of one facet
        ([*FLAT, 4, *FLAT], 0),
        ([*FLAT, 15, 30, 30, 15, *FLAT], 0),  # a fillet of three facets
        ([*FLAT, 22.5, 45, 22.5, *FLAT], 0),
        ([*FLAT, 11.25, *[22.5] * 7, 11.25, *FLAT], 0),  # an arc of four facets a quarter
        ([*FLAT, 45, *FLAT, 45, *FLAT], 2),  # a chamfer
        ([20, 20], 0),
        ([45], 0),  # the end of a side may be of a curve
    ],
)
def test_an_angle_large_against_the_bends_beside_it_is_an_edge(angles: list[float], count: int, degree: int) -> None:
    assert edges(chain(turned(np.array(angles)), degree)) == count


def test_facets_that_grow_along_an_arc_stay_curved() -> None:
    lengths = 1.6 ** np.arange(9)
    assert edges(chain(turned((lengths[1:] + lengths[:-1]) / 4, lengths))) == 0


def test_a_face_that_meets_itself_has_two_nodes_at_its_edge() -> None:
    angles = np.radians(np.linspace(0, -270, 13))
    drop = np.concatenate([np.stack([np.cos(angles), np.sin(angles)], axis=1), [[1.0, 1.0]]])
    split = split_at_edges(chain(drop, closed=True))
    twice = split.at_edge > 0
    assert twice.sum() == 2
    assert split.faces is not None
    assert len(set(split.faces[twice])) == 2
    assert_allclose(split.points[twice], 1.0)
    assert_allclose(np.sort(split.node_normals()[twice], axis=0), [[0, 0], [1, 1]], atol=1e-12)
    assert_allclose(split.node_weights().sum(), chain(drop, closed=True).node_weights().sum())


def test_a_smooth_side_is_left_as_it_is() -> None:
    smooth = chain(turned(np.full(8, 22.5)))
    assert split_at_edges(smooth) is smooth


TRIANGLE = [(0, 0), (1, 0), (0, 1), (0.5, 0.5), (0, 0.5), (0.5, 0)]  # corners and middles of edges, as dolfinx has them
SQUARE = [(0, 0), (1, 0), (0, 1), (1, 1), (0.5, 0), (0, 0.5), (1, 0.5), (0.5, 1), (0.5, 0.5)]


def cube(n: int, shape: str, degree: int = 1) -> Surface:
    """Three faces of a cube of n x n squares or pairs of triangles each, which meet at a corner."""
    low = np.stack(np.meshgrid(np.arange(n), np.arange(n)), axis=-1).reshape(-1, 1, 2)
    if shape == "quadrilateral":
        flat = low + np.array(SQUARE if degree == 2 else SQUARE[:4])
    else:
        half = np.array(TRIANGLE if degree == 2 else TRIANGLE[:3])
        flat = np.concatenate([low + half, low + 1 - half])
    x = np.concatenate([np.insert(flat / n, axis, 0.0, axis=2) for axis in range(3)])
    points, facets = np.unique(x.reshape(-1, 3).round(9), axis=0, return_inverse=True)
    numbers, facets = np.arange(len(points)), facets.reshape(x.shape[:2])
    found = Surface(shape, degree, numbers, numbers, points, facets, np.ones(len(facets)), False)
    return replace(found, outward=-np.sign(found.facet_normals().sum(axis=(1, 2))))


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("shape", ["triangle", "quadrilateral"])
def test_three_faces_of_a_cube_have_their_own_nodes(shape: str, degree: int) -> None:
    whole = cube(3, shape, degree)
    split = split_at_edges(whole)
    m = 3 * degree + 1
    assert len(split.nodes) == 3 * m * m
    assert (split.at_edge > 0).sum() == 3 * (2 * m - 1)
    normals = split.node_normals()
    assert_allclose(np.abs(normals).max(axis=1), 1.0)
    assert_allclose(split.node_weights().sum(), 3.0)
    assert_allclose(split.points[split.facets], whole.points[whole.facets])
    assert len(edges_of(split)[0]) == 3 * 3
    assert np.all(np.diff(split.input) >= 0)


def tent(angle: float, depth: float) -> Surface:
    """Strips, 1 and 5 long,  that meet at the ridge x = 0 with `angle` [degrees] between their normals."""
    a = np.radians(angle)
    x = [(-1.0, 0.0), (0.0, 0.0), (5 * np.cos(a), -5 * np.sin(a))]
    points = np.array([(u, y, z) for u, z in x for y in (0.0, depth)])
    facets = np.array([[0, 2, 1], [3, 1, 2], [2, 4, 3], [5, 3, 4]])
    number = np.arange(6)
    return Surface("triangle", 1, number, number, points, facets, np.ones(4), axisymmetric=False)


def test_two_strips_in_space_meet_at_an_edge_if_steeply() -> None:
    split = split_at_edges(tent(90.0, 1.0))
    assert_allclose(np.abs(split.node_normals()).max(axis=1), 1.0)
    assert edges(tent(90.0, 1.0)) == 2
    assert edges(tent(4.0, 1.0)) == 0


def test_fine_fan_is_smooth_though_its_ends_are_not() -> None:
    # a cone's apex with 12 facets: neighbours differ by 29 degrees, opposite ones by 120
    turn = 2 * np.pi * np.arange(12) / 12
    height = 1 / np.tan(np.radians(30.0))
    rim = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(12)])
    points = np.concatenate([rim / height, [[0.0, 0.0, 1.0]]])
    facets = np.array([[12, i, (i + 1) % 12] for i in range(12)])
    cone = Surface("triangle", 1, np.arange(13), np.arange(13), points, facets, np.ones(12), axisymmetric=False)
    assert split_at_edges(cone) is cone
    assert_allclose(split_at_edges(cone).node_normals()[12], [0, 0, 1], atol=1e-12)


PUNCH = """
SetFactory("OpenCASCADE");
DefineConstant[h=0.5]; DefineConstant[lean=0]; DefineConstant[left=1];
Rectangle(1)={-6*left,0,0,6+6*left,2};
Point(11)={-2*left,2,0}; Point(12)={2,2,0}; Point(13)={2+lean,5,0}; Point(14)={-2*left-lean*left,5,0};
Line(11)={11,12}; Line(12)={12,13}; Line(13)={13,14}; Line(14)={14,11};
Curve Loop(9)={11,12,13,14}; Plane Surface(2)={9};
Mesh.MeshSizeMin=h; Mesh.MeshSizeMax=h; Mesh.MeshSizeFromPoints=0;
MeshSize{:}=h;
Physical Surface("slab")={1}; Physical Surface("block")={2};
Physical Curve("slab.bottom")={1}; Physical Curve("block.top")={13};
If (left)
  Physical Curve("slab.skin")={2,3,4}; Physical Curve("block.skin")={11,12,14};
Else
  Physical Curve("slab.skin")={2,3}; Physical Curve("block.skin")={11,12};
EndIf
"""


def punched(
    folder: Path, h: float, contact: dict[str, Any], model: str = "plane strain", method: str = "auto", **geometry: Any
) -> tuple[StepResult, dict[str, float]]:
    """A block 4 mm wide, or half of it round an axis, pressed on a slab or a floor by 100 MPa; its sides count."""
    (folder / "punch.geo").write_text(PUNCH)
    scene = {
        "model": model,
        "units": "mm-N-MPa",
        "geometry": {"file": "punch.geo", "h": h} | geometry,
        "obstacles": {"floor": {"shape": "plane", "point": [0.0, 2.0], "normal": [0.0, 1.0]}},
        "solver": {"method": method},
        "bodies": {"slab": STEEL, "block": STEEL},
        "contacts": {"c": contact},
        "supports": {
            "slab": {"boundary": "slab.bottom", "displacement": [0.0, 0.0]},
            "block": {"boundary": "block.top", "displacement": {"x": 0.0}},
        },
        "loads": {"press": {"boundary": "block.top", "pressure": 100.0}},
    }
    if contact["against"] != "floor":
        del scene["obstacles"]
    simulation, steps = solved(from_dict(scene, folder))
    return steps[-1], audit(simulation, steps[-1])


SKINS = {"surface": "block.skin", "against": "slab.skin", "search_distance": 1.0}


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("lean", [0.0, 0.5, -0.5])
@pytest.mark.parametrize(
    "others", [{}, {"operator": "node-to-segment"}, {"surface": "slab.skin", "against": "block.skin"}]
)
def test_a_side_round_two_corners_presses_on_its_bottom_alone(
    tmp_path: Path, others: dict[str, Any], lean: float, order: int
) -> None:
    step, defects = punched(tmp_path, 0.5, SKINS | others, order=order, lean=lean)
    force = 100.0 * (4 + 2 * lean)
    assert_allclose(np.abs(step.contacts["c"].force), [0.0, force], atol=1e-8 * force)
    assert_allclose(step.contacts["c"].contact_area, 4.0, rtol=0.15 if "surface" in others else 1e-9)
    assert step.contacts["c"].gap[step.contacts["c"].weight > 0].min() > -1e-9
    assert max(defects.values()) < 1e-8
    if not lean:
        assert_allclose(np.abs(step.displacement).max(), 0.00207, rtol=0.03)


def test_gaps_of_skins_are_those_of_points_that_face_the_other_side(tmp_path: Path) -> None:
    """A block .5 mm above a slab: its flanks face nothing."""
    (tmp_path / "punch.geo").write_text(PUNCH.replace("6+6*left,2}", "6+6*left,1.5}"))
    report, *_ = look(from_dict({
        "model": "plane strain", "geometry": {"file": "punch.geo"},
        "bodies": {"slab": STEEL, "block": STEEL}, "contacts": {"c": SKINS},
        "supports": {
            "slab": {"boundary": "slab.bottom", "displacement": [0.0, 0.0]},
            "block": {"boundary": "block.top", "displacement": {"x": 0.0, "y": -1.0}},
        },
    }, tmp_path))  # fmt: skip
    found = report.contacts["c"]
    assert_allclose([found.smallest_gap, found.largest_gap], 0.5, rtol=1e-9)
    assert found.points_that_can_touch == found.normal_points == 9


def test_what_faces_away_from_an_obstacle_costs_nothing(tmp_path: Path) -> None:
    contact = punched(tmp_path, 0.5, {"surface": "block.skin", "against": "floor"})[0].contacts["c"]
    assert_allclose(contact.points[:, 1], 2.0)
    assert_allclose(contact.force, [0.0, 400.0], atol=1e-6)


@pytest.mark.parametrize(("h", "order"), [(1.0, 1), (0.5, 2), pytest.param(0.25, 2, marks=pytest.mark.slow)])
@pytest.mark.parametrize("method", ["tangent-cg", "condensed-newton"])
def test_a_pin_presses_on_its_end_alone(tmp_path: Path, method: str, h: float, order: int) -> None:
    """The same round an axis: the skin of a pin is its end and its flank."""
    step, defects = punched(tmp_path, h, SKINS, model="axisymmetric", method=method, order=order, left=0)
    assert_allclose(np.abs(step.contacts["c"].force[-1]), 400 * np.pi, rtol=1e-7)
    assert_allclose(step.contacts["c"].contact_area, 4 * np.pi, rtol=1e-9)
    assert max(defects.values()) < 1e-7


POINTED = """
SetFactory("OpenCASCADE");
DefineConstant[h=0.5]; DefineConstant[tip=0];
Rectangle(1)={-6,0,0,12,2};
Point(11)={tip,2,0}; Point(12)={2+tip,4,0}; Point(13)={1+tip,5,0}; Point(15)={-1+tip,5,0}; Point(14)={-2+tip,4,0};
Line(11)={11,12}; Line(12)={12,13}; Line(15)={13,15}; Line(13)={15,14}; Line(14)={14,11};
Curve Loop(9)={11,12,15,13,14}; Plane Surface(2)={9};
Mesh.MeshSizeMin=h; Mesh.MeshSizeMax=h;
Physical Surface("slab")={1}; Physical Surface("block")={2};
Physical Curve("slab.skin")={2,3,4}; Physical Curve("slab.bottom")={1};
Physical Curve("block.skin")={11,13,14,12}; Physical Curve("block.top")={15};
"""


def pointed(folder: Path, geometry: dict[str, Any], contact: dict[str, Any], down: float = 0.001) -> Any:
    """A square that stands on its corner, on a slab or a plane, pressed down."""
    (folder / "pointed.geo").write_text(POINTED)
    scene: dict[str, Any] = {
        "model": "plane strain",
        "units": "mm-N-MPa",
        "geometry": {"file": "pointed.geo"} | geometry,
        "bodies": {"slab": STEEL, "block": STEEL},
        "contacts": {"c": contact},
        "supports": {
            "slab": {"boundary": "slab.bottom", "displacement": [0.0, 0.0]},
            "block": {"boundary": "block.top", "displacement": {"x": 0.0, "y": -down}},
        },
    }
    if contact["against"] == "floor":
        scene["obstacles"] = {"floor": {"shape": "plane", "point": [0.0, 2.0], "normal": [0.0, 1.0]}}
    simulation, steps = solved(from_dict(scene, folder))
    defects = audit(simulation, steps[-1])
    assert max(defects.values()) < 1e-8 + defects["rounding"]
    return steps[-1].contacts["c"]


WAYS = [
    {"surface": "block.skin", "against": "slab.skin"},
    {"surface": "slab.skin", "against": "block.skin"},
    {"surface": "block.skin", "against": "slab.skin", "operator": "node-to-segment"},
    {"surface": "slab.skin", "against": "block.skin", "operator": "node-to-segment"},
    {"surface": "block.skin", "against": "floor"},
]


@pytest.mark.parametrize("mu", [0.0, 0.3])
@pytest.mark.parametrize("tip", [0.0, 0.1])
@pytest.mark.parametrize("order", [1, 2])
def test_a_corner_on_a_face_takes_the_normal_of_the_face(tmp_path: Path, order: int, tip: float, mu: float) -> None:
    friction = {"friction": {"law": "coulomb", "mu": mu}} if mu else {}
    found = [pointed(tmp_path, {"order": order, "tip": tip}, way | friction) for way in WAYS]
    for contact, way in zip(found, WAYS, strict=True):
        across, up = contact.force
        assert abs(across) <= (mu / 10 + 1e-9) * abs(up)  # the meshes are not symmetric
        assert_allclose(contact.moment, tip * up - 2 * across, atol=2e-3 * abs(up))  # where the point is now
        assert (contact.status > 0).sum() == 1
        if way["against"] != "floor":
            assert_allclose(contact.normal_force, found[0].normal_force, rtol=1e-9)


ROOFS = """
SetFactory("OpenCASCADE");
DefineConstant[tip=0];
Point(1)={-3,-2,0}; Point(2)={3,-2,0}; Point(3)={2,-1,0}; Point(4)={0,0,0}; Point(5)={-2,-1,0};
Line(1)={1,2}; Line(2)={2,3}; Line(3)={3,4}; Line(4)={4,5}; Line(5)={5,1}; Curve Loop(1)={1,2,3,4,5};
Point(11)={tip,0,0}; Point(12)={2+tip,2,0}; Point(13)={1+tip,3,0}; Point(15)={-1+tip,3,0}; Point(14)={-2+tip,2,0};
Line(11)={11,12}; Line(12)={12,13}; Line(15)={13,15}; Line(13)={15,14}; Line(14)={14,11};
Curve Loop(9)={11,12,15,13,14}; Plane Surface(1)={1}; Plane Surface(2)={9};
Mesh.MeshSizeMin=.7; Mesh.MeshSizeMax=.7;
Physical Surface("low")={1}; Physical Surface("up")={2};
Physical Curve("low.skin")={2,3,4,5}; Physical Curve("low.bottom")={1};
Physical Curve("up.skin")={11,13,14,12}; Physical Curve("up.top")={15};
"""


SOFT = {"law": "compliance", "c_n": 1e4}


def roofs(
    folder: Path, tip: float, down: float, contact: dict[str, Any], order: int = 1, text: str = ROOFS
) -> tuple[Any, list[str]]:
    """A corner pressed down on the ridge of a roof, or beside it at x = tip; and what is said of it."""
    (folder / "roofs.geo").write_text(text)
    scene: dict[str, Any] = {
        "model": "plane strain",
        "units": "mm-N-MPa",
        "geometry": {"file": "roofs.geo", "tip": tip, "order": order},
        "bodies": {"low": STEEL, "up": STEEL},
        "contacts": {"c": contact},
        "supports": {
            "low": {"boundary": "low.bottom", "displacement": [0.0, 0.0]},
            "up": {"boundary": "up.top", "displacement": {"x": 0.0, "y": -down}},
        },
    }
    if contact["against"] == "floor":
        scene["obstacles"] = {"floor": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}}
    simulation, steps = solved(from_dict(scene, folder))
    assert max(audit(simulation, steps[-1]).values()) < 1e-8
    return steps[-1].contacts["c"], [*doubts(simulation, steps), *reasons_to_doubt(simulation, steps)]


ROLES = [("up", "low", "mortar"), ("low", "up", "mortar"), ("up", "low", "node-to-segment")]


@pytest.mark.parametrize(("tip", "down", "slope"), [(0.0, 0.001, 0.0), (0.02, 0.04, 0.5)])
@pytest.mark.parametrize("order", [1, 2])
def test_a_corner_on_a_corner_presses_half_way_between_both(
    tmp_path: Path, order: int, tip: float, down: float, slope: float
) -> None:
    forces = []
    for one, other, operator in ROLES:
        contact = {"surface": f"{one}.skin", "against": f"{other}.skin", "operator": operator}
        found, said = roofs(tmp_path, tip, down, contact, order)
        across, along = np.abs(found.force)
        assert_allclose(across, slope * along, atol=1e-9 * along)
        assert any("presses on one along it" in line for line in said) == (tip == 0.0)
        forces.append(along)
    assert_allclose(forces, forces[0], rtol=1e-9)


@pytest.mark.parametrize(("order", "m_n", "down"), [(1, 1.0, 0.01), (1, 2.0, 0.3), (2, 1.0, 0.01), (2, 1.5, 0.1)])
def test_a_law_of_compliance_is_felt_however_little_a_corner_presses_in(
    tmp_path: Path, order: int, m_n: float, down: float
) -> None:
    """On both flanks of a corner of 90 degrees p = c_n (d - s / sqrt 2)^m_n at the length s from it."""
    soft = {"normal": {"law": "compliance", "c_n": 100.0, "m_n": m_n}, "friction": {"law": "coulomb", "mu": 0.3}}
    for tip in (0.0, 0.1):
        for way in WAYS:
            contact = pointed(tmp_path, {"order": order, "tip": tip}, way | soft, down)
            force = 100.0 * 2 * np.sqrt(2) * down ** (m_n + 1) / (m_n + 1)
            assert_allclose(contact.normal_force, force, rtol=0.02)
            assert_allclose(contact.weight @ contact.pressure, contact.normal_force, rtol=1e-9)
            assert_allclose(contact.weight @ contact.bound, 0.3 * contact.normal_force, rtol=1e-9)


CONE = """
SetFactory("OpenCASCADE");
Point(1) = {0, 0, 0}; Point(2) = {2, 1, 0}; Point(3) = {2, 3, 0}; Point(4) = {0, 3, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1}; Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1}; MeshSize{:} = 0.3;
Physical Surface("pin") = {1}; Physical Curve("pin.flank") = {1}; Physical Curve("pin.top") = {3};
"""


@pytest.mark.parametrize("model", ["axisymmetric", "plane strain"])
def test_a_law_of_compliance_is_felt_at_the_end_of_a_side(tmp_path: Path, model: str) -> None:
    """A flank that rises by 1 in 2 from its end, on the axis of a cone: p = c_n (d - x / 2) at x from the end."""
    (tmp_path / "cone.geo").write_text(CONE)
    depth = 0.01
    scene = {
        "model": model,
        "units": "mm-N-MPa",
        "geometry": {"file": "cone.geo"},
        "bodies": {"pin": STEEL},
        "obstacles": {"floor": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
        "contacts": {"c": {"surface": "pin.flank", "against": "floor", "normal": {"law": "compliance", "c_n": 100.0}}},
        "supports": {"top": {"boundary": "pin.top", "displacement": {"x": 0.0, "y": -depth}}},
    }
    _, steps = solved(from_dict(scene, tmp_path))
    slanted = 100.0 * np.sqrt(1.25) * depth * (2 * depth) / 2  # over the length of the flank that is pressed in
    force = slanted * (2 * np.pi * 2 * depth / 3 if model == "axisymmetric" else 1.0)
    assert_allclose(steps[-1].contacts["c"].normal_force, force, rtol=0.02)


@pytest.mark.parametrize(
    ("against", "down", "laws", "counted"),
    [
        ("low.skin", 0.04, {"friction": {"law": "coulomb", "mu": 0.3, "k_T": 1e6}}, "friction.k_T"),
        ("low.skin", 0.04, {"friction": {"law": "tresca", "bound": 10.0}}, "friction"),
        ("floor", 0.04, {"friction": {"law": "cohesion", "a": 10.0, "mu": 0.3}}, "friction"),
        ("floor", 0.04, {"friction": {"law": "capped_coulomb", "s_max": 10.0, "mu": 0.3}}, "friction"),
        ("floor", 0.04, {"friction": {"law": "coulomb", "mu": 0.3}, "wear": {"k": 1e-12}}, "wear"),
        ("floor", 0.04, {"friction": {"law": "coulomb", "mu": 0.3}}, ""),
        ("floor", 0.04, {"normal": SOFT, "friction": {"law": "tresca", "bound": 10.0}}, ""),
        ("floor", 0.04, {"normal": SOFT, "friction": {"law": "coulomb", "mu": 0.3, "k_T": 1e6}}, ""),
    ],
)
def test_a_corner_that_bears_alone_has_no_area_for_laws_that_need_one(
    tmp_path: Path, against: str, down: float, laws: dict[str, Any], counted: str
) -> None:
    """Pressure and friction in proportion to it are forces; areas that compliance presses in are those of flanks."""
    both = {"surface": "up.skin", "against": against} | laws
    _, said = roofs(tmp_path, 0.02, down, both)
    told = [line for line in said if "at (0.02, 0) bears alone and has no area" in line]
    assert len(told) == bool(counted)
    assert all(f"by which {counted} counts" in line for line in told)
    if against == "floor" and counted == "friction":  # so it is where one flank alone is a side of the contact
        _, said = roofs(tmp_path, 0.02, down, both, text=ROOFS.replace("11,13,14,12", "11"))
        assert [line for line in said if "at (0.02, 0) bears alone and has no area" in line]


@pytest.mark.parametrize("one", ["up", "low"])
def test_a_corner_of_which_no_side_knows_the_other_flank_is_told(tmp_path: Path, one: str) -> None:
    flat = ROOFS.replace("{2,-1,0}", "{2,0,0}").replace("{-2,-1,0}", "{-2,0,0}")
    (other,) = {"up", "low"} - {one}
    contact = {"surface": f"{one}.skin", "against": f"{other}.skin"}
    for text, told in ((flat.replace("11,13,14,12", "11"), True), (flat, False)):
        found, said = roofs(tmp_path, 0.02, 0.04, contact, text=text)
        assert (abs(found.force[0]) > 0.1 * abs(found.force[1])) == told
        assert any("bears alone and presses half way" in line for line in said) == told


BEAMS = """
import math

def build(model, parameters):
    turn = parameters["turn"]
    for name, sign in (("upper", 1), ("lower", -1)):
        box = model.occ.addBox(0, -2, 0, 2, 4, sign * 2)
        model.occ.rotate([(3, box)], 0, 0, 0, 0, 1, 0, -sign * math.pi / 4)
        if name == "lower":
            model.occ.rotate([(3, box)], 0, 0, 0, 0, 0, 1, turn)
            model.occ.translate([(3, box)], parameters["aside"], 0.07, 0)
        model.occ.synchronize()
        faces = [tag for _, tag in model.getBoundary([(3, box)], oriented=False)]
        high = {tag: sign * model.occ.getCenterOfMass(2, tag)[2] for tag in faces}
        far = [tag for tag in faces if high[tag] > 1.5]
        skin = [tag for tag in faces if tag not in far]
        for dim, tags, group in ((3, [box], name), (2, far, f"{name}.far"), (2, skin, f"{name}.skin")):
            model.setPhysicalName(dim, model.addPhysicalGroup(dim, tags), group)
"""


@pytest.mark.parametrize(("turn", "aside", "order"), [(1.57, 0.21, 1), (1.2, 0.21, 2), (0.05, 0.0, 1), (0.0, 0.0, 1)])
def test_edges_press_along_both_their_normals(tmp_path: Path, turn: float, aside: float, order: int) -> None:
    (tmp_path / "beams.py").write_text(BEAMS)
    forces = []
    for operator, *sides in (
        ("mortar", "upper", "lower"),
        ("mortar", "lower", "upper"),
        ("node-to-face", "upper", "lower"),
    ):
        scene = {
            "model": "3d",
            "units": "mm-N-MPa",
            "geometry": {
                "file": "beams.py",
                "mesh_size": 1.0,
                "order": order,
                "parameters": {"turn": turn, "aside": aside},
            },
            "bodies": {"upper": STEEL, "lower": STEEL},
            "contacts": {"c": {"surface": f"{sides[0]}.skin", "against": f"{sides[1]}.skin", "operator": operator}},
            "supports": {
                "lower": {"boundary": "lower.far", "displacement": [0.0, 0.0, 0.0]},
                "upper": {"boundary": "upper.far", "displacement": [0.0, 0.0, -0.001]},
            },
        }
        simulation, steps = solved(from_dict(scene, tmp_path))
        assert max(audit(simulation, steps[-1]).values()) < 1e-7
        contact = steps[-1].contacts["c"]
        size = contact.normal_force
        assert_allclose(np.abs(contact.force), [0.0, 0.0, size], atol=1e-9 * size)
        arm = 0.07 + aside / np.tan(turn) if turn else 0.035  # y where the edges cross at x = 0, or of their middle
        assert_allclose(np.abs(contact.moment), [abs(arm) * size, 0.0, 0.0], atol=(2e-3 if turn else 5e-3) * size)
        forces.append(size)
    assert_allclose(forces, forces[0], rtol=1e-9 if turn else 1e-3)


def built_in(geo: Any) -> list[int]:
    """A roof, 8 degrees steep on its right, then a quarter of a circle; then down."""
    x = [(0, 0), (1, 0), (2, 1 * np.tan(np.radians(8))), (3, np.tan(np.radians(8)))]
    points = [geo.addPoint(*at, 0) for at in (*x, (3, 1 + x[2][1]), (4, 1 + x[2][1]))]
    return [
        geo.addLine(*points[:2]),
        geo.addLine(*points[1:3]),
        geo.addLine(*points[2:4]),
        geo.addCircleArc(points[3], points[4], points[5]),
    ]


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("kernel", ["geo", "occ"])
def test_a_model_tells_where_its_curves_bend(kernel: str, order: int) -> None:
    with gmsh_session() as gmsh:
        kind = getattr(gmsh.model, kernel)
        tags = built_in(kind)
        kind.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", 1.0)
        gmsh.model.mesh.generate(1)
        gmsh.model.mesh.setOrder(order)
        found = find_edges(gmsh, 2, {"a": tags, "smooth": tags[2:], "one": tags[:1]})
    assert found["a"].ravel().tolist() == [1, 2]  # the two bends by 8 degrees; the arc goes on smoothly
    assert not len(found["smooth"])
    assert not len(found["one"])


@pytest.mark.parametrize("order", [1, 2])
def test_a_rounded_edge_of_a_solid_is_none(order: int) -> None:
    with gmsh_session() as gmsh:
        occ = gmsh.model.occ
        box = occ.addBox(0, 0, 0, 1, 1, 1)
        occ.synchronize()
        upright = [t for _, t in gmsh.model.getEntitiesInBoundingBox(-0.1, -0.1, -0.1, 0.1, 0.1, 1.1, 1)]
        occ.fillet([box], upright, [0.3])
        occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(order)
        faces = {tuple(np.round(occ.getCenterOfMass(2, t), 2)): t for _, t in gmsh.model.getEntities(2)}
        flanks = [t for x, t in faces.items() if x[2] == 0.5]
        low = [t for x, t in faces.items() if x[2] == 0.0]
        found = find_edges(
            gmsh,
            3,
            {
                "flanks": flanks,
                "rounded": [t for t in flanks if gmsh.model.getType(2, t) != "Plane"]
                + [t for x, t in faces.items() if x in ((0.0, 0.65, 0.5), (0.65, 0.0, 0.5))],
                "low": flanks + low,
            },
        )
        x = np.reshape(gmsh.model.mesh.getNodes()[1], (-1, 3))[np.argsort(gmsh.model.mesh.getNodes()[0])]
    assert len(flanks) == 5
    assert not len(found["rounded"])
    uprights = x[found["flanks"]].mean(axis=1)[:, :2]
    assert {tuple(at) for at in uprights.round(6)} == {(0.0, 1.0), (1.0, 0.0), (1.0, 1.0)}
    around = found["low"][np.abs(x[found["low"]][:, :, 2]).max(axis=1) < 1e-9]
    assert_allclose(np.linalg.norm(x[around[:, 1]] - x[around[:, 0]], axis=1).sum(), 3.4 + 0.15 * np.pi, rtol=0.02)


def test_named_points_are_the_edges_of_a_mesh_without_a_model() -> None:
    with gmsh_session() as gmsh:
        for tag in (1, 2):
            gmsh.model.addDiscreteEntity(2 - tag, tag)
        x = np.array([[0, 0, 0], [1, 0, 0], [2, 1, 0], [3, 2, 0]], float)
        gmsh.model.mesh.addNodes(1, 1, [1, 2, 3, 4], x.ravel())
        gmsh.model.mesh.addElementsByType(1, 1, [], [1, 2, 2, 3, 3, 4])
        assert find_edges(gmsh, 2, {"a": [1]}) == {}
        gmsh.model.mesh.addElementsByType(2, 15, [], [3])
        gmsh.model.setPhysicalName(0, gmsh.model.addPhysicalGroup(0, [2]), "tip")
        assert find_edges(gmsh, 2, {"a": [1]})["a"].tolist() == [[2]]


def test_known_edges_are_all_there_are() -> None:
    square = chain(turned(np.array([90.0, 90.0])))
    assert edges(square) == 2
    assert len(split_at_edges(square, np.array([[2]])).nodes) == 5
    assert split_at_edges(square, np.zeros((0, 1), np.int64)) is square


POCKET = """
SetFactory("OpenCASCADE");
DefineConstant[slant=0];
Point(1)={0,0,0}; Point(2)={6,0,0}; Point(3)={6,4,0}; Point(4)={4.5-slant,4,0};
Point(5)={4.5+slant,2,0}; Point(6)={1.5-slant,2,0}; Point(7)={1.5+slant,4,0}; Point(8)={0,4,0};
Line(1)={1,2}; Line(2)={2,3}; Line(3)={3,4}; Line(4)={4,5}; Line(5)={5,6}; Line(6)={6,7}; Line(7)={7,8}; Line(8)={8,1};
Curve Loop(1)={1,2,3,4,5,6,7,8}; Plane Surface(1)={1};
Point(14)={4.5-slant,4,0}; Point(15)={4.5+slant,2,0}; Point(16)={1.5-slant,2,0}; Point(17)={1.5+slant,4,0};
Line(14)={14,15}; Line(15)={15,16}; Line(16)={16,17}; Line(17)={17,14};
Curve Loop(2)={14,15,16,17}; Plane Surface(2)={2};
MeshSize{1:8}=.5; MeshSize{14:17}=.31;
Physical Surface("pan")={1}; Physical Surface("plug")={2};
Physical Curve("pan.skin")={4,5,6}; Physical Curve("pan.bottom")={1}; Physical Curve("pan.left")={8};
Physical Curve("pan.right")={2}; Physical Curve("pan.rim")={3,7};
Physical Curve("plug.skin")={14,15,16}; Physical Curve("plug.top")={17};
"""

TRAY = """
def build(model, parameters):
    occ = model.occ
    (pan,), _ = occ.cut([(3, occ.addBox(0, 0, 0, 4, 4, 3))], [(3, occ.addBox(1, 1, 1, 2, 2, 2))])
    plug = 3, occ.addBox(1, 1, 1, 2, 2, 2)
    occ.synchronize()
    for name, body in (("pan", pan), ("plug", plug)):
        model.setPhysicalName(3, model.addPhysicalGroup(3, [body[1]]), name)
        sides = {}
        for _, tag in model.getBoundary([body], oriented=False):
            x, y, z = occ.getCenterOfMass(2, tag)
            outer = {"bottom": z < 0.1, "left": x < 0.1, "front": y < 0.1, "right": max(x, y) > 3.9, "rim": z > 2.9}
            sides.setdefault(next((side for side, on in outer.items() if on), "skin"), []).append(tag)
        for side, tags in sides.items():
            model.setPhysicalName(2, model.addPhysicalGroup(2, tags), f"{name}.{side}")
    model.mesh.setSize(model.getEntities(0), 1.0)
    model.mesh.setSize(model.getBoundary([plug], recursive=True), 0.7)
"""


@pytest.mark.parametrize("law", [{}, {"friction": {"law": "coulomb", "mu": 0.3}}, {"normal": {"law": "tied"}}])
@pytest.mark.parametrize("sides", [("plug", "pan"), ("pan", "plug")])
@pytest.mark.parametrize(("dim", "order", "slant"), [(2, 1, 0.0), (2, 1, -0.4), (2, 2, 0.6), (3, 1, 0.0)])
def test_a_uniform_stress_goes_over_the_corners_of_a_pocket(
    tmp_path: Path, dim: int, order: int, slant: float, sides: tuple[str, str], law: dict[str, Any]
) -> None:
    file = tmp_path / ("pocket.geo" if dim == 2 else "tray.py")
    file.write_text(POCKET if dim == 2 else TRAY)
    outer = ["left", *(["front"] if dim == 3 else []), "bottom"]
    parameters = {"slant": slant} if dim == 2 else {}
    scene = {
        "model": "plane strain" if dim == 2 else "3d",
        "units": "mm-N-MPa",
        "geometry": {"file": file.name, "order": order} | parameters,
        "bodies": {"pan": STEEL, "plug": STEEL},
        "contacts": {"c": {"surface": f"{sides[0]}.skin", "against": f"{sides[1]}.skin", "search_distance": 0.5} | law},
        "supports": {
            side: {"boundary": f"pan.{side}", "displacement": {axis: 0.0}}
            for side, axis in zip(outer, "xyz"[:dim], strict=True)
        },
        "loads": {
            side.replace(".", "_"): {"boundary": side, "pressure": 100.0}
            for side in ("pan.right", "pan.rim", "plug.top" if dim == 2 else "plug.rim")
        },
        "solver": {"tolerance": 1e-11},
    }
    simulation, (step,) = solved(from_dict(scene, tmp_path))
    assert_allclose(
        step.stress[:, :dim, :dim], np.broadcast_to(-100 * np.eye(dim), (len(step.stress), dim, dim)), atol=1e-6
    )
    contact = step.contacts["c"]
    assert_allclose(contact.pressure, 100.0, rtol=1e-8)
    assert_allclose(contact.traction, 0.0, atol=1e-6)
    # at a corner both faces press, and friction acts in what freedom that leaves
    dropped = simulation.system.contacts[0].dropped
    assert dropped > 0 if law else dropped == 0


@pytest.mark.parametrize("against", ["slab.skin", "floor"])
def test_a_named_point_of_a_smooth_side_changes_nothing(tmp_path: Path, against: str) -> None:
    found = []
    for named in (False, True):
        with gmsh_session() as gmsh:
            occ = gmsh.model.occ
            for y, height in ((0, 2), (2, 3)):
                occ.addRectangle(-4 if y == 0 else -2, y, 0, 8 if y == 0 else 4, height)
            occ.synchronize()
            groups = ((2, 1, "slab"), (2, 2, "block"), (1, 1, "slab.bottom"), (1, 3, "slab.skin"), (1, 5, "block.skin"))
            for dim, tag, name in (*groups, (1, 7, "block.top")):
                gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [tag]), name)
            gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
            gmsh.model.mesh.generate(2)
            if named:
                nodes, x, _ = gmsh.model.mesh.getNodes(1, 5)
                at = nodes[np.argmin(np.abs(np.reshape(x, (-1, 3))[:, 0] - 0.5))]
                gmsh.model.addDiscreteEntity(0, 99)
                gmsh.model.mesh.addElementsByType(99, 15, [], [at])
                gmsh.model.setPhysicalName(0, gmsh.model.addPhysicalGroup(0, [99]), "mark")
            gmsh.write(str(tmp_path / "marked.msh"))
        scene: dict[str, Any] = {
            "model": "plane strain",
            "geometry": {"file": "marked.msh"},
            "bodies": {"slab": STEEL, "block": STEEL},
            "contacts": {"c": {"surface": "block.skin", "against": against}},
            "supports": {
                "slab": {"boundary": "slab.bottom", "displacement": [0.0, 0.0]},
                "block": {"boundary": "block.top", "displacement": [0.0, -0.001]},
            },
        }
        if against == "floor":
            scene["obstacles"] = {"floor": {"shape": "plane", "point": [0.0, 2.0], "normal": [0.0, 1.0]}}
        simulation, (step,) = solved(from_dict(scene, tmp_path))
        assert max(audit(simulation, step).values()) < 1e-8
        found.append(step.contacts["c"])
        assert (simulation.system.contacts[0].surface.faces is not None) == named
    assert_allclose(found[1].normal_force, found[0].normal_force, rtol=1e-10)
    assert_allclose(found[1].max_pressure, found[0].max_pressure, rtol=1e-10)
    assert_allclose(found[1].contact_area, found[0].contact_area, rtol=1e-10)
