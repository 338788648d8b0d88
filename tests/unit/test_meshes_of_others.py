"""Meshes of other programs: cells that are completed or split, and bodies that share nodes."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.assemblies import write_assembly
from shared.drawn import scene_data
from shared.problems import SimulationOf
from stickslip.geometry.errors import GeometryError
from stickslip.geometry.mesh.gmsh_session import gmsh_session
from stickslip.geometry.user_files.cells import SHAPES
from stickslip.geometry.user_files.meshing import MeshOptions
from stickslip.geometry.user_files.open_file import apart
from stickslip.geometry.user_files.outline import Outline
from stickslip.geometry.user_files.raw_mesh import FIRST_ORDER, LOCAL_FACETS, RawMesh
from stickslip.geometry.user_files.reader import Question, ask
from stickslip.geometry.user_files.user_file import UserFile
from stickslip.solvers.simulation.resolve import resolve
from stickslip.workflows.run.mesh_report import look
from stickslip.workflows.scene_file.read import from_dict

BOX = """
Point(1) = {0, 0, 0}; Point(2) = {2, 0, 0}; Point(3) = {2, 1, 0}; Point(4) = {0, 1, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
Transfinite Curve{1, 3} = 4; Transfinite Curve{2, 4} = 3;
"""
PLANE = 'Physical Surface("a") = {1}; Physical Curve("a.bottom") = {1}; Physical Curve("a.top") = {3};'
HALVES = """Point(5) = {1, 0, 0}; Point(6) = {1, 1, 0}; Line(5) = {1, 5}; Line(6) = {5, 2}; Line(7) = {5, 6};
Line(8) = {3, 6}; Line(9) = {6, 4}; Curve Loop(2) = {5, 7, 9, 4}; Curve Loop(3) = {6, 2, 8, -7};
Delete{Surface{1}; Curve{1, 3};} Plane Surface(1) = {2}; Plane Surface(2) = {3}; Recombine Surface{2};
Transfinite Curve{:} = 3; Transfinite Surface{1, 2}; Physical Surface("a") = {1, 2};
Physical Curve("a.bottom") = {5, 6}; Physical Curve("a.top") = {8, 9};"""
SOLID = """out[] = Extrude{0, 0, 1} {Surface{1}; Layers{2}; Recombine;};
Physical Volume("a") = {out[1]}; Physical Surface("a.bottom") = {1}; Physical Surface("a.top") = {out[0]};"""
# hexahedra on a base of quadrilaterals and triangles, tetrahedra above, pyramids between
TRANSITION = """out[] = Extrude{0, 0, 1} {Surface{1};};
Transfinite Curve{:} = 4; Transfinite Surface{:}; Recombine Surface{1}; Transfinite Volume{:}; TransfQuadTri{out[1]};
Physical Volume("a") = {out[1]}; Physical Surface("a.bottom") = {1}; Physical Surface("a.top") = {out[0]};"""
KINDS = {
    "quadrilaterals": (2, f"{BOX} Transfinite Surface{{1}}; Recombine Surface{{1}}; {PLANE}"),
    "quadrilaterals and triangles": (2, f"{BOX} {HALVES}"),
    "hexahedra": (3, f"{BOX} Transfinite Surface{{1}}; Recombine Surface{{1}}; {SOLID}"),
    "wedges": (3, BOX + SOLID),
    "pyramids": (3, BOX + TRANSITION),
}
ORDERS = {"1": (1, 0), "2": (2, 0), "2 without middle nodes": (2, 1)}


def script(kind: str, order: str) -> str:
    dim, text = KINDS[kind]
    degree, incomplete = ORDERS[order]
    return f"{text}\nMesh.ElementOrder = {degree}; Mesh.SecondOrderIncomplete = {incomplete};\nMesh {dim};\n"


def test_tables_are_those_of_gmsh() -> None:
    with gmsh_session() as gmsh:
        for word, shape in SHAPES.items():
            name, dim, order, count, flat, corners = gmsh.model.mesh.getElementProperties(shape.types[1])
            assert (name.split()[0], order, count, corners) == (word, 2, shape.all, shape.corners)
            at = np.reshape(flat, (-1, dim))
            assert_allclose(at[shape.corners : shape.few], at[np.array(shape.edges)].mean(axis=1), atol=1e-12)
            for node, quad in enumerate(shape.quads, start=shape.few):
                assert_allclose(at[node], at[list(quad)].mean(axis=0), atol=1e-12)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("kind", KINDS)
def test_cells_become_usable_without_hanging_nodes(kind: str, order: str, tmp_path: Path) -> None:
    path, dim = tmp_path / "a.geo", KINDS[kind][0]
    path.write_text(script(kind, order))
    options = MeshOptions(size=None, fine_size=None, fine_sides=(), periodic=(), order=ORDERS[order][0])
    mesh = ask(Question(path=path, dim=dim, unit=1.0, mesh=options))
    assert isinstance(mesh, RawMesh)
    facets = mesh.cells["a"][:, np.array(LOCAL_FACETS[FIRST_ORDER[mesh.kind]])]
    facets = np.sort(facets.reshape(-1, facets.shape[2]), axis=1)
    wanted, times = np.unique(facets, axis=0, return_counts=True)
    skin = mesh.points[wanted[times == 1]]
    on_box = (np.isclose(skin, 0) | np.isclose(skin, [2, 1, 1])).all(axis=1)[:, :dim].any(axis=1)
    assert on_box.all()  # a hanging node would leave facets of one cell alone inside
    corners = np.sort(np.concatenate(list(mesh.facets.values()))[:, : wanted.shape[1]], axis=1)
    assert set(map(tuple, corners.tolist())) <= set(map(tuple, wanted[times == 1].tolist()))


@pytest.mark.parametrize(("kind", "order"), [*((kind, "2 without middle nodes") for kind in KINDS), ("pyramids", "1")])
def test_a_uniform_pressure_is_exact_on_them(
    kind: str, order: str, simulation_of: SimulationOf, tmp_path: Path
) -> None:
    """A block of height 1, nu = 0, is pressed onto a smooth floor by 1 %."""
    path, dim = tmp_path / "a.geo", KINDS[kind][0]
    path.write_text(script(kind, order))
    data = scene_data(path, dim, "a", order=ORDERS[order][0])
    data["bodies"] = {"a": {"E": 1000.0, "nu": 0.0}}
    data["supports"] = {"top": {"boundary": "a.top", "displacement": [0.0] * (dim - 1) + [-0.01]}}
    (step,) = simulation_of(from_dict(data)).steps()
    (contact,) = step.contacts.values()
    assert_allclose(contact.normal_force, 10.0 * 2, rtol=1e-9)
    assert_allclose(contact.max_pressure, 10.0, rtol=1e-8)


def test_what_was_done_is_said(tmp_path: Path) -> None:
    for kind, order, says in (
        ("wedges", "1", "wedges became"),
        ("pyramids", "1", "pyramids became"),
        ("hexahedra", "2 without middle nodes", "12 hexahedra of 8 or 20 nodes got nodes in their faces and middles"),
        ("hexahedra", "2", ""),
    ):
        path = tmp_path / "a.geo"
        path.write_text(script(kind, order))
        outline = ask(Question(path=path, dim=3, unit=1.0))
        assert isinstance(outline, Outline)
        assert says in outline.note
        assert bool(says) == bool(outline.note)
        lines = [*look(from_dict(scene_data(path, 3, "a", order=ORDERS[order][0])))[0].lines()]
        assert lines[1:-1] == [outline.note] * bool(says)  # between those of the mesh and of the contact


def test_cells_of_order_3_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.geo"
    path.write_text(f"{KINDS['quadrilaterals'][1]} Mesh.ElementOrder = 3;\nMesh 2;\n")
    with pytest.raises(GeometryError, match="is made of cells that cannot be used, Quadrilateral 16"):
        ask(Question(path=path, dim=2, unit=1.0))


STACK = """SetFactory("OpenCASCADE"); DefineConstant[ sunk = 0 ];
Box(1) = {0, 0, 0, 2, 2, 1}; Box(2) = {0.3, 0.4, 1 - sunk, 1, 1, 1};
Physical Volume("low") = {1}; Physical Volume("up") = {2}; Mesh.MeshSizeMax = 0.7;
"""


def without_faces(folder: Path, order: int, sunk: float = 0.0) -> UserFile:
    """A mesh of a block on another one, or sunk into it, of whose faces the file tells nothing."""
    (folder / "stack.geo").write_text(STACK)
    with gmsh_session(["-setnumber", "sunk", str(sunk)]) as gmsh:
        gmsh.merge(str(folder / "stack.geo"))
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(folder / "stack.msh"))
    return UserFile(file=str(folder / "stack.msh"), order=order)


@pytest.mark.parametrize("order", [1, 2])
def test_faces_that_a_mesh_does_not_tell_are_found_on_its_skin(order: int, tmp_path: Path) -> None:
    file = without_faces(tmp_path, order)
    faces = file.outline(3).entities
    assert [face.bodies for face in faces] == [("low",)] * 6 + [("up",)] * 6
    assert_allclose(sorted(face.size for face in faces), [1] * 6 + [2] * 4 + [4] * 2)
    (sunk,) = without_faces(tmp_path, order, 0.2).overlaps(3)
    assert_allclose([sunk.depth, sunk.volume], [0.2, 0.2], rtol=0.02)


def test_skins_of_a_mesh_that_tells_no_faces_touch(tmp_path: Path, simulation_of: SimulationOf) -> None:
    without_faces(tmp_path, 1)
    still = {"x": 0.0, "y": 0.0, "z": 0.0}
    here = {"low.floor": {"box": [-1, -1, -0.1, 3, 3, 0.1]}, "up.lid": {"box": [0, 0, 1.9, 2, 2, 2.1]}}
    scene = from_dict({
        "model": "3d", "geometry": {"file": "stack.msh", "names": here},
        "bodies": {name: {"E": 1.0, "nu": 0.0} for name in ("low", "up")}, "contacts": {"any": {"between": "all"}},
        "supports": {"floor": {"boundary": "low.floor", "displacement": still},
                     "lid": {"boundary": "up.lid", "displacement": still | {"z": -0.01}}},
        "output": {"error": False},
    }, tmp_path)  # fmt: skip
    (step,) = simulation_of(scene).steps()
    assert step.contacts["any.low.up"].normal_force > 1e-3
    assert_allclose(step.contacts["any.low.up"].normal_force, -step.supports["lid"].force[2], rtol=1e-9)


def test_a_drawing_whose_faces_are_of_both_kinds_of_facets_is_read(tmp_path: Path) -> None:
    """An extrusion in layers of triangles, recombined: two faces of triangles, the others of quadrilaterals."""
    text = SOLID.replace('"a.bottom") = {1}', '"a.bottom") = {1, out[4]}')
    (tmp_path / "wedges.geo").write_text(f"{BOX} {text}\n")
    outline = UserFile(file=str(tmp_path / "wedges.geo")).outline(3)
    assert {face.corners.shape[1] for face in outline.entities} == {3, 4}
    for points, normals in (outline.skin("a"), outline.samples["a.bottom"]):
        assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
        outer = np.minimum(points, np.array([2.0, 1.0, 1.0]) - points)
        assert_allclose(np.where(np.abs(normals) > 0.9, outer, 0.0), 0.0, atol=1e-12)


PIECES = """SetFactory("OpenCASCADE");
DefineConstant[ turned = 0 ];
For k In {0:2}
  Box(k + 1) = {k, 0, 0, 1, 1, 1};
EndFor
If (turned > 0)
  Rotate{{0, 0, 1}, {2, 1, 0}, turned} {Volume{3};}
EndIf
BooleanFragments{ Volume{1, 2, 3}; Delete; }{}
Physical Volume("first") = {1}; Physical Volume("second") = {2}; Physical Volume("third") = {3};
l() = Surface In BoundingBox{-0.1, -0.1, -0.1, 0.1, 1.1, 1.1}; Physical Surface("first.left") = {l()};
Mesh.MeshSizeMax = 0.5;
"""


def row_of_boxes(folder: Path, suffix: str = ".geo", **geometry: Any) -> dict[str, Any]:
    """Data of a scene: three boxes in a row that share nodes, the first one held at its end."""
    path = folder / "row.geo"
    path.write_text(PIECES)
    if suffix == ".msh":
        with gmsh_session() as gmsh:
            gmsh.merge(str(path))
            gmsh.model.mesh.generate(3)
            path = path.with_suffix(suffix)
            gmsh.write(str(path))
    return {
        "model": "3d",
        "geometry": {"file": str(path)} | geometry,
        "bodies": {name: {"E": 1.0, "nu": 0.0, "density": 1.0} for name in ("first", "second", "third")},
        "supports": {"left": {"boundary": "first.left", "displacement": {"x": 0.0, "y": 0.0, "z": 0.0}}},
        "gravity": {"acceleration": [1e-3, 0.0, 0.0]},
    }


@pytest.mark.parametrize("suffix", [".geo", ".msh"])
def test_bodies_that_share_a_face_hold_each_other(suffix: str, tmp_path: Path, simulation_of: SimulationOf) -> None:
    data = row_of_boxes(tmp_path, suffix)
    scene = from_dict(data)
    assert resolve(scene).unheld == ""
    assert resolve(scene).rigid_modes.shape[1] == 0
    (step,) = simulation_of(scene).steps()
    assert_allclose(step.supports["left"].force[0], -3e-3, rtol=1e-9)


def test_bodies_that_share_an_edge_alone_can_turn_about_it(tmp_path: Path) -> None:
    scene = from_dict(row_of_boxes(tmp_path, turned=1.0))
    problem = resolve(scene)
    assert problem.rigid_modes.shape[1] == 1
    assert problem.unheld == "rotation about z of bodies.third"


def test_bodies_that_only_touch_do_not_hold_each_other(tmp_path: Path) -> None:
    data = row_of_boxes(tmp_path)
    path = Path(data["geometry"]["file"])
    path.write_text(path.read_text().replace("BooleanFragments", "//"))
    assert resolve(from_dict(data)).rigid_modes.shape[1] == 12


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (PIECES, "leave out BooleanFragments in row.geo"),
        (PIECES.replace("BooleanFragments{ Volume{1, 2, 3}; Delete; }{}", "Coherence;"), "leave out Coherence in row"),
    ],
)
def test_a_side_between_glued_bodies_says_what_to_leave_out(text: str, says: str, tmp_path: Path) -> None:
    data, between = row_of_boxes(tmp_path), "Surface In BoundingBox{0.9, -0.1, -0.1, 1.1, 1.1, 1.1}"
    lines = f'{text} m() = {between}; Physical Surface("second.left") = {{m()}};\n'
    Path(data["geometry"]["file"]).write_text(lines)
    with pytest.raises(
        GeometryError, match=rf"second\.left: face \d+ lies inside, first and second share it; .*{says}"
    ):
        from_dict(data)


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("a.geo", "Point(1) = {0, 0, 0};", "draw curves and points for each body apart"),
        ("a.py", "model.occ.fragment([], [])", "leave out fragment in a.py"),
        ("a.msh", "", "leave out fragment or Coherence where it is made"),
        ("a.step", "", "export the bodies as parts apart"),
    ],
)
def test_what_parts_bodies_is_told_for_each_kind_of_file(name: str, text: str, says: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    assert apart(tmp_path / name) == says


def ring(occ: Any) -> None:
    """A ring in the bore of a plate that is thicker."""
    for solid, r in ((occ.addBox(-2, -2, -0.5, 4, 4, 2), 1), (occ.addCylinder(0, 0, 0, 0, 0, 1, 1), 0.6)):
        occ.cut([(3, solid)], [(3, occ.addCylinder(0, 0, -1, 0, 0, 3, r))])


def ball(occ: Any) -> None:
    """A ball in its socket."""
    occ.cut([(3, occ.addBox(-2, -2, -2, 4, 4, 4))], [(3, occ.addSphere(0, 0, 0, 1))])
    occ.addSphere(0, 0, 0, 1)


def shaft(occ: Any, collar: float = 0.0) -> None:
    """A shaft in a bore, with a collar on each side if it has a radius."""
    occ.cut([(3, occ.addBox(-2, -2, 0, 4, 4, 2))], [(3, occ.addCylinder(0, 0, 0, 0, 0, 2, 1))])
    parts = [(3, occ.addCylinder(0, 0, -1, 0, 0, 4, 1))]
    parts += [(3, occ.addCylinder(0, 0, z, 0, 0, 1, collar)) for z in (-1, 2) if collar]
    if collar:
        occ.fuse(parts[:1], parts[1:])


def bar(occ: Any) -> None:
    """A bar of six sides in its hole, with a head of the same kind at each end."""
    for cut in (True, False):
        angles = np.pi / 3 * np.arange(6)
        corners = [occ.addPoint(np.cos(a), np.sin(a), 0) for a in angles]
        lines = [occ.addLine(corners[k - 1], corners[k]) for k in range(6)]
        (_, solid), *_ = (each for each in occ.extrude([(2, occ.addPlaneSurface([occ.addCurveLoop(lines)]))], 0, 0, 2)
                          if each[0] == 3)  # fmt: skip
        if cut:
            occ.cut([(3, occ.addBox(-2, -2, 0, 4, 4, 2))], [(3, solid)])
        else:
            occ.fuse([(3, solid)], [(3, occ.addBox(-1.5, -1.5, z, 3, 3, 1)) for z in (-1, 2)])


FREE = {  # shape, and the motion that nothing resists without friction; "": there is none
    "a ring": (ring, " z of"),
    "a ball": (ball, "rotation about "),
    "a shaft": (shaft, " z of"),
    "a shaft between collars": (partial(shaft, collar=1.5), "rotation about z"),
    "a bar": (bar, ""),
}


@pytest.mark.parametrize("what", FREE)
def test_facets_of_round_sides_do_not_hold_what_turns_and_slides_in_them(what: str, tmp_path: Path) -> None:
    draw, motion = FREE[what]
    path = str(write_assembly(tmp_path / "drawn.brep", draw))
    outline = UserFile(file=path).outline(3)
    outer = max(outline.bodies, key=lambda body: float(np.ptp(outline.skin(body)[0][:, 0])))
    tables = {
        "model": "3d",
        "geometry": {"file": path, "names": {f"{outer}.held": {"box": [-2.1, -3, -3, -1.9, 3, 3]}}},
        "bodies": {body: {"E": 1.0, "nu": 0.3} for body in outline.bodies},
        "supports": {"held": {"boundary": f"{outer}.held", "displacement": dict.fromkeys("xyz", 0.0)}},
    }
    rubs = {"friction": {"law": "coulomb", "mu": 0.1}}
    assert resolve(from_dict(tables | {"contacts": {"c": {"between": "all"} | rubs}})).unheld == ""
    found = resolve(from_dict(tables | {"contacts": {"c": {"between": "all"}}})).unheld
    assert motion in found
    assert bool(motion) == bool(found)
