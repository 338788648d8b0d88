"""The commands for geometry: a mesh is shown, contacts are found, friction problems are solved."""

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_allclose
from PIL import Image

from shared.assemblies import bolted, stacked, write_assembly
from shared.command import COARSE, Call, assert_said, ended, output_of, result
from shared.discrete import ONE, local, random_problem, write
from shared.drawn import draw, scene_data
from stickslip.geometry.errors import SceneError
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.geometry.user_files.user_file import DEBIAN
from stickslip.solvers.interface.discrete import discrete_problem, residual
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.system.system import assemble
from stickslip.workflows.commands._mesh import announce
from stickslip.workflows.formats.fclib import read_problem
from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.formats.marker import mark
from stickslip.workflows.lab.verification.hard.tables import toml
from stickslip.workflows.run.mesh_report import elements_across, look
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import from_dict, read

CAD = """
model = "3d"
[geometry]
file = "b.step"
mesh_size = 1.0
names = { "part.bottom" = ["face 5"] }
[bodies.part]
E = 1.0
nu = 0.3
"""


def across(cells: int, dim: int, length: float = 2.0) -> int:
    width = {"width": 1.0} if dim == 3 else {}
    geometry = {"builder": "block", "length": length, "height": 1.0, "mesh_size": 1 / cells, "cells": "tensor"} | width
    data = scene_data("", dim) | {"geometry": geometry}
    scene = from_dict(data)
    system = assemble(resolve(scene), build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF), Counters())
    return elements_across(system.contacts[0].surface)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_elements_across_are_counted_over_the_narrow_way(n: int) -> None:
    assert across(n, 2) == 2 * n  # all of the 2 m
    assert across(n, 3) == n  # 1 m across, 2 m along


def test_the_report_names_counts_quality_gaps_and_overlap(call: Call) -> None:
    out = output_of(call("mesh", "block", "--set", "obstacles.foundation.point=[0.0, 0.25]", *COARSE))
    report, *_ = look(read("block", ["obstacles.foundation.point=[0.0, 0.25]", *(c.split("=", 1)[1] for c in COARSE)]))
    base = report.contacts["base"]
    assert f"{report.cells} cells, {report.nodes} nodes, worst quality {report.worst_quality:.2f}" in out
    assert base.smallest_gap == base.largest_gap == -0.25
    assert base.overlapping_points == base.normal_points == 9  # 4 m in cells of 0.5 m
    assert_allclose([base.overlap_area, base.area], 4.0)
    assert base.elements_across == 8
    assert report.worst_quality == pytest.approx(np.sqrt(3) / 2, rel=0.3)  # halves of squares; graded, so not exactly


def test_a_contact_that_stays_out_of_reach_is_a_warning_in_plan_mesh_and_run(call: Call, folder: Path) -> None:
    far = ["--set", "obstacles.foundation.point=[0.0, -0.2]", *COARSE]  # the top comes down by 0.1 m only
    expected = "contacts.base: never touches: the gap is 0.2 m"
    assert f"warning: {expected}" in call("mesh", "block", *far)[1]
    assert json.loads(call("plan", "block", "--mesh", "--json", *far)[1])["mesh"]["warnings"][0].startswith(expected)
    assert expected in " ".join(call("plan", "block", "--mesh", *far)[1].split())
    near = [word.replace("-0.2", "-0.05") for word in far]
    code, out, _ = call("mesh", "block", *near)
    assert (code, "warning" in out) == (0, False)


def test_the_run_says_its_mesh_before_solving_and_logs_it(call: Call, folder: Path) -> None:
    _, err = ended(call("run", "block", "-o", "out", *COARSE))
    assert err.index("contact base: 9 normal and 9 tangential points") < err.index("t = 1:")
    log = (folder / "out" / "run.log").read_text()
    assert "worst quality" in log
    assert "contact base: 9 normal" in log
    assert call("run", "block", "-q", "-o", "quiet", *COARSE) == (0, "", "")


