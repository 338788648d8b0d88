"""Geometry files of every kind give the bodies and sides they describe, or are refused in one line."""

import gzip
import hashlib
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_allclose

from shared.cases import every_nth, often, slow
from shared.drawn import FACES, GEO, PY, draw, scene_data
from stickslip import GeometryError, Scene, SceneError, Watch
from stickslip.geometry.mesh.cell_quality import worst_quality
from stickslip.geometry.mesh.gmsh_session import gmsh_session
from stickslip.geometry.mesh.mesh import Mesh, build_mesh, write_msh
from stickslip.geometry.protocols import Gmsh
from stickslip.geometry.user_files.meshing import MeshOptions
from stickslip.geometry.user_files.open_file import parameter_names
from stickslip.geometry.user_files.parts import find_parts
from stickslip.geometry.user_files.raw_mesh import RawMesh, check_neighbours
from stickslip.geometry.user_files.reader import Question, ask, place_of
from stickslip.geometry.user_files.user_file import installed
from stickslip.solvers.simulation.plan import make_plan
from stickslip.workflows.run.result import scene_hash
from stickslip.workflows.run.resume import BEGUN
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import from_dict, read, to_dict


def meshed(scene: Scene) -> Mesh:
    make_plan(scene)  # boxes and samples are asked for
    return build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF)


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


KINDS = ["msh", "msh3", "geo", "py", "step", "brep"]


def data_of(kind: str, folder: Path) -> dict[str, Any]:
    """A scene's data with a file of that kind; all of them are the same block."""
    match kind:
        case "geo":
            return scene_data(write(folder / "b.geo", GEO))
        case "py":
            return scene_data(write(folder / "b.py", PY), mesh_size=0.5, length=4.0)
        case "msh" | "msh3":
            dim = 3 if kind == "msh3" else 2
            return scene_data(draw(folder / "b.msh", dim), dim)
        case _:
            return scene_data(draw(folder / f"b.{kind}"), 3, "part", mesh_size=0.5, names=FACES)


RING = """
SetFactory("OpenCASCADE");
Disk(1) = {0, 0, 0, 2, 2};
Disk(2) = {0, 0, 0, 1, 1};
BooleanDifference(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };
Physical Surface("block") = {3};
Physical Curve("block.bottom") = {1};
Physical Curve("block.top") = {2};
"""
SHEET = """
Point(1) = {{0, 0, 0}};
Point(2) = {{1, 0, 0}};
Point(3) = {{1, {0}, 0}};
Point(4) = {{0, {0}, 0}};
Line(1) = {{2, 1}};
Line(2) = {{3, 2}};
Line(3) = {{4, 3}};
Line(4) = {{1, 4}};
Curve Loop(1) = {{-1, -2, -3, -4}};
Plane Surface(1) = {{1}};
Physical Surface("block") = {{1}};
Physical Curve("block.bottom") = {{1}};
Physical Curve("block.top") = {{3}};
"""
INSIDE = """
Point(11) = {0, 1, 0};
Point(12) = {4, 1, 0};
Line(10) = {11, 12};
BooleanFragments{ Surface{1}; Delete; }{ Curve{10}; Delete; }
Physical Surface("block") = Surface{:};
Physical Curve("block.bottom") = Curve In BoundingBox{-1, -0.1, -1, 5, 0.1, 1};
Physical Curve("block.top") = {10};
"""


FRAME = SHEET.format(2.0).replace("{1}", "{1, 2}", 1).replace("Plane", "CURVES\nPlane", 1)
ROUND = """
Point(10) = {0.5, 1, 0}; Point(11) = {0.7, 1, 0}; Point(12) = {0.5, 1.2, 0}; Point(13) = {0.3, 1, 0};
Point(14) = {0.5, 0.8, 0}; """
CLOSED = {
    "circles": "Circle(11) = {11, 10, 12}; Circle(12) = {12, 10, 13}; Circle(13) = {13, 10, 14}; "
    "Circle(14) = {14, 10, 11}; Curve Loop(2) = {11, 12, 13, 14};",
    "ellipse": "Point(15) = {0.5, 1.1, 0}; Point(16) = {0.5, 0.9, 0}; Ellipse(11) = {11, 10, 11, 15}; "
    "Ellipse(12) = {15, 10, 11, 13}; Ellipse(13) = {13, 10, 11, 16}; Ellipse(14) = {16, 10, 11, 11}; "
    "Curve Loop(2) = {11, 12, 13, 14};",
    "spline": "Spline(11) = {11, 12, 13, 14, 11}; Curve Loop(2) = {11};",
    "b-spline": "BSpline(11) = {11, 12, 13, 14, 11}; Curve Loop(2) = {11};",
    "bezier": "Bezier(11) = {11, 12, 13}; Bezier(12) = {13, 14, 11}; Curve Loop(2) = {11, 12};",
}
EXTRUDED = """
out[] = Extrude{0, 0, 1} {Surface{1};};
Physical Volume("block") = {out[1]};
Physical Surface("block.bottom") = {1};
Physical Surface("block.top") = {out[0]};
"""


