"""Files of fields are read by meshio, VTK and ParaView, also those of resumed runs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import meshio
import numpy as np
import pytest
import pyvista as pv
from numpy.testing import assert_allclose, assert_array_equal
from vtkmodules.vtkCommonDataModel import vtkGenericCell

from shared.cases import slow
from shared.disks import make_full
from shared.histories import SMALL, Stop, assert_same, names_in
from shared.synthetic import FACET, MESHES, SIZE, job_of, mesh_of, padded, reference_nodes, result_of
from stickslip.geometry.errors import MachineError, SceneError
from stickslip.solvers.results.step_result import MeshData, StepResult
from stickslip.solvers.simulation.simulation import prepare
from stickslip.workflows.formats.marker import MARKER, mark
from stickslip.workflows.formats.mesh_file import SHAPES
from stickslip.workflows.formats.steps import shown_as, step_name, write_step
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read, to_dict
from stickslip.workflows.writers import paraview_view
from stickslip.workflows.writers.vtu import VtuFiles
from stickslip.workflows.writers.writer import Ended
from stickslip.workflows.writers.xdmf import FieldFiles

ENDED = Ended(status="converged", steps=[])


@pytest.mark.parametrize(("name", "nodes"), SHAPES)
def test_nodes_are_renumbered_as_vtk_numbers_its_cells(name: str, nodes: int) -> None:
    order = next(k for k in (1, 2) if len(reference_nodes(name, k)) == nodes)
    shape = SHAPES[name, nodes]
    cell = vtkGenericCell.InstantiateCell(shape.vtk)
    expected = np.array([cell.GetParametricCoords()[i] for i in range(3 * nodes)]).reshape(-1, 3)
    assert_allclose(padded(reference_nodes(name, order)[list(shape.order)]), expected, atol=1e-12)


def written(folder: Path, shape: str, order: int) -> tuple[MeshData, list[StepResult]]:
    mesh = mesh_of(shape, order)
    results = [result_of(mesh, time, seed) for seed, time in enumerate((0.5, 1.0))]
    for index, result in enumerate(results, start=1):
        write_step(folder, index, result)
    FieldFiles(job_of(folder, mesh)).write_index(
        [(index, result.time) for index, result in enumerate(results, start=1)]
    )
    return mesh, results


@pytest.mark.parametrize(("shape", "order"), MESHES)
def test_meshio_reads_fields_and_contacts(tmp_path: Path, shape: str, order: int) -> None:
    mesh, results = written(tmp_path, shape, order)
    with meshio.xdmf.TimeSeriesReader(tmp_path / "fields.xdmf") as reader:
        points, cells = reader.read_points_cells()
        assert_array_equal(points, padded(mesh.points))
        assert_array_equal(np.sort(cells[0].data, axis=1), mesh.cells)
        assert reader.num_steps == 2
        for k, result in enumerate(results):
            time, at_nodes, at_cells = reader.read_data(k)
            assert time == result.time
            assert_array_equal(at_nodes["displacement"], padded(result.displacement))
            assert_array_equal(at_cells["stress"][0], result.stress.reshape(-1, 9))
            assert_array_equal(at_cells["von_mises"][0], result.von_mises)
            assert_array_equal(at_cells["body"][0], mesh.body)
    with meshio.xdmf.TimeSeriesReader(tmp_path / "contact_base.xdmf") as reader:
        points, _ = reader.read_points_cells()
        assert_array_equal(points, padded(mesh.surfaces["base"][0]))
        for k, result in enumerate(results):
            _, at_nodes, _ = reader.read_data(k)
            contact = result.contacts["base"]
            for name in ("pressure", "gap", "status"):
                assert_array_equal(at_nodes[name], getattr(contact, name))
            for name in ("traction", "slip", "slip_increment", "lam"):
                assert_array_equal(at_nodes[shown_as(name)], padded(getattr(contact, name)))


def vtk_grid(path: Path, time: float) -> Any:
    """Through VTK's own XDMF reader, as ParaView does."""
    reader: Any = pv.get_reader(path)
    assert_array_equal(reader.time_values, [0.5, 1.0])
    reader.set_active_time_value(time)
    found = reader.read()
    return found[0] if isinstance(found, pv.MultiBlock) else found