def test_list_names_and_draws_every_face(call: Call, folder: Path) -> None:
    draw(folder / "b.step")
    (folder / "part.toml").write_text(CAD)
    out = output_of(call("mesh", "part.toml", "--list"))
    rows = {line.split("│")[1].strip(): line for line in out.splitlines() if line.startswith("│")}
    assert set(rows) == {str(number) for number in range(1, 7)}
    assert "part.bottom" in rows["5"]
    assert "2, 1, 0" in rows["5"]  # the centre of the bottom
    assert [" 8 " in rows[n] for n in "12"] == [False, False]  # 4 m x 2 m are 8 m2, 2 m x 2 m are 4 m2
    assert " 8 " in rows["5"]
    picture = np.asarray(Image.open(folder / "part_faces.png").convert("RGB"))
    assert len(np.unique(picture.reshape(-1, 3)[::7], axis=0)) > 20  # faces in several colours, shaded


def test_list_works_before_the_sides_have_names(call: Call, folder: Path) -> None:
    draw(folder / "b.step")
    (folder / "part.toml").write_text(CAD + '[contacts.base]\nsurface = "part.base"\nagainst = "table"\n')
    assert call("mesh", "part.toml")[0] == 2  # neither the side nor the obstacle is there yet
    out = output_of(call("mesh", "part.toml", "--list", "--set", 'geometry.names={"part.base"=["face 77"]}'))
    assert 'warning: b.step: names."part.base": "face 77" is not there' in out
    assert len([line for line in out.splitlines() if line.startswith("│")]) == 6


def test_list_of_a_plane_file_numbers_its_edges(call: Call, folder: Path) -> None:
    draw(folder / "b.brep", 2)
    (folder / "part.toml").write_text(
        CAD.replace("3d", "plane strain").replace("b.step", "b.brep").replace("face 5", "edge 1")
    )
    out, _ = ended(call("mesh", "part.toml", "--list"))
    assert len([line for line in out.splitlines() if line.startswith("│")]) == 4
    assert (folder / "part_faces.png").stat().st_size > 0


def test_the_written_mesh_is_read_back_in_metres(call: Call, folder: Path) -> None:
    output_of(call("mesh", "block", "-o", "meshes/block.msh", *COARSE))
    assert [path.name for path in (folder / "meshes").iterdir()] == ["block.msh"]
    scene = read("block", [c.split("=", 1)[1] for c in COARSE])
    again = from_dict({**scene_data(folder / "meshes" / "block.msh")})
    one, other = (build_mesh(s.geometry, s.request(), MPI.COMM_SELF) for s in (scene, again))
    assert one.domain.topology.index_map(2).size_global == other.domain.topology.index_map(2).size_global
    assert_allclose(one.box(), other.box(), atol=1e-12)
    assert set(one.sides) == set(other.sides)


def test_the_window_needs_a_display(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert_said(call("mesh", "block", "--gui"), 4, "there is no display here")
    monkeypatch.setenv("DISPLAY", ":no display")
    assert_said(call("mesh", "block", "--gui"), 4, "could not open its window on the display :no display")


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["-o", "mesh.vtk"], 2, "expected a file that ends in .msh"),
        (["-o", "file/mesh.msh"], 4, "mesh.msh: cannot be written"),
    ],
)
def test_a_mesh_not_to_be_written_is_one_line(words: list[str], code: int, says: str, call: Call, folder: Path) -> None:
    (folder / "file").write_text("")
    found, _, err = call("mesh", "block", *words, *COARSE)
    assert (found, err.count("\n")) == (code, 1)
    assert says in err


def test_metres_and_millimetres_give_the_same_answer(call: Call, folder: Path) -> None:
    def solved(name: str, scale: float, unit: str) -> dict[str, float]:
        draw(folder / f"{name}.msh", 2, scale)
        _, content = run(from_dict(scene_data(folder / f"{name}.msh", length_unit=unit)), folder / name)
        found: dict[str, float] = content["steps"][-1]["contacts"]["base"]
        return found

    one, other = solved("m", 1.0, "m"), solved("mm", 1000.0, "mm")
    assert one["normal_force"] > 0
    assert_allclose(one["normal_force"], other["normal_force"], rtol=1e-3)  # gmsh may move inner nodes
    assert_allclose(one["contact_area"], other["contact_area"], rtol=1e-9)