@pytest.mark.parametrize(("curves", "dim"), [(name, 2) for name in CLOSED] + [("circles", 3), ("ellipse", 3)])
def test_small_curves_of_gmshs_own_kernel_are_read_as_fast_as_others(curves: str, dim: int, tmp_path: Path) -> None:
    """Their curvature is noisy; gmsh's mesher of curves never ended where sizes follow it."""
    text = FRAME.replace("CURVES", ROUND + CLOSED[curves])
    text = text if dim == 2 else text.split("Physical")[0] + EXTRUDED
    scene = from_dict(scene_data(write(tmp_path / "b.geo", text), dim, mesh_size=0.25, time_limit=20.0))
    mesh = meshed(scene)
    assert_allclose(mesh.box(), np.array([[0, 0, 0], [1, 2, 1]])[:, :dim], atol=1e-6)


def test_a_file_whose_own_sizes_follow_small_curves_is_meshed(tmp_path: Path) -> None:
    text = FRAME.replace("CURVES", ROUND + CLOSED["circles"]) + "Mesh.MeshSizeFromCurvature = 20;"
    meshed(from_dict(scene_data(write(tmp_path / "b.geo", text), time_limit=20.0)))


def test_what_gmsh_does_not_finish_is_named_by_its_curve(tmp_path: Path) -> None:
    path = write(tmp_path / "b.geo", FRAME.replace("CURVES", ROUND + CLOSED["spline"]))
    endless = MeshOptions(size=1e-9, fine_size=None, fine_sides=(), periodic=(), order=1)
    with pytest.raises(GeometryError, match=r"not finish meshing it within 3 s and is at curve 1 \(Line\); try a larg"):
        ask(Question(path=path, dim=2, unit=1.0, mesh=endless, time_limit=3.0))


@pytest.mark.parametrize(
    ("printed", "place"),
    [
        ("Info    : Meshing 1D...\nInfo    : [ 20%] Meshing curve 12 (Ellipse)\n", "curve 12 (Ellipse)"),
        ("Info    : Meshing curve 1 (Line)\nInfo    : Meshing surface 7 (Plane, Frontal-Delaunay)\n", "face 7 (Plane)"),
        ("Info    : Meshing surface 7 (Plane, Delaunay)\nInfo    : Meshing 3D...\n", "the volumes"),
        ("Info    : Meshing curve 1 (Line)\nInfo    : Done meshing 1D (Wall 1s, CPU 1s)\n", ""),
        ("Info    : Reading 'b.geo'...\n", ""),
    ],
)
def test_the_place_is_the_last_that_gmsh_tells(printed: str, place: str) -> None:
    assert place_of(printed) == place


def test_a_mirrored_face_may_be_numbered_the_other_way_round(tmp_path: Path) -> None:
    copies = "a[] = Symmetry{1, 0, 0, 0} {Duplicata{Surface{1};}}; Coherence;\n"
    text = SHEET.format(2.0).replace("Physical", f'{copies}Physical Surface("block") = {{1, a[0]}};\n//', 1)
    assert_allclose(meshed(from_dict(scene_data(write(tmp_path / "b.geo", text)))).box(), [[-1, 0], [1, 2]], atol=1e-6)


@pytest.mark.parametrize(("kind", "order"), every_nth(2, KINDS, [1, 2]))
def test_every_kind_gives_the_block_it_describes(kind: str, order: int, tmp_path: Path) -> None:
    data = data_of(kind, tmp_path)
    data["geometry"]["order"] = order
    scene = from_dict(data)
    ((body, sides),) = scene.geometry.bodies(scene.dim).items()
    mesh = meshed(scene)
    assert (body, set(sides)) == (next(iter(scene.bodies)), {"bottom", "top"})
    assert set(mesh.sides) == {f"{body}.bottom", f"{body}.top"}
    assert mesh.degree == order
    size = np.array([[0, 0, 0], [4, 2, 2]])[:, : scene.dim]
    assert_allclose(mesh.box(), size, atol=1e-6)
    assert_allclose(scene.geometry.box(scene.dim), size, atol=1e-6)
    assert worst_quality(mesh.domain, mesh.degree) > 0.3  # gmsh's meshes of a block; slivers are below 0.1


@pytest.mark.parametrize("kind", often(KINDS, ("msh3", "py", "brep")))
def test_samples_lie_on_the_side_reach_its_corners_and_look_outward(kind: str, tmp_path: Path) -> None:
    scene = from_dict(data_of(kind, tmp_path))
    (body,) = scene.bodies
    for side, height, up in (("bottom", 0.0, -1.0), ("top", 2.0, 1.0)):
        points, normals = scene.geometry.sample(f"{body}.{side}", scene.dim)
        assert_allclose(points[:, -1], height, atol=1e-6)
        assert_allclose(normals, np.tile(up * np.eye(scene.dim)[-1], (len(points), 1)), atol=1e-9)
        assert_allclose([points[:, 0].min(), points[:, 0].max()], [0, 4], atol=1e-6)