def check_contact(grid: Any, mesh: MeshData, result: StepResult) -> None:
    """A surface as VTK reads it is that of the step."""
    points, facets, facet = mesh.surfaces["base"]
    contact = result.contacts["base"]
    assert_array_equal(grid.points, padded(points))
    assert_array_equal(grid.cell_connectivity.reshape(2, -1), facets[:, SHAPES[facet, facets.shape[1]].order])
    sizes = grid.compute_cell_sizes()
    assert_allclose(sizes["Length" if facet == "interval" else "Area"], SIZE[facet], rtol=1e-12)
    for name in ("pressure", "gap", "status"):
        assert_array_equal(grid.point_data[name], getattr(contact, name))
    for name in ("traction", "slip", "slip_increment", "lam"):
        assert_array_equal(grid.point_data[shown_as(name)], padded(getattr(contact, name)))


@pytest.mark.parametrize(("shape", "order"), MESHES)
def test_vtk_reads_fields_and_contacts_and_cells_are_whole(tmp_path: Path, shape: str, order: int) -> None:
    mesh, results = written(tmp_path, shape, order)
    for result in results:
        grid = vtk_grid(tmp_path / "fields.xdmf", result.time)
        assert_array_equal(grid.points, padded(mesh.points))
        assert_array_equal(grid.point_data["displacement"], padded(result.displacement))
        assert_array_equal(grid.cell_data["stress"].reshape(-1, 3, 3), result.stress)
        assert_array_equal(grid.cell_data["von_mises"], result.von_mises)
        assert_array_equal(grid.cell_data["body"], mesh.body)
        expected = SHAPES[shape, mesh.cells.shape[1]]
        assert_array_equal(grid.celltypes, expected.vtk)
        assert_array_equal(grid.cell_connectivity.reshape(2, -1), mesh.cells[:, expected.order])
        sizes = grid.compute_cell_sizes()  # volumes of VTK are signed
        assert_allclose(sizes["Volume" if mesh.points.shape[1] == 3 else "Area"], SIZE[shape], rtol=1e-12)
        if order == 1:  # a quadrilateral or hexahedron in tensor order crosses itself: its Jacobian is not positive
            assert grid.cell_quality("scaled_jacobian")["scaled_jacobian"].min() > 0.5
        check_contact(vtk_grid(tmp_path / "contact_base.xdmf", result.time), mesh, result)


def test_fields_are_rewritten_while_a_run_goes_on(tmp_path: Path) -> None:
    mesh = mesh_of("triangle")
    FieldFiles(job_of(tmp_path, mesh)).write_index([])
    assert [p.name for p in tmp_path.iterdir()] == ["fields.h5"]
    before = (tmp_path / "fields.h5").stat()
    for index in (1, 2, 3):
        write_step(tmp_path, index, result_of(mesh, float(index)))
        FieldFiles(job_of(tmp_path, mesh)).write_index([(k, float(k)) for k in range(1, index + 1)])
        with meshio.xdmf.TimeSeriesReader(tmp_path / "fields.xdmf") as reader:
            assert reader.num_steps == index
    assert (tmp_path / "fields.h5").stat().st_ino == before.st_ino  # the same mesh is not written again
    files = FieldFiles(job_of(tmp_path, mesh))
    for _ in range(2):
        files.write_index([])
        assert (tmp_path / "fields.h5").stat().st_ino == before.st_ino
    FieldFiles(job_of(tmp_path, mesh_of("quadrilateral"))).write_index([])
    assert (tmp_path / "fields.h5").stat().st_ino != before.st_ino
    files.write_index([])  # what it has written once is not what stands there now
    assert (tmp_path / "fields.h5").stat().st_size == before.st_size


