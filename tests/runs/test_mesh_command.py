"""`stickslip mesh`: the report, the numbers of faces, the mesh as a file, gmsh's window."""

import json
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_allclose
from PIL import Image

from shared.command import COARSE, Call, result
from shared.drawn import draw, scene_data
from stickslip.geometry.mesh.mesh import build_mesh
from stickslip.geometry.user_files.user_file import DEBIAN
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.simulation.resolve import resolve
from stickslip.solvers.system.system import assemble
from stickslip.workflows.commands._mesh import announce
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
    code, out, err = call("mesh", "block", "--set", "obstacles.foundation.point=[0.0, 0.25]", *COARSE)
    assert (code, err) == (0, "")
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
    code, _, err = call("run", "block", "-o", "out", *COARSE)
    assert code == 0
    assert err.index("contact base: 9 normal and 9 tangential points") < err.index("t = 1:")
    log = (folder / "out" / "run.log").read_text()
    assert "worst quality" in log
    assert "contact base: 9 normal" in log
    assert call("run", "block", "-q", "-o", "quiet", *COARSE) == (0, "", "")


def test_list_names_and_draws_every_face(call: Call, folder: Path) -> None:
    draw(folder / "b.step")
    (folder / "part.toml").write_text(CAD)
    code, out, err = call("mesh", "part.toml", "--list")
    assert (code, err) == (0, "")
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
    code, out, err = call("mesh", "part.toml", "--list", "--set", 'geometry.names={"part.base"=["face 77"]}')
    assert (code, err) == (0, "")
    assert 'warning: b.step: names."part.base": "face 77" is not there' in out
    assert len([line for line in out.splitlines() if line.startswith("│")]) == 6


def test_list_of_a_plane_file_numbers_its_edges(call: Call, folder: Path) -> None:
    draw(folder / "b.brep", 2)
    (folder / "part.toml").write_text(
        CAD.replace("3d", "plane strain").replace("b.step", "b.brep").replace("face 5", "edge 1")
    )
    code, out, _ = call("mesh", "part.toml", "--list")
    assert code == 0
    assert len([line for line in out.splitlines() if line.startswith("│")]) == 4
    assert (folder / "part_faces.png").stat().st_size > 0


def test_the_written_mesh_is_read_back_in_metres(call: Call, folder: Path) -> None:
    code, _, err = call("mesh", "block", "-o", "meshes/block.msh", *COARSE)
    assert (code, err) == (0, "")
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
    code, out, err = call("mesh", "block", "--gui")
    assert (code, out, err.count("\n")) == (4, "", 1)
    assert "there is no display here" in err
    monkeypatch.setenv("DISPLAY", ":no display")
    code, out, err = call("mesh", "block", "--gui")
    assert (code, out, err.count("\n")) == (4, "", 1)
    assert "could not open its window on the display :no display" in err


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["-o", "mesh.vtk"], 2, "expected a file that ends in .msh"),
        (["-o", "file/mesh.msh"], 4, "mesh.msh: cannot be written"),
    ],
)
def test_a_mesh_that_cannot_be_written_is_one_line(
    words: list[str], code: int, says: str, call: Call, folder: Path
) -> None:
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
    code, _, err = call("run", "cad_part", "-q", "-o", "out", *plain, "--set=geometry.contact_mesh_size=2.5e-3")
    assert (code, err) == (0, "")
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
    code, _, err = call("mesh", "cad_part", "--set", f"geometry.file={DEBIAN}/nowhere/component8.step.gz")
    assert (code, err.count("\n")) == (2, 1)
    assert "no such file; it is in Debian's package gmsh-doc: apt-get install gmsh-doc" in err


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
        code, _, err = call("mesh", "s.toml", "-o", target)
        assert code == 2
        assert "is the file that the scene reads" in err
    assert (folder / "b.msh").read_bytes() == before
    assert call("mesh", "s.toml", "-o", "c.msh")[0] == 0