@pytest.mark.parametrize("kind", [*slow("msh"), "msh3"])
def test_a_mesh_whose_nodes_all_lie_in_the_body_is_read(kind: str, tmp_path: Path) -> None:
    """As `stickslip mesh -o` and other programs write them: the sides' entities hold no nodes of their own."""
    first = from_dict(data_of(kind, tmp_path))
    path = tmp_path / "again.msh"
    write_msh(first.geometry, first.request(), path)
    again = from_dict(scene_data(path, first.dim))
    one, other = meshed(first), meshed(again)
    assert_allclose(other.domain.geometry.x, one.domain.geometry.x, atol=1e-12)
    points, _ = again.geometry.sample("block.bottom", again.dim)
    assert_allclose(points[:, -1], 0.0, atol=1e-12)
    outline = again.geometry.outline(again.dim)
    named = [face.size for face in outline.entities if face.number in outline.side_of]
    assert_allclose(named, 2 * [4.0 * 2.0 ** (again.dim - 2)])
    assert len(outline.entities) == 2 * again.dim  # the others are found on the mesh's skin


@pytest.mark.parametrize("thickness", [*slow(1e-2, 1e-4), 1e-9])
def test_normals_of_a_thin_sheet_point_out_of_it(thickness: float, tmp_path: Path) -> None:
    """Its edges run clockwise, so that the normals of their lines point inward."""
    scene = from_dict(scene_data(write(tmp_path / "sheet.geo", SHEET.format(thickness))))
    for side, up in (("bottom", -1.0), ("top", 1.0)):
        _, normals = scene.geometry.sample(f"block.{side}", 2)
        assert_allclose(normals, np.tile([0, up], (len(normals), 1)), atol=1e-9)


def test_normals_of_a_bore_look_into_it(tmp_path: Path) -> None:
    scene = from_dict(scene_data(write(tmp_path / "ring.geo", RING)))
    of = {side: scene.geometry.sample(f"block.{side}", 2) for side in ("bottom", "top")}
    for points, normals in of.values():
        radial = np.einsum("kd,kd->k", points, normals) / np.linalg.norm(points, axis=1)
        inner = np.linalg.norm(points, axis=1).max() < 1.5
        assert_allclose(radial, -1 if inner else 1, atol=0.05)  # chords of a circle cut into 16 or more


@pytest.mark.parametrize("kind", often(KINDS, ("msh", "geo", "step")))
def test_a_scene_with_a_file_reads_back_the_same(kind: str, tmp_path: Path) -> None:
    scene = from_dict(data_of(kind, tmp_path))
    assert from_dict(to_dict(scene)) == scene


def test_a_relative_file_begins_at_the_scene_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    draw(tmp_path / "b.msh", 2)
    lines = ['model = "plane strain"', "[geometry]", 'file = "b.msh"', "[bodies.block]", "E = 1.0", "nu = 0.3"]
    path = write(tmp_path / "scene.toml", "\n".join(lines))
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert read(path).geometry.file == str(tmp_path / "b.msh")


def test_millimetres_are_scaled_and_mesh_sizes_stay_in_metres(tmp_path: Path) -> None:
    in_m, in_mm = draw(tmp_path / "m.brep"), draw(tmp_path / "mm.brep", scale=1000.0)
    one, other = (
        meshed(from_dict(scene_data(file, 3, "part", mesh_size=0.5, names=FACES, length_unit=unit)))
        for file, unit in ((in_m, "m"), (in_mm, "mm"))
    )
    assert_allclose(one.box(), other.box(), atol=1e-9)
    count = [mesh.domain.topology.index_map(3).size_global for mesh in (one, other)]
    assert abs(count[0] - count[1]) < 0.1 * count[0]  # gmsh's tolerances may move a node, no more


def test_the_contact_side_is_meshed_finer(tmp_path: Path) -> None:
    data = scene_data(draw(tmp_path / "b.brep"), 3, "part", mesh_size=1.0, contact_mesh_size=0.25, names=FACES)
    mesh = meshed(from_dict(data))
    facets = {side: len(mesh.facets(f"part.{side}")) for side in ("bottom", "top")}
    assert facets["bottom"] > 2 * 8 / 0.25**2 * 0.8  # 8 m2 in triangles of legs 0.25 m, give or take a fifth
    assert facets["top"] < facets["bottom"] / 4


def test_periodic_sides_of_a_file_get_matching_meshes(tmp_path: Path) -> None:
    names = FACES | {"part.left": ["face 1"], "part.right": ["face 2"]}
    data = scene_data(draw(tmp_path / "b.brep"), 3, "part", mesh_size=0.7, contact_mesh_size=0.3, names=names)
    data["periodic"] = {"sides": {"boundary": "part.right", "with": "part.left"}}
    x = meshed(from_dict(data)).domain.geometry.x
    left, right = (np.round(x[np.abs(x[:, 0] - end) < 1e-6][:, 1:], 6) for end in (0.0, 4.0))
    assert len(left) > 16  # more than the nodes on its edges: inner ones match too
    assert_allclose(left[np.lexsort(left.T)], right[np.lexsort(right.T)], atol=2e-6)