def test_a_long_history_is_written_again_rarely_and_read_whole(tmp_path: Path) -> None:
    """A thousand steps: 8 writings up to step 8, then one for each eighth more, ln(125) / ln(1.125) = 41."""
    mesh = mesh_of("triangle")
    write_step(tmp_path, 1, result_of(mesh, 1.0))
    write_step(tmp_path, 1000, result_of(mesh, 1000.0, seed=1))
    files, writings, before = FieldFiles(job_of(tmp_path, mesh)), 0, 0
    for index in range(1, 1001):
        files.step(index, result_of(mesh, float(index)))
        now = (tmp_path / "fields.xdmf").stat().st_ino
        writings, before = writings + (now != before), now
    assert writings <= 8 + 41 + 1
    with meshio.xdmf.TimeSeriesReader(tmp_path / "fields.xdmf") as reader:
        assert 1000 / 1.125 <= reader.num_steps <= 1000  # killed here it shows all but the last few
    files.finish(ENDED)
    with meshio.xdmf.TimeSeriesReader(tmp_path / "fields.xdmf") as reader:
        reader.read_points_cells()
        assert reader.num_steps == 1000
        for index, seed in ((1, 0), (1000, 1)):
            time, at_nodes, _ = reader.read_data(index - 1)
            assert time == index
            assert_array_equal(at_nodes["displacement"], padded(result_of(mesh, seed=seed).displacement))
    reader_of_vtk: Any = pv.get_reader(tmp_path / "fields.xdmf")
    assert_array_equal(reader_of_vtk.time_values, np.arange(1.0, 1001.0))
    size = (tmp_path / "fields.h5").stat().st_size
    assert size < 20_000  # the mesh stands there once


def test_a_resumed_run_shows_no_step_that_was_taken_away(tmp_path: Path) -> None:
    mesh, times = mesh_of("triangle"), list(range(1, 21))
    for index in times:
        write_step(tmp_path, index, result_of(mesh, float(index)))
    FieldFiles(job_of(tmp_path, mesh)).write_index([(index, float(index)) for index in times])
    resumed = FieldFiles(job_of(tmp_path, mesh))  # the last four were damaged, and one of them is solved again
    resumed.resume([result_of(mesh, float(index)) for index in times[:16]])
    resumed.step(17, result_of(mesh, 17.5))
    reader: Any = pv.get_reader(tmp_path / "fields.xdmf")
    assert_array_equal(reader.time_values, [*times[:16], 17.5])


@pytest.mark.parametrize("lacking", [0, 1, None])
def test_errors_are_shown_where_every_step_has_them(lacking: int | None, tmp_path: Path) -> None:
    """A run may go on with the estimate switched on, or off; VTK shows the first step's error with a step without."""
    mesh = mesh_of("triangle")
    steps = [replace(result_of(mesh, time), stress_error=np.full(2, time)) for time in (0.5, 1.0)]
    if lacking is not None:
        steps[lacking] = replace(steps[lacking], mesh_error=np.nan, stress_error=np.zeros(0))
    for index, step in enumerate(steps, start=1):
        write_step(tmp_path, index, step)
        files = FieldFiles(job_of(tmp_path, mesh))
        files.resume([step.without_fields() for step in steps[: index - 1]])
        files.step(index, step)
        files.finish(ENDED)
    assert ("stress_error" in (tmp_path / "fields.xdmf").read_text()) == (lacking is None)
    for step in steps:
        shown = vtk_grid(tmp_path / "fields.xdmf", step.time).cell_data
        assert_array_equal(shown["von_mises"], step.von_mises)
        if lacking is None:
            assert_array_equal(shown["stress_error"], step.stress_error)


ASKS = ["output.error_budget=inf", *SMALL, "steps.count=4", "output.vtu=true"]


def files_of(folder: Path, mesh: MeshData, every: int = 1) -> VtuFiles:
    return VtuFiles(job_of(folder, mesh, every=every, writers={"vtu": True}))


def solved(folder: Path, mesh: MeshData, count: int) -> list[StepResult]:
    """So many steps, in their files."""
    results = [result_of(mesh, index / 2, seed=index) for index in range(1, count + 1)]
    for index, result in enumerate(results, start=1):
        write_step(folder, index, result)
    return results


