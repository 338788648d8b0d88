"""Meshes of users' files: the scene's sizes, periodic sides, and what makes a mesh unusable."""

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from numpy.testing import assert_allclose

from shared.cases import slow
from shared.drawn import GEO, PY, draw, scene_data
from stickslip.geometry.errors import GeometryError
from stickslip.geometry.mesh.mesh import Mesh, build_mesh
from stickslip.geometry.user_files.meshing import MeshOptions
from stickslip.geometry.user_files.raw_mesh import RawMesh
from stickslip.geometry.user_files.reader import Question, ask
from stickslip.solvers.scene.scene import Scene
from stickslip.workflows.scene_file.read import from_dict

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


def meshed(scene: Scene) -> Mesh:
    return build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF)


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_a_script_that_meshes_keeps_its_own_mesh(tmp_path: Path) -> None:
    mesh = meshed(from_dict(scene_data(write(tmp_path / "b.py", OWN), length=4.0)))
    assert mesh.domain.topology.index_map(2).size_global == 4 * 2 * 5 * 5  # each cell cut into four


@pytest.mark.parametrize("meshes", [*slow("Mesh 1;"), "Mesh 2;"])
def test_sizes_of_the_scene_mesh_again_what_a_script_has_meshed(meshes: str, tmp_path: Path) -> None:
    data = scene_data(write(tmp_path / "b.geo", f"{GEO}{meshes}\n"), mesh_size=0.5, contact_mesh_size=0.1)
    mesh = meshed(from_dict(data))
    assert abs(len(mesh.facets("block.bottom")) - 40) <= 2  # 4 m in 0.1 m; 8 in the script's mesh
    assert abs(len(mesh.facets("block.top")) - 8) <= 2


def test_sizes_of_the_scene_leave_a_mesh_without_geometry(tmp_path: Path) -> None:
    own = meshed(from_dict(scene_data(draw(tmp_path / "b.msh", 2))))
    data = scene_data(write(tmp_path / "b.geo", 'Merge "b.msh";\n'), mesh_size=0.1)
    count = [mesh.domain.topology.index_map(2).size_global for mesh in (own, meshed(from_dict(data)))]
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