@pytest.mark.parametrize("name", [*slow("B.BREP"), "B.STP", "B.Brep.gz"])
def test_endings_may_be_in_upper_case(name: str, tmp_path: Path) -> None:
    plain = draw(tmp_path / ("b.step" if "STP" in name else "b.brep")).read_bytes()
    (tmp_path / name).write_bytes(gzip.compress(plain) if name.endswith(".gz") else plain)
    there = set(tmp_path.iterdir())
    mesh = meshed(from_dict(scene_data(tmp_path / name, 3, "part", mesh_size=2.0, names=FACES)))
    assert_allclose(mesh.box()[1], [4, 2, 2], atol=1e-6)
    assert set(tmp_path.iterdir()) == there


def test_a_gz_is_unpacked(tmp_path: Path) -> None:
    plain = draw(tmp_path / "b.step")
    packed = tmp_path / "c.step.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    assert from_dict(scene_data(packed, 3, "part", mesh_size=0.5, names=FACES)).geometry.bodies(3)
    packed.write_bytes(gzip.compress(plain.read_bytes())[:200])
    with pytest.raises(GeometryError, match=r"c\.step\.gz: cannot be unpacked"):
        from_dict(scene_data(packed, 3, "part", mesh_size=0.5, names=FACES))


def test_a_step_file_that_is_read_in_metres_says_so_where_its_cells_are_too_many(tmp_path: Path) -> None:
    file = draw(tmp_path / "b.step")
    data = scene_data(file, 3, "part", mesh_size=4e-3, names=FACES)
    with pytest.raises(SceneError, match=r"box, read in m, is 4 x 2 x 2 m; is length_unit = 'mm' missing\?"):
        make_plan(from_dict(data))
    data["geometry"] |= {"length_unit": "mm", "mesh_size": 4e-9}
    with pytest.raises(SceneError, match=r"use a larger size$"):
        make_plan(from_dict(data))


def test_names_of_a_step_file_are_its_last_component_numbered_on_repeat(tmp_path: Path) -> None:
    text = draw(tmp_path / "b.step").read_text()
    named = write(tmp_path / "n.step", re.sub(r"Open CASCADE STEP translator [0-9. ]+", "Assembly/Left Jaw-2", text))
    names = {"left_jaw_2.bottom": ["face 5"], "left_jaw_2.top": ["face 6"]}
    scene = from_dict(scene_data(named, 3, "left_jaw_2", mesh_size=0.5, names=names))
    assert set(scene.geometry.bodies(3)) == {"left_jaw_2"}
    two = draw(tmp_path / "two.brep", act=lambda model: (model.occ.addBox(9, 0, 0, 1, 1, 1), model.occ.synchronize()))
    data = scene_data(two, 3, "part", mesh_size=0.5, names=FACES)
    data["bodies"]["part_2"] = {"E": 1.0, "nu": 0.3}
    assert set(from_dict(data).geometry.bodies(3)) == {"part", "part_2"}


def test_sides_take_the_names_that_gmsh_gives_to_faces() -> None:
    with gmsh_session() as gmsh:
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        for tag, name in ((5, "Assembly/Base Face"), (6, "Other/base face"), (1, "2nd")):
            gmsh.model.setEntityName(2, tag, name)
        parts = find_parts(gmsh, 3, True, {"part.own": ["face 3"]}, 1.0)
    assert parts.bodies == {"part": [1]}
    assert parts.sides == {"part.side_2nd": [1], "part.base_face": [5], "part.base_face_2": [6], "part.own": [3]}


def test_a_box_selects_what_lies_wholly_inside(tmp_path: Path) -> None:
    names = {"part.bottom": {"box": [-1, -1, -0.1, 5, 3, 0.1]}, "part.top": {"box": [-1, -1, 1.9, 5, 3, 2.1]}}
    scene = from_dict(scene_data(draw(tmp_path / "b.brep"), 3, "part", mesh_size=0.5, names=names))
    assert_allclose(scene.geometry.sample("part.bottom", 3)[0][:, 2], 0, atol=1e-6)
    assert_allclose(scene.geometry.sample("part.top", 3)[0][:, 2], 2, atol=1e-6)


def test_a_cad_file_without_a_size_gets_one_from_its_volume(tmp_path: Path) -> None:
    geometry = from_dict(scene_data(draw(tmp_path / "b.brep"), 3, "part", names=FACES)).geometry
    assert_allclose(geometry.size(3), (8 * 16.0 / 20_000) ** (1 / 3))  # m; 16 m³


def test_parameters_of_a_script_change_its_shape(tmp_path: Path) -> None:
    geo = scene_data(write(tmp_path / "b.geo", GEO), length=6, height=3.0)
    assert_allclose(from_dict(geo).geometry.box(2)[1], [6, 3], atol=1e-6)
    py = scene_data(write(tmp_path / "b.py", PY), mesh_size=0.5, length=5.0)
    assert_allclose(from_dict(py).geometry.box(2)[1], [5, 2], atol=1e-6)


