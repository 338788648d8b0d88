"""Histories on other cells, or of another order, are those of runs that are asked for them."""

from dataclasses import replace
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from stickslip import SceneError, prepare, read
from stickslip.geometry.mesh.mesh import write_msh
from stickslip.geometry.mesh_sizes import adapted
from stickslip.geometry.user_files.user_file import UserFile
from stickslip.solvers.accuracy.histories import OtherHistory, coarser
from stickslip.solvers.results.step_result import quantities

COARSE = ["geometry.mesh_size=0.25", "output.error=false"]


def test_the_same_cells_of_order_2_and_cells_twice_as_long() -> None:
    own = prepare(read("block", COARSE))
    times = own.scene.requested_times()
    for history, asked in (
        (OtherHistory.of_order(own.system, 2), ["geometry.mesh_size=0.25", "geometry.order=2"]),
        (OtherHistory.coarser(own.system, 2.0), ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.1"]),
    ):
        steps = list(prepare(read("block", ["output.error=false", *asked])).steps())
        for found, step in zip(history(times), steps, strict=True):
            for key, value in quantities(step).items():
                assert_allclose(
                    quantities(found)[key], value, rtol=1e-9, atol=1e-9 * step.contacts["base"].normal_force
                )
        (last,) = history(times, wanted=times[-1:])
        assert last.time == times[-1]
    assert own.counters.error_solves > 0


def test_a_cut_mesh_of_a_file_has_the_file_cut_less(tmp_path: Path) -> None:
    simple = prepare(read("block", COARSE))
    write_msh(simple.problem.shape, simple.problem.request, tmp_path / "block.msh")
    scene = replace(simple.scene, geometry=UserFile(file=str(tmp_path / "block.msh")))
    with pytest.raises(SceneError, match="its own mesh"):
        coarser(prepare(scene).mesh, 2.0)
    data = simple.data
    sizes = adapted(data.points, data.cells, data.points[data.cells].mean(axis=1)[:, 0], 0.5)
    cut = prepare(scene, sizes=sizes).mesh
    assert simple.mesh.node_count < coarser(cut, 2.0).node_count < cut.node_count / 2
    assert coarser(cut, 1e3).node_count == simple.mesh.node_count