def shown(folder: Path, time: float) -> Any:
    """The blocks at a time, as ParaView has them."""
    reader = pv.PVDReader(folder / "fields.pvd")
    reader.set_active_time_value(time)
    return reader.read()[0]


def times_of(folder: Path) -> list[float]:
    return list(pv.PVDReader(folder / "fields.pvd").time_values)


@pytest.mark.parametrize(("shape", "order"), MESHES)
def test_every_body_and_contact_is_a_block_that_says_what_the_step_says(tmp_path: Path, shape: str, order: int) -> None:
    mesh = mesh_of(shape, order)
    results, files = solved(tmp_path, mesh, 2), files_of(tmp_path, mesh)
    for index, result in enumerate(results, start=1):
        files.step(index, result)
    assert times_of(tmp_path) == [0.5, 1.0]
    for result in results:
        found = shown(tmp_path, result.time)
        assert found.keys() == ["bodies", "contacts"]
        assert found["bodies"].keys() == list(mesh.bodies)
        for number, name in enumerate(mesh.bodies):
            grid, nodes = found["bodies"][name], mesh.cells[number]  # a cell each, without a node in common
            assert_array_equal(grid.points, padded(mesh.points[nodes]))
            assert_array_equal(grid.celltypes, SHAPES[shape, len(nodes)].vtk)
            assert_array_equal(grid.cell_connectivity, SHAPES[shape, len(nodes)].order)
            sizes = grid.compute_cell_sizes()  # volumes of VTK are signed
            assert_allclose(sizes["Volume" if mesh.points.shape[1] == 3 else "Area"], SIZE[shape], rtol=1e-12)
            assert_array_equal(grid.point_data["displacement"], padded(result.displacement[nodes]))
            assert_array_equal(grid.cell_data["stress"], result.stress[number].reshape(1, 9))
            assert_array_equal(grid.cell_data["von_mises"], result.von_mises[[number]])
            smooth = grid.point_data["nodal_stress"]  # of the only cell
            assert_allclose(smooth, np.tile(result.stress[number].ravel(), (len(nodes), 1)), rtol=1e-15)
            assert_allclose(grid.point_data["nodal_von_mises"], result.von_mises[number], rtol=1e-12)
        (grid,), points = found["contacts"], mesh.surfaces["base"][0]
        check_contact(grid, mesh, result)
        moved = {tuple(x): u for x, u in zip(mesh.points, result.displacement, strict=True)}
        assert_array_equal(grid.point_data["displacement"], padded(np.array([moved[tuple(x)] for x in points])))


@pytest.mark.parametrize("shape", FACET)
def test_meshio_reads_a_block_alone(tmp_path: Path, shape: str) -> None:
    mesh = mesh_of(shape)
    (result,) = solved(tmp_path, mesh, 1)
    files_of(tmp_path, mesh).step(1, result)
    body = meshio.read(tmp_path / "vtu" / "000001_body_right.vtu")
    assert_array_equal(body.points, padded(mesh.points[mesh.cells[1]]))
    assert_array_equal(body.point_data["displacement"], padded(result.displacement[mesh.cells[1]]))
    assert_array_equal(body.cell_data["stress"][0], result.stress[1].reshape(1, 9))
    base = meshio.read(tmp_path / "vtu" / "000001_contact_base.vtu")
    assert_array_equal(base.point_data["pressure"], result.contacts["base"].pressure)