def test_parameter_names_are_found_in_includes_too(tmp_path: Path) -> None:
    write(tmp_path / "sizes.geo", "DefineConstant[ a = {1, Min 0}, b ];\nIf (!Exists(c)) c = 3; EndIf\nd = 4;")
    main = write(tmp_path / "main.geo", 'Include "sizes.geo";\nDefineConstant[ e = {2, Name "Group/f"} ];')
    assert parameter_names(main) == {name: name for name in "abce"} | {"Group/f": "e"}


def test_a_parameter_goes_by_its_name_in_onelab_too(tmp_path: Path) -> None:
    data = scene_data(write(tmp_path / "b.geo", GEO), **{"Parameters/height": 3})
    assert_allclose(from_dict(data).geometry.box(2)[1], [4, 3], atol=1e-6)
    data["geometry"]["height"] = 5
    with pytest.raises(SceneError, match="Parameters/height and height are one parameter; remove one"):
        from_dict(data)


def test_the_scene_hash_follows_the_content_of_the_file_not_its_place(tmp_path: Path) -> None:
    files = [write(tmp_path / "a.geo", GEO), write(tmp_path / "b.geo", GEO), write(tmp_path / "c.geo", GEO + "// c\n")]
    hashes = [scene_hash(from_dict(scene_data(file))) for file in files]
    assert hashes[0] == hashes[1] != hashes[2]


def test_a_changed_file_is_another_scene_and_the_one_that_was_read_stays_what_it_was(tmp_path: Path) -> None:
    path = write(tmp_path / "b.geo", GEO)
    scene = from_dict(scene_data(path))
    before = scene_hash(scene)
    write(path, GEO.replace("length = 4", "length = 7"))
    again = from_dict(scene_data(path))
    assert_allclose(again.geometry.box(2)[1], [7, 2], atol=1e-6)
    assert_allclose(scene.geometry.box(2)[1], [4, 2], atol=1e-6)
    assert scene_hash(scene) == before != scene_hash(again)
    with pytest.raises(GeometryError, match=r"b\.geo: has changed since the scene was read"):
        meshed(scene)  # its sides and sizes are another shape's


@pytest.mark.parametrize("becomes", [*slow(None), GEO.replace("length = 4", "length = 7")])
def test_a_run_goes_on_and_tells_of_the_file_that_it_meshed(becomes: str | None, tmp_path: Path) -> None:
    path = write(tmp_path / "b.geo", GEO)
    scene = from_dict(scene_data(path) | {"steps": {"count": 3}})
    at_start = hashlib.sha256(path.read_bytes()).hexdigest()
    hashed = scene_hash(scene)

    def change(step: object) -> None:
        path.unlink(missing_ok=True) if becomes is None else path.write_text(becomes)

    outcome, content = run(scene, tmp_path / "out", Watch(on_step=change))
    assert (outcome.status, len(content["steps"])) == ("converged", 3)
    assert content["scene"]["hash"] == hashed
    assert json.loads((tmp_path / "out" / BEGUN).read_text())["scene"]["geometry"]["file"] == at_start


# --- refused


@pytest.mark.parametrize(
    ("name", "geometry", "says"),
    [
        ("b.geo", {"builder": "block"}, "geometry: has both builder and file"),
        ("none.geo", {}, r"geometry\.file = .*none\.geo: no such file"),
        ("b.txt", {}, r"geometry\.file = .*unknown ending; expected one of \.geo"),
        ("b.geo", {"lenght": 3}, r"geometry\.lenght = 3: b\.geo has no such DefineConstant; did you mean length\?"),
        ("b.geo", {"length": "long"}, r"geometry\.length = long: a \.geo file takes numbers only"),
        ("b.geo", {"mesh_size": -1.0}, r"geometry\.mesh_size = -1\.0: must be positive"),
        ("b.geo", {"contact_mesh_size": 0.1}, "contact_mesh_size = 0.1: needs mesh_size too"),
        ("b.geo", {"length_unit": "yd"}, "geometry.length_unit = .*not one of these"),
        ("b.geo", {"cells": "tensor"}, "geometry.cells = .*not one of these"),
        ("b.geo", {"names": {"block.left": {"box": [0, 0, 0, 1]}}}, "expected .x0, y0, z0, x1, y1, z1"),
        ("b.geo", {"names": {"block.left": {"box": [1, 0, 0, 0, 1, 1]}}}, "empty; each lower coordinate"),
        ("b.geo", {"names": {"block.left": {"box": [9, 9, 9, 10, 10, 10]}}}, "left.: no edge lies wholly inside"),
        ("b.geo", {"names": {"block.left": ["edge 9"]}}, '"edge 9" is not there; expected "edge 1" to "edge 4"'),
        ("b.geo", {"names": {"block.left": ["face 1"]}}, '"face 1" is not there; expected "edge 1"'),
        ("b.geo", {"names": {"block.left": []}}, "the list is empty"),
        ("b.geo", {"names": {"clamp": []}}, 'names."clamp": the list is empty'),
        ("b.geo", {"names": {"Block.left": ["edge 4"]}}, 'side "Block.left": a side is named body.side'),
        ("b.geo", {"names": {"blok.left": ["edge 4"]}}, "no such body; did you mean block?"),
        ("b.geo", {"names": {"block.left": ["edge 1"]}}, "edge 1 is in two sides, block.bottom and block.left"),
        ("b.geo", {"names": {"block.top": ["edge 4"]}}, "has a side of this name already"),
        ("b.msh", {"mesh_size": 0.1}, r"geometry\.mesh_size = 0\.1: a mesh file has its own mesh"),
        ("b.msh", {"mesh_sise": 0.1}, r"geometry\.mesh_sise: unknown key; did you mean mesh_size\?"),
    ],
)  # fmt: skip
def test_wrong_tables_are_refused_in_one_line(name: str, geometry: dict[str, Any], says: str, tmp_path: Path) -> None:
    if name == "b.msh":
        draw(tmp_path / name, 2)
    elif name != "none.geo":
        write(tmp_path / name, GEO)
    with pytest.raises((SceneError, GeometryError), match=says) as caught:
        from_dict(scene_data(tmp_path / name, **geometry))
    assert "\n" not in str(caught.value)