def test_the_cad_part_is_pressed_and_dragged(call: Call, folder: Path) -> None:
    """gmsh-doc's component8.step, a nut in millimetres: its flat face is a ring of radii 11 and 16 mm."""
    plain = ("--set=output.pictures=false", "--set=output.error=false")
    output_of(call("run", "cad_part", "-q", "-o", "out", *plain, "--set=geometry.contact_mesh_size=2.5e-3"))
    press, drag = (step["contacts"]["base"] for step in result(folder / "out")["steps"])
    assert_allclose(press["contact_area"], np.pi * (16e-3**2 - 11e-3**2), rtol=0.05)  # chords of coarse circles
    assert press["tangential_force"] < 1e-2 * press["normal_force"]  # the nut is symmetric
    assert 0.1 < drag["tangential_force"] / drag["normal_force"] <= 0.3
    assert drag["force"][1] < 0 < press["normal_force"]  # the plane is above
    assert drag["force"][0] < 0  # against the motion


def test_cells_behind_curved_faces_keep_their_shape() -> None:
    report, *_ = look(read("cad_part", ["geometry.order=2"]))
    assert report.worst_quality > 0.02  # 0.0005 as the curved faces leave them


def test_a_ready_part_that_is_not_there_says_how_to_get_it(call: Call) -> None:
    assert_said(
        call("mesh", "cad_part", "--set", f"geometry.file={DEBIAN}/nowhere/component8.step.gz"),
        2,
        "no such file; it is in Debian's package gmsh-doc: apt-get install gmsh-doc",
    )


def test_a_long_mesh_is_announced(capsys: pytest.CaptureFixture[str]) -> None:
    announce(read("block"))
    assert capsys.readouterr().err == ""
    announce(read("block", ["geometry.contact_mesh_size=1e-5"]))
    assert capsys.readouterr().err == "gmsh makes about 3e+06 cells, in up to 5.1 minutes ...\n"


def test_the_file_that_a_scene_reads_is_not_written_over(call: Call, folder: Path) -> None:
    draw(folder / "b.msh", 2)
    before = (folder / "b.msh").read_bytes()
    (folder / "link.msh").symlink_to("b.msh")
    data = scene_data("b.msh", 2, length_unit="mm")
    (folder / "s.toml").write_text("".join(f"{key} = {toml(value)}\n" for key, value in data.items()))
    for target in ("b.msh", "link.msh", "./b.msh"):
        _, err = ended(call("mesh", "s.toml", "-o", target), 2)
        assert "is the file that the scene reads" in err
    assert (folder / "b.msh").read_bytes() == before
    assert call("mesh", "s.toml", "-o", "c.msh")[0] == 0


def test_pairs_are_listed_and_drawn(call: Call, folder: Path) -> None:
    write_assembly(folder / "stack.brep", stacked)
    out = output_of(call("contacts", "stack.brep"))
    (row,) = [line for line in out.splitlines() if line.startswith("│")]
    assert [cell.strip() for cell in row.split("│")[2:-1]] == [
        *("plane", "part_2.to_part", "11", "part.to_part_2", "6", "1", "0", "0", "unilateral")
    ]
    drawn = folder / "stack_contacts"
    assert [path.name for path in drawn.glob("*.png")] == ["01_part_2_part.png"]


def test_pictures_of_pairs_are_drawn_again_in_place_of_their_own_kind_only(call: Call, folder: Path) -> None:
    write_assembly(folder / "stack.brep", stacked)
    drawn, old = folder / "stack_contacts", folder / "stack_contacts" / "02_old_pair.png"
    drawn.mkdir()
    assert_said(call("contacts", "stack.brep"), 2, "stack_contacts: exists already")
    mark(drawn, names=["02_old_pair.png"])
    write_aside(old, b"of a pair that there is no more")
    (drawn / "notes.txt").write_text("mine")
    assert call("contacts", "stack.brep")[0] == 0
    assert sorted(path.name for path in drawn.glob("[!.]*")) == ["01_part_2_part.png", "notes.txt"]
    for names in (["result.json"], []):
        mark(drawn, names=names)
        assert call("contacts", "stack.brep")[0] == 2
    write_aside(drawn / "01_part_2_part.png", b"mine")
    mark(drawn, names=["02_old_pair.png"])
    assert "01_part_2_part.png: is no file of this run, and in its way" in call("contacts", "stack.brep")[2]
    assert (drawn / "01_part_2_part.png").read_bytes() == b"mine"
    assert sorted(path.name for path in folder.iterdir()) == ["stack.brep", "stack_contacts"]


