"""`stickslip contacts` and `new --from`: from a file of several solids to results."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from shared.assemblies import bolted, stacked, write_assembly
from shared.command import Call, assert_one_line, result
from stickslip.geometry.errors import SceneError
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.formats.marker import mark
from stickslip.workflows.scene_file.read import read


def test_pairs_are_listed_and_drawn(call: Call, folder: Path) -> None:
    write_assembly(folder / "stack.brep", stacked)
    code, out, err = call("contacts", "stack.brep")
    assert (code, err) == (0, "")
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
    code, _, err = call("contacts", "stack.brep")
    assert_one_line(err)
    assert (code, "stack_contacts: exists already" in err) == (2, True)
    mark(drawn, names=["02_old_pair.png"])
    write_aside(old, b"of a pair that there is no more")
    (drawn / "notes.txt").write_text("mine")
    assert call("contacts", "stack.brep")[0] == 0
    assert sorted(path.name for path in drawn.glob("[!.]*")) == ["01_part_2_part.png", "notes.txt"]
    mark(drawn, names=["result.json"])
    assert call("contacts", "stack.brep")[0] == 2


def test_from_an_assembly_to_results_without_a_line_typed(call: Call, folder: Path) -> None:
    """A block stands on a plate that is held at its bottom, and its weight is all that presses."""
    write_assembly(
        folder / "stack.step", lambda occ: (stacked(occ), occ.dilate(occ.getEntities(3), 0, 0, 0, *[0.1] * 3))
    )
    code, out, err = call("new", "--from", "stack.step")
    assert (code, err) == (0, "")
    assert "2 bodies, 1 contacts" in out
    scene = read(folder / "stack.toml")
    assert scene.geometry.length_unit == "mm"  # type: ignore[union-attr]
    ((name, contact),) = scene.contacts.items()
    assert (name, contact.gap) == ("part_2_part", 0.0)
    assert contact.surface == "part_2.to_part"
    assert call("new", "--from", "stack.step")[0] == 2  # nothing is overwritten
    coarse = ("--set=geometry.mesh_size=1e-4", "--set=geometry.contact_mesh_size=5e-5")
    words = (*coarse, "--set=output.pictures=false", "--set=output.error=false")
    code, _, err = call("run", "stack.toml", "-o", "out", *words)
    assert code == 0, err
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
        assert scene.sections["gravity"].acceleration == (0.0, 0.0, up * 9.81)  # type: ignore[union-attr]


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
    code, _, err = call(
        "run", "lap.toml", "-o", "out", *coarse, "--set=output.pictures=false", "--set=output.error=false"
    )
    assert code == 0, err
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
    assert (len(scene.bodies), len(scene.contacts)) == (18, 38)
    assert sum(contact.normal.sides == 2 for contact in scene.contacts.values()) == 8
    tables = scene.effect_tables()
    assert [name for kind, name in tables if kind == "bolts"] == ["rod", *("bolt", *(f"bolt_{n}" for n in range(2, 7)))]


def test_bodies_get_names_and_lists_tell_partners(call: Call, folder: Path) -> None:
    write_assembly(folder / "stack.brep", stacked)
    (folder / "s.toml").write_text(
        'model = "3d"\ngeometry = { file = "stack.brep", names = { plate = ["part"], cube = ["part_2"] } }\n'
    )
    code, out, _ = call("mesh", "s.toml", "--list")
    assert code == 0
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
    code, _, err = call(*words)
    assert_one_line(err)
    assert (code, says in err) == (2, True), err
    assert list(folder.iterdir()) == []