def test_neither_builder_nor_file_is_refused() -> None:
    with pytest.raises(SceneError, match="geometry: needs either builder or file"):
        from_dict(scene_data("x") | {"geometry": {"length": 1.0}})


@pytest.mark.parametrize(
    "case",
    every_nth(3, [
        (GEO.replace('Physical Surface("block") = {1};', ""), "names no body: a body is a physical group of surfaces"),
        (GEO.replace('"block")', '"Block")'), 'physical surface "Block" .1.: a body\'s name is made of a-z'),
        (GEO.replace("block.bottom", "bottom"), 'side "bottom": a side is named body.side'),
        (GEO + 'Physical Surface("twin") = {1};', "surface 1 is in two bodies"),
        (GEO + 'Rectangle(2) = {9, 0, 0, 1, 1};', "1 surface is in no body|cells are in no body"),
        (GEO.replace("{0, 0, 0, length", "{0, 0, 1, length"), "lies at z = 1 to 1, and a plane model lies at z = 0"),
        (GEO + "Box(9) = {9, 9, 9, 1, 1, 1};", "holds volumes, and a plane model is made of surfaces"),
        ("Point(1) = {0, 0, 0, 1};\n", "has no surfaces"),
        (GEO + "foo bar;\n", r"b\.geo: gmsh says: .*line 9: Unknown variable 'bar'"),
        (GEO + "x = 1; y = 2;", "last line has several statements and no line break"),
        (GEO + "Exit;\n", "gmsh ended without an answer|gmsh says"),
        (GEO.replace('"block.top") = {3}', '"block.top") = {77}'), "block.top: no such side; did you mean"),
    ]),
)  # fmt: skip
def test_wrong_scripts_are_refused(case: tuple[str, str], tmp_path: Path) -> None:
    text, says = case
    with pytest.raises((SceneError, GeometryError), match=says) as caught:
        meshed(from_dict(scene_data(write(tmp_path / "b.geo", text))))
    assert "\n" not in str(caught.value)


def test_a_model_of_the_other_dimension_is_refused(tmp_path: Path) -> None:
    with pytest.raises(GeometryError, match="has no volumes, and a 3d model is made of them"):
        from_dict(scene_data(draw(tmp_path / "b.msh", 2), 3))
    with pytest.raises(GeometryError, match="holds volumes, and a plane model is made of surfaces"):
        from_dict(scene_data(draw(tmp_path / "c.msh", 3), 2))


def test_a_script_in_disguise_is_no_mesh(tmp_path: Path) -> None:
    disguised = write(tmp_path / "b.msh", "x = 1;\n")
    with pytest.raises(GeometryError, match=r"b\.msh: is not a \.msh file: it does not begin with \$MeshFormat"):
        from_dict(scene_data(disguised))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (PY + '    raise ValueError("too\\nthick")\n', r"b\.py: line 7: ValueError: too thick"),
        (PY.replace('parameters["length"]', 'parameters["size"]'), r"b\.py: line 3: KeyError: 'size'"),
        (PY + "  x = = 1\n", r"b\.py: line 7: \w*Error: "),
        ("import sys\nsys.exit(3)\nbuild = None\n", r"b\.py: line 2: SystemExit: 3"),
        ("x = 1\n", r"b\.py: defines no build\(model, parameters\)"),
        ("import gmsh\ngmsh.initialize()\ngmsh.finalize()\n", r"b\.py: defines no build\(model, parameters\)"),
        ("import os\nos.abort()\nbuild = None\n", r"b\.py: gmsh crashed on it \(SIGABRT\)"),
        ("import os\nos._exit(0)\nbuild = None\n", r"b\.py: gmsh ended without an answer"),
    ],
)  # fmt: skip
def test_what_goes_wrong_in_a_python_file_is_one_line(text: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(GeometryError, match=says) as caught:
        from_dict(scene_data(write(tmp_path / "b.py", text), mesh_size=0.5, length=4.0))
    assert "\n" not in str(caught.value)


def spoil(path: Path, what: str) -> None:
    """Break the first cell of a plane mesh, in the file's own text (MSH 4.1: number, then nodes)."""
    head, tail = draw(path, 2).read_text().split("$Elements\n")
    lines = tail.splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("2 1 2 ")) + 1  # the surface's triangles
    number, a, b, c = lines[at].split()
    if what == "mixed":  # a block of one quadrilateral more, made of this triangle and a node of the next one
        d = next(n for n in lines[at + 1].split()[1:] if n not in (a, b, c))
        blocks, count, low, high = lines[0].split()
        lines[0] = f"{int(blocks) + 1} {int(count) + 1} {low} {int(high) + 1}"
        lines[-1:-1] = ["2 1 3 1", f"{int(high) + 1} {a} {b} {c} {d}"]
    elif what == "twice":
        blocks, count, low, high = lines[0].split()
        lines[0] = f"{blocks} {int(count) + 1} {low} {int(high) + 1}"
        lines[at - 1] = f"2 1 2 {int(lines[at - 1].split()[3]) + 1}"
        lines.insert(at, f"{int(high) + 1} {b} {c} {a}")
    else:
        lines[at] = f"{number} {a} {c} {b}" if what == "inverted" else f"{number} {a} {b} {b}"
    path.write_text(head + "$Elements\n" + "\n".join(lines) + "\n")