def test_from_an_assembly_to_results_without_a_line_typed(call: Call, folder: Path) -> None:
    """A block stands on a plate that is held at its bottom, and its weight is all that presses."""
    write_assembly(
        folder / "stack.step", lambda occ: (stacked(occ), occ.dilate(occ.getEntities(3), 0, 0, 0, *[0.1] * 3))
    )
    out = output_of(call("new", "--from", "stack.step"))
    assert "2 bodies, 1 contacts" in out
    scene = read(folder / "stack.toml")
    assert scene.geometry.length_unit == "mm"
    ((name, contact),) = scene.contacts.items()
    assert (name, contact.gap) == ("part_2_part", 0.0)
    assert contact.surface == "part_2.to_part"
    assert call("new", "--from", "stack.step")[0] == 2  # nothing is overwritten
    coarse = ("--set=geometry.mesh_size=1e-4", "--set=geometry.contact_mesh_size=5e-5")
    words = (*coarse, "--set=output.pictures=false", "--set=output.error=false")
    ended(call("run", "stack.toml", "-o", "out", *words))
    weight = 7850 * 9.81 * 1e-4**3  # of the cube of .1 mm: the file is in mm, and drawn ten times smaller
    force = result(folder / "out")["steps"][0]["contacts"][name]["normal_force"]
    assert force == pytest.approx(weight, rel=1e-6)


def test_the_weight_presses_the_body_that_is_held(call: Call, folder: Path) -> None:
    """Upside down: the plate hangs over a block that has no large end, so it is held, and gravity acts upwards."""

    def table(occ: Any) -> None:
        stacked(occ)
        occ.rotate(occ.getEntities(3), 0, 0, 0, 1, 0, 0, np.pi)

    for drawn, up in ((stacked, -1), (table, 1)):
        write_assembly(folder / "table.step", drawn)
        (folder / "table.toml").unlink(missing_ok=True)
        assert call("new", "--from", "table.step")[0] == 0
        scene = read(folder / "table.toml")
        assert [str(support.boundary).split(".")[0] for support in scene.supports.values()] == ["part"]
        assert scene.sections["gravity"].acceleration == (0.0, 0.0, up * 9.81)


PULL = """
[loads.pull]
boundary = "part_2.right"
force = [[[1.0, 0.0], [2.0, 1500.0]], 0.0, 0.0]

[steps]
end = 2.0
count = 2
"""


def test_a_bolted_joint_from_file_to_slip_with_six_lines_typed(call: Call, folder: Path) -> None:
    """Nut and bolt are known by their shapes; tightened to 100 MPa, the plates slip at mu times the tension.

    The pull of 1500 N is above mu F = 1005 N: what is more bends the bolt, for the friction under head and nut holds.
    """
    write_assembly(folder / "lap.step", bolted)
    assert call("new", "--from", "lap.step")[0] == 0
    text = (folder / "lap.toml").read_text()
    assert (
        'part_3 = { body = "part_3", shank = [[0.02, 0.02, 0.004], [0.02, 0.02, 0.012]], force = [[1.0, 5.03e+03]]'
        in text
    )
    assert text.count("threaded, by the shape of a nut") == 1
    assert 'boundary = "part.left"' in text
    (folder / "lap.toml").write_text(text + PULL)
    coarse = ("--set=geometry.mesh_size=8e-3", "--set=geometry.contact_mesh_size=4e-3")
    ended(call("run", "lap.toml", "-o", "out", *coarse, "--set=output.pictures=false", "--set=output.error=false"))
    tightened, pulled = result(folder / "out")["steps"]
    assert tightened["bolts"]["part_3"]["tension"] == pytest.approx(5030.0, rel=1e-6)
    plates, head = (tightened["contacts"][name]["normal_force"] for name in ("part_part_2", "part_3_part_2"))
    # cells of 4 mm: facets of the shank that meet the nut reach into the part that is shortened, 8 mm long
    assert [plates, head] == pytest.approx([5030.0, 5030.0], rel=3e-3)
    joint = pulled["contacts"]["part_part_2"]
    assert joint["stick_area"] == 0.0
    assert joint["tangential_force"] == pytest.approx(0.2 * joint["normal_force"], rel=1e-3)


