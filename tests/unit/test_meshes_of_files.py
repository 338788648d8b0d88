"""Meshes of users' files: the scene's sizes, and what a file has meshed itself."""

from pathlib import Path

import pytest
from mpi4py import MPI

from shared.drawn import GEO, PY, draw, scene_data
from stickslip.geometry.mesh.mesh import Mesh, build_mesh
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


def meshed(scene: Scene) -> Mesh:
    return build_mesh(scene.geometry, scene.request(), MPI.COMM_SELF)


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_a_script_that_meshes_keeps_its_own_mesh(tmp_path: Path) -> None:
    mesh = meshed(from_dict(scene_data(write(tmp_path / "b.py", OWN), length=4.0)))
    assert mesh.domain.topology.index_map(2).size_global == 4 * 2 * 5 * 5  # each cell cut into four


@pytest.mark.parametrize("meshes", ["Mesh 1;", "Mesh 2;"])
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