@pytest.mark.parametrize(
    ("what", "says"),
    [
        ("inverted", "body block: 1 of .* cells are turned inside out"),
        ("flat", "body block: 1 of .* cells have no volume"),
        ("twice", "names 1 of its cells twice"),
        ("mixed", "names 1 of its cells twice"),
    ],
)
def test_unusable_cells_are_refused(what: str, says: str, tmp_path: Path) -> None:
    spoil(tmp_path / "b.msh", what)
    with pytest.raises(GeometryError, match=says):
        from_dict(scene_data(tmp_path / "b.msh"))


def test_a_facet_of_three_cells_is_refused() -> None:
    fan = np.array([[1, 2, 3], [1, 2, 4], [1, 2, 5]])
    check_neighbours(2, {"a": fan[:2]})
    with pytest.raises(GeometryError, match=r"the facet of the nodes \[1, 2\] bounds 3 cells, and can bound two"):
        check_neighbours(2, {"a": fan[:2], "b": fan[2:]})


def test_a_side_that_lies_inside_is_refused(tmp_path: Path) -> None:
    text = GEO.split("Physical")[0] + INSIDE
    with pytest.raises(GeometryError, match=r"side block\.top: edge 10 is not on the boundary of block"):
        from_dict(scene_data(write(tmp_path / "b.geo", text)))


def test_gmshs_own_files_are_found_where_this_machine_has_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Debian 12, Debian 13, and gmsh from PyPI, whose files are not compressed."""
    debian, wheel = tmp_path / "debian", tmp_path / "wheel"
    monkeypatch.setattr("stickslip.geometry.user_files.user_file.DEBIAN", debian)
    monkeypatch.setattr("stickslip.geometry.user_files.user_file.WHEEL", wheel)
    named = debian / "demos/boolean/part.step.gz"
    assert installed(named) == named
    for place in (wheel / "examples/boolean/part.step", debian / "examples/boolean/part.step.gz", named):
        place.parent.mkdir(parents=True)
        place.touch()
        assert installed(named) == place
    assert installed(tmp_path / "demos/part.step.gz") == tmp_path / "demos/part.step.gz"


OWN = (
    PY
    + """
    for edge in range(1, 5):
        model.mesh.setTransfiniteCurve(edge, 6)
    model.mesh.setTransfiniteSurface(1)
    model.mesh.generate(2)
    model.mesh.refine()