@pytest.mark.slow  # 10 s: faces of 18 solids are compared
def test_the_18_solids_of_a_demo_have_seven_bolts(call: Call, folder: Path) -> None:
    demo = Path("/usr/share/doc/gmsh-doc/doc/gmsh/demos/api/as1-tu-203.stp.gz")
    assert call("new", "--from", str(demo), "as1.toml")[0] == 0
    scene = read(folder / "as1.toml")
    assert (len(scene.bodies), *scene.contacts) == (18, "any")
    assert scene.contacts["any"].between == "all"
    tied = [pair for pair, contact in scene.pairs.items() if contact.normal.ties]
    assert len(tied) == 8
    assert all("nut" in pair for pair in tied)
    assert {c.gap for pair, c in scene.pairs.items() if pair not in tied} == {0.0}
    tables = scene.effect_tables()
    assert [name for kind, name in tables if kind == "bolts"] == ["rod", *("bolt", *(f"bolt_{n}" for n in range(2, 7)))]


def test_bodies_get_names_and_lists_tell_partners(call: Call, folder: Path) -> None:
    write_assembly(folder / "stack.brep", stacked)
    (folder / "s.toml").write_text(
        'model = "3d"\ngeometry = { file = "stack.brep", names = { plate = ["part"], cube = ["part_2"] } }\n'
    )
    out, _ = ended(call("mesh", "s.toml", "--list"))
    touching = [line.split("│")[2:5] for line in out.splitlines() if line.startswith("│") and "│ -       │" not in line]
    assert {(body.strip(), partner.strip()) for body, _, partner in touching} >= {("plate", "cube"), ("cube", "plate")}
    code, out, _ = call("contacts", "s.toml", "-o", "drawn")
    assert (code, "cube.to_plate" in out) == (0, True)


def test_a_program_that_draws_gets_a_scene(call: Call, folder: Path) -> None:
    (folder / "stack.py").write_text(
        "def build(model, parameters):\n"
        "    boxes = [model.occ.addBox(0, 0, z, 1, 1, 1) for z in (0, 1)]\n"
        "    model.occ.synchronize()\n"
        "    for box, name in zip(boxes, ('plate', 'cube')):\n"
        "        model.setPhysicalName(3, model.addPhysicalGroup(3, [box]), name)\n"
    )
    code, out, err = call("contacts", "stack.py")
    assert (code, "cube.to_plate" in out) == (0, True), err
    assert call("new", "--from", "stack.py")[0] == 0
    (contact,) = read(folder / "stack.toml").contacts.values()
    assert {contact.surface, contact.against} == {"cube.to_plate", "plate.to_cube"}


def test_refinement_is_where_bodies_are_close(call: Call, folder: Path) -> None:
    """A plate of 16 m² that a cube touches on 1 m² gets fine cells there alone."""
    write_assembly(folder / "stack.brep", stacked)
    assert call("new", "--from", "stack.brep")[0] == 0
    scene = read(folder / "stack.toml", ["geometry.mesh_size=1.0", "geometry.contact_mesh_size=0.2"])
    near = scene.request()
    assert near.facing == (("part_2.to_part", "part.to_part_2"),)
    counts, expected = [], []
    for request in (near, replace(near, facing=())):
        mesh = build_mesh(scene.geometry, request, MPI.COMM_SELF)
        counts.append(mesh.domain.topology.index_map(3).size_global)
        expected.append(scene.geometry.cell_count(request))
        at = mesh.domain.geometry.x
        patch = at[np.abs(at - [2, 2, 1]).max(axis=1) < 0.49]
        assert len(patch) > 2 * 0.98**2 / 0.2**2  # nodes of both sides on the square, about .2 m apart
    assert counts[0] < 0.4 * counts[1]
    assert expected[0] < 0.4 * expected[1]
    with pytest.raises(SceneError, match="contact_mesh_size"):
        read(folder / "stack.toml", ["geometry.contact_mesh_size=1e-5"])


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("contacts", "none.step"), "no such file"),
        (("contacts", "two_blocks"), "a builder's bodies touch at the sides that the docs name"),
        (("contacts", "block.xyz"), "no such file, nor a ready scene"),
        (("contacts", "cad_part", "--unit", "mm"), "--unit mm: a scene has its own"),
        (("contacts", "cad_part", "--within", "-1"), "--within -1.0: must be a number that is not negative"),
        (("contacts", "none.step", "--unit", "yd"), 'length_unit = "yd": not one of these'),
        (("new", "--from", "block.toml"), "expected a geometry file"),
        (("new", "--from", "none.step"), "no such file"),
        (("new", "--from", "none.step", "a", "b"), "takes one name"),
        (("new",), "name a ready scene"),
        (("new", "block", "--unit", "mm"), "belong to --from"),
    ],
)
def test_wrong_words_are_refused_in_one_line(words: tuple[str, ...], says: str, call: Call, folder: Path) -> None:
    assert_said(call(*words), 2, says)
    assert list(folder.iterdir()) == []