def test_bodies_that_share_no_node_are_apart_and_a_contact_moves_with_its_body_in_a_real_mesh(tmp_path: Path) -> None:
    """Also where a node of the other body lies in the same place."""
    sizes = [f"geometry.{key}=0.5" for key in ("mesh_size", "lower_mesh_size", "contact_mesh_size")]
    scene = read("two_blocks", [*sizes, "steps.count=2", "output.pictures=false", "output.vtu=true"])
    run(scene, tmp_path / "out")
    found = shown(tmp_path / "out", times_of(tmp_path / "out")[-1])
    upper, joint = found["bodies"]["upper"], found["contacts"]["joint"]
    at = [np.linalg.norm(upper.points - x, axis=1).argmin() for x in joint.points]
    assert_array_equal(joint.points, upper.points[at])
    assert_array_equal(joint.point_data["displacement"], upper.point_data["displacement"][at])
    sliding = np.linalg.norm(joint.point_data["slip"], axis=1)
    lower = found["bodies"]["lower"]
    beside = [np.linalg.norm(lower.points - x, axis=1).argmin() for x in joint.points]
    off = joint.point_data["displacement"] - lower.point_data["displacement"][beside]
    assert_allclose(abs(off[:, 0]), sliding, atol=0.3 * sliding.max())  # the nearest node of the other mesh
    warped = found.combine().warp_by_vector("displacement")  # one filter moves all blocks
    assert warped.n_points == upper.n_points + lower.n_points + joint.n_points
    mesh = prepare(scene).data
    assert found["bodies"].keys() == list(mesh.bodies)
    assert found["contacts"].keys() == list(scene.contacts)
    assert sum(grid.n_cells for grid in found["bodies"]) == len(mesh.cells)
    for grid in found["bodies"]:  # rectangles, covered once
        left, right, bottom, top, *_ = grid.bounds
        assert grid.compute_cell_sizes()["Area"].sum() == pytest.approx((right - left) * (top - bottom), rel=1e-12)


@pytest.mark.parametrize(("flat", "opacity"), [(True, None), (False, 0.4)])
def test_the_macro_asks_paraview_for_the_usual_view(flat: bool, opacity: float | None) -> None:
    """It was tried with pvpython of ParaView 5.11; here its calls are recorded."""
    pv, source = MagicMock(), MagicMock(TimestepValues=[0.5, 1.0])
    source.GetDataInformation().GetBounds.return_value = (0.0, 3.0, 0.0, 4.0, 0.0, 0.0 if flat else 12.0)
    source.PointData["displacement"].GetRange.return_value = (0.0, 0.5)
    view = paraview_view.show(pv, source, None)
    assert view.ViewTime == 1.0
    assert pv.WarpByVector.return_value.ScaleFactor == pytest.approx(1.0 if flat else 2.6)  # a tenth of the size / 0.5
    assert [c.args[1] for c in pv.ColorBy.call_args_list] == [("POINTS", "nodal_von_mises"), ("POINTS", "pressure")]
    assert [c.kwargs["registrationName"] for c in pv.ExtractBlock.call_args_list] == ["bodies", "contacts"]
    assert view.InteractionMode == ("2D" if flat else "3D")
    assert opacity is None or pv.Show.return_value.Opacity == opacity


@pytest.mark.parametrize(
    ("every", "count", "expected"), [(1, 3, [1, 2, 3]), (2, 5, [2, 4, 5]), (2, 4, [2, 4]), (9, 2, [2])]
)
def test_every_nth_step_is_written_and_the_last(tmp_path: Path, every: int, count: int, expected: list[int]) -> None:
    mesh = mesh_of("triangle")
    vtu, xdmf = files_of(tmp_path, mesh, every), FieldFiles(job_of(tmp_path, mesh, every=every))
    for index, result in enumerate(solved(tmp_path, mesh, count), start=1):
        vtu.step(index, result)
        xdmf.step(index, result)
    for files in (vtu, xdmf, xdmf):
        files.finish(ENDED)
    times = [index / 2 for index in expected]
    assert times_of(tmp_path) == times
    for name in ("fields.xdmf", "contact_base.xdmf"):
        assert_array_equal(pv.get_reader(tmp_path / name).time_values, times)
    assert sorted(path.stem for path in (tmp_path / "vtu").glob("*.vtm")) == [f"{index:06d}" for index in expected]