"""
)
PERIODIC = """
s = LENGTH;
Point(1) = {0, 0, 0}; Point(2) = {s, 0, 0}; Point(3) = {s, 0.3 * s, 0};
Point(4) = {s, s, 0}; Point(5) = {0, s, 0}; Point(6) = {0, 0.3 * s, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 5}; Line(5) = {5, 6}; Line(6) = {6, 1};
Curve Loop(1) = {1:6};
Plane Surface(1) = {1};
Physical Surface("block") = {1};
Physical Curve("block.bottom") = {1};
Physical Curve("block.right") = {2, 3};
Physical Curve("block.top") = {4};
Physical Curve("block.left") = {5, 6};
"""  # the edges of the left side are numbered from above, those of the right one from below


def meshed_as(scene: Scene) -> Mesh:
    return build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF)


def test_a_script_that_meshes_keeps_its_own_mesh(tmp_path: Path) -> None:
    mesh = meshed_as(from_dict(scene_data(write(tmp_path / "b.py", OWN), length=4.0)))
    assert mesh.domain.topology.index_map(2).size_global == 4 * 2 * 5 * 5  # each cell cut into four


@pytest.mark.parametrize("meshes", [*slow("Mesh 1;"), "Mesh 2;"])
def test_sizes_of_the_scene_mesh_again_what_a_script_has_meshed(meshes: str, tmp_path: Path) -> None:
    data = scene_data(write(tmp_path / "b.geo", f"{GEO}{meshes}\n"), mesh_size=0.5, contact_mesh_size=0.1)
    mesh = meshed_as(from_dict(data))
    assert abs(len(mesh.facets("block.bottom")) - 40) <= 2  # 4 m in 0.1 m; 8 in the script's mesh
    assert abs(len(mesh.facets("block.top")) - 8) <= 2


def test_sizes_of_the_scene_leave_a_mesh_without_geometry(tmp_path: Path) -> None:
    own = meshed_as(from_dict(scene_data(draw(tmp_path / "b.msh", 2))))
    data = scene_data(write(tmp_path / "b.geo", 'Merge "b.msh";\n'), mesh_size=0.1)
    count = [mesh.domain.topology.index_map(2).size_global for mesh in (own, meshed_as(from_dict(data)))]
    assert count[0] == count[1] > 0


@pytest.mark.parametrize("length", [1.0, 1e-6])
def test_periodic_sides_of_several_edges_match_in_any_unit(length: float, tmp_path: Path) -> None:
    path = write(tmp_path / "b.geo", PERIODIC.replace("LENGTH", f"{length}"))
    options = MeshOptions(
        size=length / 5,
        fine_size=length / 40,
        fine_sides=["block.right"],
        periodic=[("block.left", "block.right")],
        order=1,
    )
    mesh = ask(Question(path=path, dim=2, unit=1.0, mesh=options))
    assert isinstance(mesh, RawMesh)
    left, right = (np.sort(mesh.points[np.unique(mesh.facets[f"block.{side}"]), 1]) for side in ("left", "right"))
    assert len(right) == 41  # the finer side is the one whose mesh the other gets
    assert_allclose(left, right, atol=1e-6 * length)


def test_a_mesh_with_a_node_that_is_nowhere_is_refused(tmp_path: Path) -> None:
    path = draw(tmp_path / "b.msh", 2)
    write(path, path.read_text().replace("\n4 2 0\n", "\n4 nan 0\n"))  # the corner's node
    with pytest.raises(GeometryError, match=r"b\.msh: a node has a coordinate that is not a finite number"):
        from_dict(scene_data(path))


def cut_ball(gmsh: Gmsh) -> int:
    """A cap of the unit ball, above z = 1/2, whose dome has no edge but its rim; returns the tag of the flat face."""
    gmsh.model.occ.addSphere(0, 0, 0, 1)
    gmsh.model.occ.rotate([(3, 1)], 0, 0, 0, 1, 0, 0, 1.5707963267948966)  # the sphere's seam goes below
    gmsh.model.occ.addBox(-2, -2, 0.5, 4, 4, 4)
    gmsh.model.occ.intersect([(3, 1)], [(3, 2)])
    gmsh.model.occ.synchronize()
    (flat,) = (tag for _, tag in gmsh.model.getEntities(2) if gmsh.model.getType(2, tag) == "Plane")
    return int(flat)


RIM = {"part.flat": {"box": [-1.0, -1.0, 0.4, 1.0, 1.0, 0.6]}}


def test_a_curved_face_that_leaves_the_box_is_not_taken_though_its_rim_lies_inside() -> None:
    with gmsh_session() as gmsh:
        flat = cut_ball(gmsh)
        assert find_parts(gmsh, 3, True, RIM, 1.0).sides == {"part.flat": [flat]}


@pytest.mark.parametrize("newer", [False, True])
def test_parameters_are_given_to_gmsh_as_such(newer: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """gmsh 4.13 takes coordinates where 4.8 takes parameters, unless it is told."""

    def older_one(dim: int, tag: int, parametricCoord: list[float]) -> int:
        return len(parametricCoord) == dim

    def newer_one(dim: int, tag: int, coord: list[float], parametric: bool = False) -> int:
        return len(coord) == dim if parametric else 0

    with gmsh_session() as gmsh:
        flat = cut_ball(gmsh)
        monkeypatch.setattr(gmsh.model, "isInside", newer_one if newer else older_one)
        assert find_parts(gmsh, 3, True, RIM, 1.0).sides == {"part.flat": [flat]}


def test_a_box_is_as_sharp_far_from_the_origin() -> None:
    with gmsh_session() as gmsh:
        gmsh.model.occ.addBox(1e6, 0, 0, 4, 2, 2)
        gmsh.model.occ.synchronize()
        names = {"part.bottom": {"box": [0.0, -1.0, -1.0, 2e6, 3.0, 1.5]}}
        assert find_parts(gmsh, 3, True, names, 1.0).sides == {"part.bottom": [5]}  # the others end at z = 2


def test_an_axisymmetric_file_does_not_reach_beyond_the_axis_wherever_it_lies(tmp_path: Path) -> None:
    (tmp_path / "b.geo").write_text(GEO.replace("{0, 0, 0, length", "{-1e-4, 1e6, 0, length"))
    with pytest.raises(SceneError, match=r"reaches x = -0\.0001; x is the radius"):
        from_dict(scene_data(tmp_path / "b.geo") | {"model": "axisymmetric"})