PLACE = "FCLIB_PROBLEMS"  # environment variable: a folder with problems of the public collection
UNSOLVABLE = local(np.diag([0.0, 1.0]), np.array([-1.0, 0.0]), np.array([0.3]))  # u_n = -1 whatever r is


def public_problems() -> list[Path]:
    folder = os.environ.get(PLACE, "")
    return sorted(Path(folder).glob("*.hdf5")) if folder else []


@pytest.fixture
def files(folder: Path) -> list[str]:
    q, _, _ = ONE["slips"]
    write(folder / "one.hdf5", local(np.eye(3), np.array(q), np.array([0.5])))
    write(folder / "six.hdf5", local(*random_problem(0)))
    return ["one.hdf5", "six.hdf5"]


def test_each_problem_has_its_line_and_its_copy(call: Call, folder: Path, files: list[str]) -> None:
    before = [(folder / name).read_bytes() for name in files]
    out = output_of(call("fclib", *files, "-o", "out", "--json", "figures.json"))
    lines = out.splitlines()
    assert lines[0].split()[:4] == ["problem", "d", "contacts", "rank"]
    assert lines[1].split()[:4] == ["one", "3", "1", "3/3"]
    assert lines[2].split()[:4] == ["six", "3", "6", "9/18"]
    assert lines[3].startswith("auto: 2 of 2 solved")
    assert [(folder / name).read_bytes() for name in files] == before
    with h5py.File(folder / "out" / "one.hdf5") as file:
        _, r, u = ONE["slips"]
        assert_allclose(file["solution/r"][()], r, atol=1e-8)
        assert_allclose(file["solution/u"][()], u, atol=1e-8)
        assert file["solution"].attrs["status"] == "solved"
    content = json.loads((folder / "figures.json").read_text())
    assert content == json.loads((folder / "out" / "fclib.json").read_text())
    assert [entry["contacts"] for entry in content["problems"]] == [1, 6]
    assert all(entry["results"][0]["residual"] <= 1e-8 for entry in content["problems"])


def test_methods_are_compared(call: Call, folder: Path, files: list[str]) -> None:
    out, _ = ended(call("fclib", *files, "-o", "out", "--method", "nsgs", "--method", "condensed-newton"))
    assert "share of the problems" in out
    assert (folder / "out" / "profile.png").read_bytes().startswith(b"\x89PNG")
    content = json.loads((folder / "out" / "fclib.json").read_text())
    assert [result["method"] for result in content["problems"][0]["results"]] == ["nsgs", "condensed-newton"]
    assert content["solved"] == {"nsgs": 2, "condensed-newton": 2}
    assert content["profile"]["shares"]["nsgs"][-1] == 1.0


def test_every_method_can_be_asked_for_at_once(call: Call, folder: Path, files: list[str]) -> None:
    assert call("fclib", files[0], "-o", "out", "--method", "all", "--tolerance", "1e-4")[0] == 0
    methods = [r["method"] for r in json.loads((folder / "out" / "fclib.json").read_text())["problems"][0]["results"]]
    assert methods == ["auto", "condensed-newton", "surface-uzawa", "uzawa", "nsgs"]