def test_whatever_is_there_a_resumed_run_has_what_its_steps_say(tmp_path: Path) -> None:
    """As a crash leaves it: a step of which a file is missing, one that was taken away, and one shown as the last."""
    mesh = mesh_of("triangle")
    mark(tmp_path)
    results, files = solved(tmp_path, mesh, 6), files_of(tmp_path, mesh, every=2)
    for index, result in enumerate(results, start=1):
        files.step(index, result)
    before = {name: (tmp_path / name).read_bytes() for name in names_in(tmp_path)}
    assert "vtu/000006.vtm" in before
    (tmp_path / "vtu" / "000002.vtm").unlink()
    (tmp_path / "vtu" / "000004_body_left.vtu").rename(tmp_path / "vtu" / "000005_body_left.vtu")
    (tmp_path / "vtu" / "000004.vtm").rename(tmp_path / "vtu" / "000005.vtm")
    mine = {"vtu/mine.vtu": b"a user's own", "vtu/000005.mine.vtu": b"a user's own"}
    for name, content in mine.items():
        (tmp_path / name).write_bytes(content)
    resumed = files_of(tmp_path, mesh, every=2)
    resumed.resume(results[:4])
    assert times_of(tmp_path) == [1.0, 2.0]
    assert {name[4:10] for name in names_in(tmp_path) - {*mine} if name.startswith("vtu/")} == {"000002", "000004"}
    for index in (5, 6):
        resumed.step(index, results[index - 1])
    resumed.finish(ENDED)
    before[MARKER] = (tmp_path / MARKER).read_bytes()
    after = {name: (tmp_path / name).read_bytes() for name in names_in(tmp_path)}
    assert after == before | mine
    files_of(tmp_path, mesh).resume([])
    assert names_in(tmp_path) - {step_name(index) for index in range(1, 7)} == {*mine, MARKER}


@pytest.mark.parametrize("asked_before", [*slow(True), False])
def test_a_run_that_was_stopped_goes_on_to_the_same_files(tmp_path: Path, asked_before: bool) -> None:
    """Also if this output is asked for only when the run goes on."""
    run(read("block", ASKS), tmp_path / "whole")
    words = ASKS if asked_before else [*ASKS, "output.vtu=false"]
    run(read("block", [*words, "output.every=2"]), tmp_path / "out", Watch(on_step=Stop(3)))
    outcome, _ = run(read("block", ASKS), tmp_path / "out", resume=True)
    assert outcome.status == "converged"
    assert "vtu/000003_contact_base.vtu" in names_in(tmp_path / "out")
    assert_same(tmp_path / "out", tmp_path / "whole")


def test_a_run_writes_it_on_request_only(tmp_path: Path) -> None:
    plain, asks = read("block", [*SMALL, "steps.count=1"]), read("block", [*SMALL, "steps.count=1", "output.vtu=true"])
    assert "vtu" not in to_dict(plain)["output"]
    assert to_dict(asks)["output"]["vtu"] is True
    run(plain, tmp_path / "off")
    run(asks, tmp_path / "on")
    more = names_in(tmp_path / "on") - names_in(tmp_path / "off")
    assert {name.split("/")[0] for name in more} == {"fields.pvd", "vtu", "paraview_view.py"}
    with pytest.raises(SceneError, match=r"output\.vtu = 1: expected true or false"):
        read("block", ["output.vtu=1"])


def test_a_full_disk_is_said_and_the_old_files_stay_readable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = mesh_of("triangle")
    results, files = solved(tmp_path, mesh, 2), files_of(tmp_path, mesh)
    files.step(1, results[0])
    before = names_in(tmp_path)

    with monkeypatch.context() as patched:
        make_full(patched)
        with pytest.raises(MachineError, match=r"000002_body_left\.vtu: cannot be written: No space left"):
            files.step(2, results[1])
    assert names_in(tmp_path) == before
    assert_array_equal(shown(tmp_path, 0.5)["contacts"]["base"]["gap"], results[0].contacts["base"].gap)


def test_the_macro_for_paraview_needs_nothing_but_paraview() -> None:
    """It is copied to the results, and ParaView's Python does not know this program."""
    assert "from stickslip" not in Path(paraview_view.__file__).read_text()