def test_what_is_unsolved_is_said(call: Call, folder: Path, files: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stickslip.solvers.stepping.discrete_chain.TURNS", (("nsgs", 50, "from r = 0"),))
    write(folder / "none.hdf5", UNSOLVABLE)
    out, _ = ended(call("fclib", "none.hdf5", *files, "-o", "out"), 3)
    assert "NOT SOLVED" in out.splitlines()[1]
    with h5py.File(folder / "out" / "none.hdf5") as file:
        assert file["solution"].attrs["status"] == "not solved"
        assert file["solution"].attrs["residual"] > 0.1
    result = json.loads((folder / "out" / "fclib.json").read_text())["problems"][0]["results"][0]
    assert result["solved"] is False


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["none.hdf5"], r"none.hdf5: cannot be read"),
        (["one.hdf5", "text.hdf5"], "text.hdf5: not an HDF5 file"),
        (["one.hdf5", "--tolerance", "0"], "--tolerance 0: must lie between 0 and 1"),
        (["one.hdf5", "--tolerance", "nan"], "--tolerance nan: must lie between 0 and 1"),
        (["one.hdf5", "--method", "gram-uzawa"], "--method gram-uzawa: needs the bodies"),
        (["one.hdf5", "--method", "nsg"], "--method nsg: no such method; did you mean nsgs?"),
        (["one.hdf5", "sub/one.hdf5"], "one.hdf5: two files of this name"),
        (["one.hdf5", "-o", "foreign"], "foreign: is not the result of a run and not empty"),
        ([], "Missing parameter: files"),
    ],
)
def test_bad_input_is_refused_in_a_line(
    call: Call, folder: Path, files: list[str], words: list[str], line: str
) -> None:
    (folder / "text.hdf5").write_text("text")
    (folder / "foreign").mkdir()
    (folder / "foreign" / "mine.txt").write_text("mine")
    (folder / "sub").mkdir()
    write(folder / "sub" / "one.hdf5", local(np.eye(3), np.ones(3), np.array([0.5])))
    before = sorted(str(path) for path in folder.rglob("*"))
    code, out, err = call("fclib", *words)
    assert (code, out) == (2, "")
    assert err.startswith("stickslip: ")
    assert err.count("\n") == 1
    assert line in err
    assert sorted(str(path) for path in folder.rglob("*")) == before


def test_a_former_result_is_kept_and_its_files_are_not_read_there(call: Call, folder: Path, files: list[str]) -> None:
    assert call("fclib", *files, "-o", "out")[0] == 0
    assert call("fclib", files[0], "-o", "out")[0] == 0
    assert sorted(path.name for path in (folder / "out").glob("*.hdf5")) == ["one.hdf5"]
    assert sorted(path.name for path in (folder / "out.1").glob("*.hdf5")) == files
    for place in ("out", "out.1"):
        _, err = ended(call("fclib", f"{place}/one.hdf5", "-o", "out"), 2)
        assert "which is replaced; choose another folder with -o" in err


def test_report_in_the_folder_is_where_it_was_asked_for(call: Call, folder: Path, files: list[str]) -> None:
    """It is the user's: it goes along with the results, and later runs keep it."""
    for names in (files, files[:1]):
        assert call("fclib", *names, "-o", "out", "--json", "out/figures.json")[::2] == (0, "")
        assert len(json.loads((folder / "out" / "figures.json").read_text())["problems"]) == len(names)
    for former in ("out.1", "out.3"):  # of the first report there is out.2
        assert call("fclib", *files, "-o", "out")[0] == 0
        assert len(json.loads((folder / former / "figures.json").read_text())["problems"]) == 1


def test_report_that_cannot_be_written_takes_no_solution_with_it(call: Call, folder: Path, files: list[str]) -> None:
    code, _, err = call("fclib", *files, "-o", "out", "--json", "one.hdf5/figures.json")
    assert (code, err) == (4, "stickslip: one.hdf5/figures.json: cannot be written: Not a directory\n")
    assert sorted(path.name for path in (folder / "out").glob("*.hdf5")) == files


def test_an_error_leaves_nothing(call: Call, folder: Path, files: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("stickslip.workflows.commands._fclib.write_solved", fails)
    assert call("fclib", *files, "-o", "out")[0] == 130
    assert sorted(path.name for path in folder.iterdir()) == files


@pytest.mark.slow
@pytest.mark.skipif(not public_problems(), reason=f"{PLACE} names no folder with problems of the public collection")
@pytest.mark.parametrize("path", public_problems(), ids=lambda path: path.stem)
@pytest.mark.parametrize("tolerance", [1e-4, 1e-8])
def test_public_problems_are_solved_by_the_default(call: Call, folder: Path, path: Path, tolerance: float) -> None:
    """The answer in the copy is judged by the file's own numbers."""
    assert call("fclib", str(path), "-o", "out", "--tolerance", str(tolerance))[0] == 0
    stored = read_problem(path)
    problem = discrete_problem(stored.W, stored.q, stored.mu)
    with h5py.File(folder / "out" / path.name) as file:
        r = file["solution/r"][()] / problem.scales[0]
        u = file["solution/u"][()] / problem.units[1]
    assert_allclose(u, problem.surface.matrix @ r + problem.q, atol=1e-10 * max(1.0, np.abs(r).max()))
    assert residual(r, u, problem.mu) <= tolerance * (1 + 1e-6)
